"""Excellon reader: hits, slots and routed ways of a drill file, as digits until their format is decided.

Source: the Excellon CNC-7 programming manual's commands as common tools write them; `G85` in one line, on a line of
its own, with omitted coordinates; routed with M15/M16 and with G00/G01 alone; tools in the header, in the body and in
Allegro's comments.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

DRILL = re.compile(r"^\s*M48\b|^T\d+[FSC][\d.]|^;\s*LEADER|^\s*T\d+\s*$[\s\S]*?^X[-+\d.]+", re.MULTILINE)
_TOOL = re.compile(r"T(\d+)(?:[FSBHZ][-+\d.]+)*C([\d.]+)", re.IGNORECASE)
_ALLEGRO_TOOL = re.compile(
    r";\s*Holesize\s+(\d+)\.?\s*=\s*([\d.]+).*?(NON_PLATED|PLATED|OPTIONAL)?\s*(MILS|MM|INCHES|MILLIMETERS)",
    re.IGNORECASE,
)
_COORDINATE = re.compile(r"([XYIJA])([-+.\d]+)")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)\Z")
_CYCLES = re.compile(r"G(3[23]|8[2347])(?!\d)")
"""Codes that drill or cut several places at once; no tool writes them today."""
_CAPPED = re.compile(r"TA\.AperFunction,.*ViaDrill.*,(Filled|VII)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class DrillFormat:
    """How coordinates are written. unit, digits, zeros_kept: None where the file does not say.

    zeros_kept: "leading" (LZ: the decimal point counts from the left), "trailing" (TZ: from the right), "all".
    """

    unit: str | None = None
    integers: int | None = None
    decimals: int | None = None
    zeros_kept: str | None = None
    has_points: bool = False

    @property
    def unit_mm(self) -> float:
        """Return the unit's length."""
        return 25.4 if self.unit == "inch" else 1.0

    def length_mm(self, digits: str) -> float:
        """Return a coordinate in mm; the format must be complete."""
        if "." in digits:
            return round(float(digits) * self.unit_mm, 6)
        sign = -1.0 if digits.startswith("-") else 1.0
        digits = digits.lstrip("+-")
        if self.zeros_kept == "leading":
            digits = digits.ljust((self.integers or 0) + (self.decimals or 0), "0")
        return round(sign * int(digits or "0") * 10.0 ** -(self.decimals or 0) * self.unit_mm, 6)


@dataclass(frozen=True, slots=True)
class RawArc:
    """How a round piece of a slot goes: about the middle at i, j from its start, or with a radius."""

    clockwise: bool
    i: str | None = None
    j: str | None = None
    radius: str | None = None


@dataclass(frozen=True, slots=True)
class RawHit:
    """A hit or one straight or round piece of a slot, in digits."""

    tool: int
    x: str
    y: str
    end_x: str | None = None
    end_y: str | None = None
    arc: RawArc | None = None


@dataclass(slots=True)
class Tool:
    """A drill: its diameter as written, its unit where the tool says it (Allegro), what it is for."""

    diameter: float | None = None
    unit_mm: float | None = None
    plated: bool | None = None
    capped: bool = False


@dataclass(slots=True)
class DrillFile:
    """What a drill file says; `said` is its format as far as it says it; span: the copper layers it goes through."""

    said: DrillFormat = field(default_factory=DrillFormat)
    hits: list[RawHit] = field(default_factory=list)
    tools: dict[int, Tool] = field(default_factory=dict)
    plated: bool | None = None
    span: tuple[int, int] | None = None


def read_excellon(text: str) -> DrillFile:
    """Read a drill file's words; raise ValueError naming the line that cannot be read."""
    reader = _Reader(DrillFile())
    for number, line in enumerate(text.splitlines(), 1):
        try:
            reader.line(line.strip())
        except ValueError as exc:
            raise ValueError(f"line {number} ({line.strip()[:40]}) cannot be read: {exc}") from exc
        if reader.done:
            break
    found = reader.file
    if any("." in (h.x + h.y) for h in found.hits):
        found.said = replace(found.said, has_points=True)
    return found


@dataclass(slots=True)
class _Reader:
    file: DrillFile
    tool: int = 0
    x: str = "0"
    y: str = "0"
    routing: bool = False
    plunged: bool = False
    uses_plunge: bool = False
    in_header: bool = False
    slot_next: bool = False
    next_plated: bool | None = None
    next_capped: bool = False
    done: bool = False
    incremental: bool = False
    round: int = 0
    origin_next: bool = False
    text_next: bool = False
    pattern: list[RawHit] | None = None
    pattern_from: int = 0
    pattern_away: tuple[str, str] = ("0", "0")

    def line(self, line: str) -> None:
        if line.startswith((";", "(")):
            self._comment(line)
        elif line.startswith(("M97", "M98")):
            self.text_next = True
        elif line in ("M30", "M00", "M2", "M02"):
            self.done = bool(self.file.hits)
        elif line.startswith("M48"):
            self.in_header = True
        elif line in ("%", "M95"):
            self.in_header = False
        elif line.startswith("T") and line[1:2].isdigit():
            self._take_tool(line)
        elif self._is_setting(line):
            self._setting(line)
        else:
            self._body(line)

    def _comment(self, line: str) -> None:
        if found := _ALLEGRO_TOOL.match(line):
            _require_number(found[2])
            unit_mm = {"mil": 0.0254, "inc": 25.4}.get(found[4].lower()[:3], 1.0)
            self.file.tools[int(found[1])] = Tool(float(found[2]), unit_mm, _plated_word(found[3] or ""))
        elif "FORMAT" in line.upper():
            self._format_comment(line)
        elif re.match(r";\s*TYPE\s*=", line):
            self.next_plated = _plated_word(line)
            if not self.file.tools:
                self.file.plated = self.next_plated
        elif found := re.search(r"TF\.FileFunction,(\w+)(?:,(\d+),(\d+))?", line):
            self.file.plated = {"Plated": True, "NonPlated": False}.get(found[1])
            self.file.span = (int(found[2]), int(found[3])) if found[2] else None
        elif "TA.AperFunction" in line:
            self.next_plated = not ("NonPlated" in line or "NPTH" in line)
            self.next_capped = bool(_CAPPED.search(line))

    def _format_comment(self, line: str) -> None:
        text = line.lower()
        digits = re.search(r"([\d-])\s*[:.]\s*([\d-])", text)
        changes: dict[str, object] = {}
        if digits and digits[1] != "-" and digits[2] != "-":
            changes |= {"integers": int(digits[1]), "decimals": int(digits[2])}
        if "suppress leading" in text:
            changes["zeros_kept"] = "trailing"
        elif "suppress trailing" in text:
            changes["zeros_kept"] = "leading"
        elif "keep zeros" in text:
            changes["zeros_kept"] = "all"
        if "metric" in text or "inch" in text:
            changes["unit"] = "mm" if "metric" in text else "inch"
        self._say(**changes)

    def _say(self, **changes: object) -> None:
        self.file.said = replace(self.file.said, **changes)  # type: ignore[arg-type]

    def _is_setting(self, line: str) -> bool:
        return line.startswith(("METRIC", "INCH", "FMAT", "ICI", "VER", "DETECT", "ATC")) or line in (
            "M71", "M72",
        )  # fmt: skip

    def _setting(self, line: str) -> None:
        if line.startswith(("METRIC", "M71")):
            self._say(unit="mm")
        elif line.startswith(("INCH", "M72")):
            self._say(unit="inch")
        elif line.startswith("ICI"):
            self.incremental = "ON" in line
        if "LZ" in line:
            self._say(zeros_kept="leading")
        elif "TZ" in line:
            self._say(zeros_kept="trailing")
        if digits := re.search(r"\b(0+)\.(0+)\b", line):
            self._say(integers=len(digits[1]), decimals=len(digits[2]))

    def _take_tool(self, line: str) -> None:
        line = line.replace(" ", "")
        found = _TOOL.match(line)
        number = int(found[1]) if found else int(re.match(r"T(\d+)", line)[1])  # type: ignore[index]
        if found:
            _require_number(found[2])
            self.file.tools[number] = Tool(float(found[2]), None, self.next_plated, self.next_capped)
            self.next_capped = False
        if not self.in_header:
            self.tool = self._known(number, line) or self.tool
        rest = re.sub(r"^T\d+(?:[FSBHZC][-+\d.]+)*", "", line)
        if rest:
            self._body(rest)

    def _known(self, number: int, line: str) -> int:
        """Return a tool's number; `T0102` is tool 1 with the offset 2."""
        four = re.match(r"T(\d\d)\d\d(?!\d)", line)
        return int(four[1]) if four and number not in self.file.tools and int(four[1]) in self.file.tools else number

    def _body(self, line: str) -> None:
        line = re.sub(r"(?<=\d),(?=\d)", ".", line)
        if found := _CYCLES.search(line):
            raise ValueError(f"{found[0]} is not known")
        for code in re.findall(r"[GM]\d+", line.split("X", maxsplit=1)[0].split("Y", maxsplit=1)[0]):
            self._code(int(code[1:]), code[0])
        if _COORDINATE.search(line) and self._is_no_hit(line):
            return
        if repeat := re.match(r"R(\d+)\s*(?=[XY]|$)", line):
            self._repeat(int(repeat[1]), line)
            return
        if "G85" in line:
            before, _, after = line.partition("G85")
            if not _COORDINATE.search(before) and (both := re.match(r"(.*?[XY].*?Y[^X]*)(X.*)", after)):
                before, after = both[1], both[2]
            self._move(before)
            self._slot(after)
        elif self.slot_next and _COORDINATE.search(line):
            self._slot(line)
        elif _COORDINATE.search(line):
            self._go(line)

    def _is_no_hit(self, line: str) -> bool:
        """Say whether a line's coordinates are no place to drill: an origin, letters, the way to a pattern's copy."""
        if self.origin_next:
            self.origin_next = False
            if any(digits.strip("+-0.") for _, digits in _COORDINATE.findall(line)):
                raise ValueError("it sets another origin")
            return True
        if self.text_next:
            self.text_next = False
            return True
        if self.pattern is not None and re.match(r"(R\d+)?M0?2", line):
            self._copy_pattern(line)
            return True
        return False

    def _copy_pattern(self, line: str) -> None:
        """Drill the pattern again, so far from its last copy."""
        if re.search(r"M[789]0", line):
            raise ValueError("it turns a pattern over")
        steps = dict(_COORDINATE.findall(line))
        times = re.match(r"R(\d+)", line)
        for _ in range(min(int(times[1]), 10_000) if times else 1):
            x, y = self.pattern_away
            self.pattern_away = x, y = self._plus(x, steps.get("X", "0")), self._plus(y, steps.get("Y", "0"))
            self.file.hits += [self._carried(hit, x, y) for hit in self.pattern or ()]

    def _carried(self, hit: RawHit, x: str, y: str) -> RawHit:
        end_x = None if hit.end_x is None else self._plus(hit.end_x, x)
        end_y = None if hit.end_y is None else self._plus(hit.end_y, y)
        return RawHit(hit.tool, self._plus(hit.x, x), self._plus(hit.y, y), end_x, end_y, hit.arc)

    def _m_code(self, code: int) -> None:
        if code in (15, 16, 17):
            self.plunged, self.uses_plunge = code == 15, True
        elif code == 25:
            self.pattern, self.pattern_from, self.pattern_away = None, len(self.file.hits), ("0", "0")
        elif code == 1:
            self.pattern = self.file.hits[self.pattern_from :]
        elif code == 8:
            self.pattern = None

    def _code(self, code: int, letter: str) -> None:
        if letter == "M":
            self._m_code(code)
        elif code in (92, 93):
            self.origin_next = True
        elif code in (90, 91):
            self.incremental = code == 91
        elif code == 5:
            self.routing = self.plunged = False
        elif code in (0, 1, 2, 3):
            self.routing, self.round = True, code if code > 1 else 0
            if code == 0:
                self.plunged = False
            elif not self.uses_plunge:
                self.plunged = True

    def _go(self, line: str) -> None:
        """Move, and drill or cut on the way."""
        was = (self.x, self.y)
        self._move(line)
        if not self.routing:
            self.file.hits.append(RawHit(self.tool, self.x, self.y))
        elif self.plunged:
            self.file.hits.append(RawHit(self.tool, *was, self.x, self.y, self._arc(line)))

    def _arc(self, line: str) -> RawArc | None:
        """Return how the drill goes round, None where it goes straight."""
        said = dict(re.findall(r"([IJA])([-+.\d]+)", line))
        for digits in said.values():
            _require_number(digits)
        return RawArc(self.round == 2, said.get("I"), said.get("J"), said.get("A")) if self.round and said else None

    def _move(self, text: str) -> None:
        for axis, digits in _COORDINATE.findall(text):
            _require_number(digits)
            if axis == "X":
                self.x = self._plus(self.x, digits) if self.incremental else digits
            elif axis == "Y":
                self.y = self._plus(self.y, digits) if self.incremental else digits

    def _plus(self, a: str, b: str) -> str:
        return _plus(a, b, from_left=self.file.said.zeros_kept == "leading")

    def _slot(self, after: str) -> None:
        """Cut from where the drill stands to the coordinates after `G85`; an omitted one stays."""
        start = (self.x, self.y)
        if not _COORDINATE.search(after):
            self.slot_next = True
            return
        self._move(after)
        self.slot_next = False
        if self.file.hits and self.file.hits[-1] == RawHit(self.tool, *start):
            self.file.hits.pop()  # the slot's start stood on a line of its own and was taken for a hit
        self.file.hits.append(RawHit(self.tool, *start, self.x, self.y))

    def _repeat(self, times: int, line: str) -> None:
        steps = dict(_COORDINATE.findall(line))
        for digits in steps.values():
            _require_number(digits)
        for _ in range(min(times, 10_000)):
            self.x, self.y = self._plus(self.x, steps.get("X", "0")), self._plus(self.y, steps.get("Y", "0"))
            self.file.hits.append(RawHit(self.tool, self.x, self.y))


_MOST_DIGITS, _MOST_WHOLE_DIGITS = 9, 5
"""Digits that count of a coordinate, and before a point where it has one; more lie on no board."""


def _require_number(digits: str) -> None:
    if not _NUMBER.match(digits):
        raise ValueError(f"{digits[:12]} is no number")
    whole, point, _ = digits.lstrip("+-").lstrip("0").partition(".")
    if len(whole) > (_MOST_WHOLE_DIGITS if point else _MOST_DIGITS):
        raise ValueError(f"{digits[:12]}... lies on no board")


def _plus(a: str, b: str, *, from_left: bool) -> str:
    """Add two numbers as they are written: both with a point, or digits that count from one end."""
    if "." in a or "." in b:
        return f"{float(a) + float(b):.6f}"
    width = max(len(a.lstrip("+-")), len(b.lstrip("+-")))
    if from_left:
        a, b = (sign + digits.ljust(width, "0") for sign, digits in (_signed(a), _signed(b)))
    total = int(a) + int(b)
    return f"{'-' if total < 0 else ''}{abs(total):0{width}d}"


def _signed(text: str) -> tuple[str, str]:
    return ("-" if text.startswith("-") else ""), text.lstrip("+-")


def _plated_word(text: str) -> bool | None:
    text = text.upper().replace("-", "_")
    if "NON_PLATED" in text or "NONPLATED" in text or "UNPLATED" in text:
        return False
    return True if "PLATED" in text else None
