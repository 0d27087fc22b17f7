"""Pads named by Gerber X2 object attributes, for boards that come without a netlist.

gerbonara drops object attributes, so the copper layer's text is walked once more: each flash under `.P` (part, pin)
with its `.N` (net). Both spellings are read, `%TO.P,R1,2*%` and KiCad's comment `G04 #@! TO.P,R1,2*`.
Source: Ucamco, The Gerber Layer Format Specification, object attributes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from sim_hw.board.netlist import Record

_FORMAT = re.compile(r"%FS[LT]?[AI]?X(\d)(\d)Y(\d)(\d)\*%")
_ATTRIBUTE = re.compile(r"T(?P<what>[OD])(?P<name>\.[A-Za-z]+)?(?:,(?P<values>.*))?$")
_FLASH = re.compile(r"(?:X(?P<x>[-+]?\d+))?(?:Y(?P<y>[-+]?\d+))?(?:[IJ][-+]?\d+)*(?P<d>D0?[123])$")
_ESCAPE = re.compile(r"\\u([0-9A-Fa-f]{4})")


@dataclass
class _Pen:
    """What is modal in a Gerber file: where the last operation went, and the attributes in force."""

    x: int = 0
    y: int = 0
    attributes: dict[str, list[str]] = field(default_factory=dict)

    def attribute(self, statement: str) -> None:
        """Take one attribute statement, such as `TO.N,GND` or `TD`."""
        found = _ATTRIBUTE.match(statement)
        if found is None:
            return
        if found["what"] == "D":
            self.attributes = {k: v for k, v in self.attributes.items() if found["name"] not in (None, k)}
        elif found["name"]:
            values = (found["values"] or "").split(",")
            self.attributes[found["name"]] = [_ESCAPE.sub(lambda m: chr(int(m[1], 16)), value) for value in values]


def _statements(text: str) -> Iterator[str]:
    for block in re.split(r"[*%]", text.replace("\r", "").replace("\n", "")):
        if block:
            yield block.removeprefix("G04 #@! ").strip()


def x2_pads(text: str, access_layer: int) -> tuple[Record, ...]:
    """Return the pads a copper layer names, as netlist records reachable on `access_layer` (1 top, 2 bottom)."""
    layout = _FORMAT.search(text)
    if layout is None or "TO.P" not in text:
        return ()
    to_mm = 10.0 ** -int(layout[2]) * (25.4 if "%MOIN" in text else 1.0)
    pen, found = _Pen(), []
    for statement in _statements(text):
        if statement.startswith("T"):
            pen.attribute(statement)
        elif (move := _FLASH.match(statement)) is not None:
            pen.x, pen.y = int(move["x"] or pen.x), int(move["y"] or pen.y)
            if move["d"].endswith("3") and ".P" in pen.attributes:
                found.append(_record(pen, to_mm, access_layer))
    return tuple(found)


def _record(pen: _Pen, to_mm: float, access_layer: int) -> Record:
    part, pin = [*pen.attributes[".P"], ""][:2]
    net = pen.attributes.get(".N", [""])[0]
    return Record(
        net="" if net == "N/C" else net,
        reference=part,
        pin=pin,
        x_mm=pen.x * to_mm,
        y_mm=pen.y * to_mm,
        width_mm=0.0,
        height_mm=0.0,
        hole_mm=None,
        access_layer=access_layer,
        mask=0,
    )
