"""IPC-D-356 reader: test records of a netlist, by column where columns hold, else by their letters.

Source: IPC-D-356A; and what tools make of it: KiCad writes `R000S3` without the blank, EAGLE pads numbers with blanks
and lets long part names push all that follows, several write long nets through aliases (`P  NNAME1 A_LONG_NAME`), some
write small letters, indent, or call the records 318 and 328.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from daemon.tools.cad.model import is_no_net

_CODE = re.compile(r"3[0-6][78]")
_RECORD = re.compile(r"^[ \t]*3[0-6][78](?=.*X[-+ ]?\s*\d)", re.MULTILINE | re.IGNORECASE)
_JOB = re.compile(r"^[ \t]*(C  |P\s+(JOB|CODE|UNITS|DIM|TITLE|NUM|REV|VER|IMAGE|NNAME))", re.MULTILINE | re.IGNORECASE)
_END = re.compile(r"^[ \t]*999\b", re.MULTILINE)
_FEATURE = re.compile(
    r"(?P<middle>(?<![A-Z0-9])M?)\s?(?:(?<![A-LN-Z0-9])D\s*(?P<hole>\d+)\s*(?P<plated>[PU]?)\s*|[PU])?"
    r"(?:(?<![B-OQ-TV-Z])A\s*(?P<access>\d{1,2}))?\s?"
    r"X(?P<x>[-+ ]?\s*\d+)\s*Y(?P<y>[-+ ]?\s*\d+)"
    r"(?:\s*X\s*(?P<width>\d+))?(?:\s*Y\s*(?P<height>\d+))?(?:\s*R\s*\d{1,3})?\s*(?:S\s*(?P<mask>[0-3]))?"
)
_ALIAS = re.compile(r"^P\s+NNAME(?:(\S+)|\s+(\d+))\s+(\S.*?)\s*$", re.MULTILINE)
_MOST_DIGITS = 9
"""With its sign; a longer number lies on no board."""
_INCH_UNIT_MM, _MM_UNIT_MM = 0.00254, 0.001


@dataclass(frozen=True, slots=True)
class Record:
    """One test record; mm in the netlist's own origin.

    reference, pin: "" for a via. access: 0 both sides, 1 top, the largest number of the file: bottom.
    mask: 0 open both, 1 top covered, 2 bottom covered, 3 both covered. height_mm: 0 for a round pad.
    """

    code: int
    net: str
    reference: str
    pin: str
    x_mm: float
    y_mm: float
    hole_mm: float | None
    plated: bool | None
    access: int
    mask: int | None
    width_mm: float
    height_mm: float


@dataclass(frozen=True, slots=True)
class Netlist:
    """All records that could be read; the numbers of the lines that could not; whether its end (999) is there."""

    records: tuple[Record, ...]
    unread: tuple[int, ...]
    ended: bool = True

    @property
    def bottom_layer(self) -> int:
        """The access number of the bottom: the largest of the surface pads, else of all."""
        surface = [r.access for r in self.records if r.code == 327]
        return max(max(surface, default=0), max((r.access for r in self.records), default=0), 2)


def looks_like_netlist(text: str) -> bool:
    """Say whether a file's content is IPC-D-356, whatever it is called."""
    head = text[:200_000]
    records = len(_RECORD.findall(head))
    return records > 0 and (bool(_JOB.search(head)) or records >= 0.5 * (head.count("\n") + 1))


def read_ipc356(text: str) -> Netlist:
    """Read all test records; lines that cannot be read are counted, not guessed."""
    aliases = _aliases(text)
    unit_mm = _INCH_UNIT_MM
    records: list[Record] = []
    unread: list[int] = []
    for number, indented in enumerate(text.splitlines(), 1):
        line = indented.lstrip(" \t")
        if line[:1] in ("P", "p") and "UNITS" in line[:12].upper():
            unit_mm = _units_mm(line.upper())
        elif _CODE.match(line):
            record = _record(line, unit_mm, aliases)
            if record is None:
                unread.append(number)
            else:
                records.append(record)
    return Netlist(tuple(records), tuple(unread), ended=_END.search(text) is not None)


def _aliases(text: str) -> dict[str, str]:
    """Return short name -> long one: `NNAME1 LONG`, or spaced `NNAME 001 LONG`, whose records may say either."""
    found: dict[str, str] = {}
    for glued, spaced, long in _ALIAS.findall(text):
        found[f"NNAME{glued or spaced}"] = long
        if spaced:
            found[f"NNAME{int(spaced)}"] = found[spaced] = long
    return found


def _units_mm(line: str) -> float:
    words = line.split()
    kind = words[words.index("UNITS") + 1 :] if "UNITS" in words else []
    return _MM_UNIT_MM if "SI" in kind or kind[:2] == ["CUST", "1"] else _INCH_UNIT_MM


def _record(line: str, unit_mm: float, aliases: dict[str, str]) -> Record | None:
    capitals = line if len(line.upper()) != len(line) else line.upper()  # some letters have no capital of their length
    holds = capitals[38:39] == "A" and capitals[41:42] == "X" and capitals[49:50] == "Y"
    start = 31 if holds else 3
    found = _FEATURE.search(line, start) or _FEATURE.search(capitals, start)
    if found is None or any(
        len((found[k] or "").split(" ")[-1]) > _MOST_DIGITS for k in ("x", "y", "hole", "width", "height")
    ):
        return None
    head = line[: found.start()]
    net, reference, pin = _names(head)
    is_via = reference.upper() in ("VIA", "-")
    return Record(
        code=int(f"{line[:2]}7"),
        net="" if is_no_net(net) else aliases.get(net, net),
        reference="" if is_via else reference,
        pin="" if is_via else pin,
        x_mm=_number(found["x"]) * unit_mm,
        y_mm=_number(found["y"]) * unit_mm,
        hole_mm=_number(found["hole"]) * unit_mm if found["hole"] else None,
        plated={"P": True, "U": False}.get(found["plated"] or ""),
        access=int(found["access"] or 0),
        mask=int(found["mask"]) if found["mask"] else None,
        width_mm=_number(found["width"] or "0") * unit_mm,
        height_mm=_number(found["height"] or "0") * unit_mm,
    )


def _names(head: str) -> tuple[str, str, str]:
    """Split net, part and pin: by column if the dash and the gap are where they belong, else by words."""
    if "\t" in head:  # an editor's, for blanks: columns are gone
        net, *words = [*head[3:].split(), ""]
        head = f"{head[:3]}{net:<17}{' '.join(words)}"
    fixed = f"{head:<32}"
    if (
        not fixed[17:20].strip()
        and (fixed[26] == "-" or fixed[20:26].strip().upper() in ("VIA", ""))
        and len(head.rstrip()) <= 32
    ):
        return fixed[3:17].strip(), fixed[20:26].strip(), fixed[27:31].strip()
    if not fixed[17:20].strip():
        net, rest = fixed[3:17].strip(), head[20:]
    else:
        net, _, rest = head[3:].strip().partition(" ")
    reference, dash, pin = rest.strip().rpartition("-")
    if not dash:
        reference, pin = rest.strip(), ""
    pin = pin.strip()
    if pin[-1:] in ("M", "m") and len(head) > 31 and head.rstrip()[-1:] == pin[-1:] and " " in pin:
        pin = pin[:-1]
    return net, reference.strip(), pin.strip()


def _number(text: str) -> int:
    return int(text.replace(" ", ""))
