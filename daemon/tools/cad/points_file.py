"""Points files: a CSV of test points as people and tools write it, and EasyEDA's flying probe JSON.

Columns are found by their headings (name, pin, net, x, y, side, diameter or sizes, hole), wherever the table starts
and however it is separated; so Altium's Test Point Report, KiCad's test point plugins and fixture makers' templates
are read alike. Known from documentation and public projects: Altium, EasyEDA (mil), TheJigsApp, FixturFab.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

from daemon.tools.cad.model import Pin
from daemon.tools.cad.pins import BOTH, BOTTOM, NONE, TOP

_MIL_MM, _INCH_MM = 0.0254, 25.4
_UNIT_MM = {
    "mm": 1.0,
    "mil": _MIL_MM,
    "mils": _MIL_MM,
    "in": _INCH_MM,
    "inch": _INCH_MM,
    "inches": _INCH_MM,
    "um": 1e-3,
    "nm": 1e-6,
}
_UNIT = re.compile(r"(?<![a-z])(mm|mils?|inch|in|um|nm)(?![a-z])")
_UNIT_IN_WORDS = re.compile(r"(?<![a-z])(mm|mils?|inch|um|nm)(?![a-z])|\bunits?\W+(in)\b(?!\W*[a-z])")
"""In a sentence, where `in` is a word as any other."""
_WRITTEN_OUT = (
    (re.compile(r"[\u00b5\u03bc]m|\bmicrons?\b|\bmicromet(er|re)s?\b"), "um"),
    (re.compile(r"\bmillimet(er|re)s?\b"), "mm"),
    (re.compile(r"\binches\b"), "inch"),
    (re.compile(r"\b([xy])(?=(mm|mils?|inch|um)\b)"), r"\1 "),
)
UNSAID_UNITS = (1.0, _INCH_MM, _MIL_MM, 1e-3, 1e-6)
"""What a length may be times when a file does not say its unit; the layers decide."""
_HEADINGS: dict[str, tuple[str, ...]] = {
    "name": (
        "name", "test point", "testpoint", "test point name", "testpoint name", "designator", "ref des", "refdes",
        "reference", "source ref des", "component", "part", "point", "tp", "ref", "probe", "id",
        "test point designator", "tp name", "testpunkt", "prüfpunkt", "bezeichner", "label",
    ),
    "pin": ("pin", "pad", "source pad", "pad number", "pin number", "pad name", "pin name", "pad num"),
    "net": ("net", "net name", "netname", "signal", "net label", "signal name", "node", "netz", "netzname"),
    "side": (
        "side", "layer", "tp layer", "access", "test point side", "board side", "tp side", "test side", "face",
        "top bottom", "tb", "t b", "seite", "lage",
    ),
    "width": (
        "diameter", "size", "pad size", "size x", "x size", "width", "pad diameter", "tp diameter", "dia", "pad x",
        "pad size x", "pad width",
    ),
    "height": ("size y", "y size", "height", "pad y", "pad size y", "pad height"),
    "hole": ("hole", "hole size", "drill", "drill diameter", "hole diameter"),
    **{
        axis: tuple(
            pattern.format(axis) for pattern in (
                "{}", "{} coord", "{} location", "{} position", "pos {}", "{} pos", "{} coordinate", "center {}",
                "tp {}",
                "location {}", "test point {}", "{} loc", "pin {}", "{} center", "{} centre", "centre {}",
                "coord {}", "loc {}", "{} pos abs",
            )
        )
        for axis in "xy"
    },
}  # fmt: skip
_COLUMN = {heading: column for column, headings in _HEADINGS.items() for heading in headings}
_PLACEMENT = {"rotation", "rot", "footprint", "package", "val", "value", "angle", "comment", "mid x", "mid y"}


@dataclass(frozen=True)
class Points:
    """The pins a points file names; scales: what its lengths may have to be taken times.

    unsaid: the numbers of those whose side it does not say.
    """

    pins: list[Pin]
    scales: tuple[float, ...]
    unsaid: frozenset[int] = frozenset()


@dataclass(frozen=True)
class _Table:
    """Its columns, the unit of each column of lengths where the headings say it, and what is written above it."""

    rows: list[list[str]]
    columns: dict[str, int]
    unit_mm: dict[str, float]
    above: str


def looks_like_points(name: str, text: str) -> bool:
    """Say whether a file lists test points (and not parts to be placed)."""
    if text[:1] == "{" and '"pins"' in text and "PIN_X" in text[:20_000]:
        return True
    table = _table(text)
    if table is None:
        return False
    return "net" in table.columns or bool(
        re.search(r"test ?point|probe", f"{name}\n{text[:500]}".lower().replace("_", " "))
    )


def read_points(name: str, text: str) -> Points:
    """Read a points file; raise ValueError naming what it lacks."""
    if text[:1] == "{":
        return Points(_flying_probe(name, text), (1.0,))
    table = _table(text)
    if table is None:
        raise ValueError(f"{name} has no table with columns x and y (and name, net, side); add a line of headings")
    said = dict(table.unit_mm)
    whole = _UNIT_IN_WORDS.search(_written_short(table.above)) if not said else None
    unit_mm = _UNIT_MM[whole[1] or whole[2]] if whole else 1.0
    read = [(pin, row) for number, row in enumerate(table.rows) if (pin := _pin(row, table, number, unit_mm))]
    pins = [pin for pin, _ in read]
    unsaid = frozenset(k for k, (_, row) in enumerate(read) if _side(_cell(row, table, "side")) is None)
    if not pins:
        raise ValueError(f"{name} lists no point with numbers in x and y")
    lengths = [table.columns["x"], table.columns["y"]]
    in_cells = any(_UNIT.search(row[k].lower()) for row in table.rows[:3] for k in lengths if k < len(row))
    sure = bool(said or whole or in_cells)
    return Points(pins, (1.0,) if sure else UNSAID_UNITS, unsaid)


def _table(text: str) -> _Table | None:
    """Find the line of headings: the first that has x and y among its columns."""
    lines = text.splitlines()
    for k, line in enumerate(lines[:60]):
        for split in (*_SEPARATED, *_ALIGNED):
            cells = next(iter(split([line])), [])
            columns, unit_mm = _headings(cells)
            if len(cells) < 3 or not {"x", "y"} <= set(columns):
                continue
            placing = {_plain(c) for c in cells} & _PLACEMENT
            if "net" not in columns and placing:
                return None
            rows = split(row for row in lines[k + 1 :] if row.strip())
            if split in _ALIGNED:
                rows = [row for row in rows if len(row) == len(cells)]
                if not any(_length_mm(row[columns["x"]], 1.0) is not None for row in rows):
                    continue  # a sentence, not a table
            return _Table(rows, columns, unit_mm, "\n".join(lines[:k])[-2000:])
    return None


Split = Callable[[Iterable[str]], list[list[str]]]


def _separated(separator: str) -> Split:
    return lambda lines: [[c.strip() for c in row] for row in csv.reader(lines, delimiter=separator)]


def _aligned(gap: str) -> Split:
    return lambda lines: [re.split(gap, line.strip()) for line in lines]


_SEPARATED = tuple(_separated(s) for s in (",", ";", "\t", "|"))
_ALIGNED = tuple(_aligned(gap) for gap in (r"\s{2,}", r"\s+"))
"""Columns with blanks between them; in the first way a cell may hold single ones."""


def _headings(cells: list[str]) -> tuple[dict[str, int], dict[str, float]]:
    columns: dict[str, int] = {}
    unit_mm: dict[str, float] = {}
    for index, cell in enumerate(cells):
        column = _COLUMN.get(_plain(cell))
        if column is None or column in columns:
            continue
        columns[column] = index
        if found := _UNIT.search(_written_short(cell)):
            unit_mm[column] = _UNIT_MM[found[1]]
    return columns, unit_mm


def _plain(heading: str) -> str:
    """Return a heading in small words, without its unit."""
    text = re.sub(r"[^a-zäöüß]+", " ", _written_short(heading)).strip()
    return _UNIT.sub("", text).strip()


def _written_short(heading: str) -> str:
    """Return a heading in small letters, words apart (`PosX`), units short."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", heading).lower()
    for pattern, short in _WRITTEN_OUT:
        text = pattern.sub(short, text)
    return text


def _pin(row: list[str], table: _Table, number: int, unit_mm: float) -> Pin | None:
    def cell(column: str) -> str:
        return _cell(row, table, column)

    def length(column: str) -> float | None:
        return _length_mm(cell(column), table.unit_mm.get(column, table.unit_mm.get("x", unit_mm)))

    x, y = length("x"), length("y")
    if x is None or y is None:
        return None
    part, pin = _name(cell("name"), cell("pin"), number)
    width, height = length("width"), length("height")
    side = _side(cell("side")) or BOTH
    return Pin(
        part=part, pin=pin, net=cell("net"), x_mm=x, y_mm=y, is_via=False, hole_mm=length("hole") or None, access=side,
        covered=NONE, width_mm=width or None, height_mm=height if height is not None else 0.0,
        feature="test_point" if not pin or part.upper().startswith("TP") else "pad",
    )  # fmt: skip


def _cell(row: list[str], table: _Table, column: str) -> str:
    index = table.columns.get(column)
    return row[index].strip() if index is not None and index < len(row) else ""


def _name(name: str, pin: str, number: int) -> tuple[str, str]:
    """Split `J3.2`, `J3-2` or `J3_2` into part and pin; a nameless point is numbered."""
    if pin or not name:
        return name or f"POINT{number + 1}", pin
    found = re.fullmatch(r"([A-Za-z]+\d+)[.\-_:]([A-Za-z]?\d+)", name)
    return (found[1], found[2]) if found else (name, "")


def _side(text: str) -> frozenset[Literal["top", "bottom"]] | None:
    """Return the sides that a word says, None for a word that says none."""
    word = text.lower()
    if re.search(r"both|multi|\*|all|thr", word):
        return BOTH
    if re.search(r"bot|back|b\.cu|solder|^b$|sec|unten|unter|löt", word):
        return BOTTOM
    return TOP if re.search(r"top|front|f\.cu|comp|^t$|^f$|prim|oben|ober|bestückung", word) else None


def _length_mm(text: str, unit_mm: float) -> float | None:
    found = re.fullmatch(r"([-+]?[\d.,]+(?:e[-+]?\d+)?)\s*([a-z\"]*)", text.strip().lower())
    if not found:
        return None
    number = found[1]
    if number.count(",") == 1 and number.rfind(",") > number.rfind("."):
        number = number.replace(".", "").replace(",", ".")
    number = number.replace(",", "")
    try:
        return float(number) * _UNIT_MM.get(found[2], unit_mm)
    except ValueError:
        return None


def _flying_probe(name: str, text: str) -> list[Pin]:
    """Read EasyEDA's `FlyingProbeTesting.json`: fields and rows, mil."""
    try:
        pins = json.loads(text)["pins"]
        rows: list[dict[str, Any]] = [dict(zip(pins["fields"], row, strict=False)) for row in pins["rows"]]
        return [_easyeda_pin(row) for row in rows]
    except (ValueError, KeyError, TypeError, AttributeError) as exc:
        raise ValueError(f"{name} is no flying probe file of EasyEDA; export it again") from exc


def _easyeda_pin(row: dict[str, Any]) -> Pin:
    part, _, pin = str(row.get("PIN_NAME", "")).rpartition("_")
    hole = float(row.get("HOLE_SIZE") or 0.0) * _MIL_MM
    through = hole > 0.0 or str(row.get("PIN_TYPE", "")).upper() in ("DIP", "VIA")
    layer = str(row.get("LAYER", "")).upper()[:1]
    width, height = (float(row.get(k) or 0.0) * _MIL_MM for k in ("PAD_SIZEX", "PAD_SIZEY"))
    round_pad = str(row.get("PAD_SHAPE", "")).upper() in ("ROUND", "CIRCLE", "ELLIPSE") and abs(width - height) < 1e-6
    return Pin(
        part=part or str(row.get("PIN_NAME", "")), pin=pin if part else "", net=str(row.get("NET_NAME") or ""),
        x_mm=float(row["PIN_X"]) * _MIL_MM, y_mm=float(row["PIN_Y"]) * _MIL_MM, is_via=False, hole_mm=hole or None,
        access=BOTH if through else {"T": TOP, "B": BOTTOM}.get(layer, BOTH), covered=NONE,
        width_mm=width or None, height_mm=0.0 if round_pad else height or None,
        feature="pad",
    )  # fmt: skip
