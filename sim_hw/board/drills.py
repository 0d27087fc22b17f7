"""Drill files: hits, slots in every spelling, and whether the holes were filled and capped.

gerbonara reads Excellon; what stops it is said in other words first: slots in the G85 notation (KiCad, Eagle, Altium:
with or without spaces, with coordinates left out that did not change) become routed lines.
Source: Excellon drill and rout commands, G85 "cut slotted hole", G00/M15/G01/M16 rout mode.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gerbonara import ExcellonFile, GerberFile
from gerbonara.cam import FileSettings
from gerbonara.utils import MM, Inch

_COORDINATE = r"[-+]?\d*\.?\d*"
_SLOT = re.compile(
    rf"^\s*(?:X(?P<x1>{_COORDINATE}))?\s*(?:Y(?P<y1>{_COORDINATE}))?\s*G85\s*"
    rf"(?:X(?P<x2>{_COORDINATE}))?\s*(?:Y(?P<y2>{_COORDINATE}))?\s*$",
    re.IGNORECASE,
)
_HIT = re.compile(rf"^\s*(?:G0?[0-35])?\s*(?:X(?P<x>{_COORDINATE}))?\s*(?:Y(?P<y>{_COORDINATE}))?", re.IGNORECASE)
_CAPPED = re.compile(r"TA\.AperFunction,Plated,PTH,ViaDrill,VII\s*$", re.MULTILINE)


@dataclass(frozen=True)
class DrillFormat:
    """How a drill file writes numbers, where it does not say so itself.

    unit: `mm` or `inch`. zeros_kept: `leading`, `trailing`, `all`, or None where numbers have decimal points.
    """

    unit: str
    integers: int | None
    decimals: int | None
    zeros_kept: str | None

    def settings(self) -> FileSettings:
        """Return the same in gerbonara's words, which name the zeros left out."""
        left_out = {"leading": "trailing", "trailing": "leading", "all": "leading"}.get(self.zeros_kept or "")
        digits = (None, None) if self.decimals is None else (self.integers, self.decimals)
        return FileSettings(unit=Inch if self.unit == "inch" else MM, zeros=left_out, number_format=digits)


def is_drill_text(text: str) -> bool:
    """Tell whether a text looks like a drill file (Excellon, or X2 Gerber of drills)."""
    return "M48" in text or "%FS" in text or re.search(r"^T\d+C", text, re.MULTILINE) is not None


def is_capped(text: str) -> bool:
    """Tell whether a drill file says that its holes were filled and capped (IPC-4761 type VII)."""
    return _CAPPED.search(text) is not None


def open_drills(path: Path, written: DrillFormat | None = None) -> list[Any]:
    """Return a drill file's hits and slots as gerbonara objects; `written` is how it writes numbers, where known.

    Raises:
        Exception: whatever gerbonara raises for what it cannot read.

    """
    text = path.read_text(errors="replace")
    if "%FS" in text:
        return list(GerberFile.open(path).objects)
    settings = None if written is None or written.zeros_kept is None else written.settings()
    plain = routed(text) if "G85" in text.upper() else text
    if settings is None and plain is text:
        return list(ExcellonFile.open(path).objects)
    return list(ExcellonFile.from_string(plain, settings=settings, filename=path).objects)


def routed(text: str) -> str:
    """Return a drill file's text with its G85 slots as routed lines."""
    x, y, lines = "0", "0", []
    for line in text.splitlines():
        slot = _SLOT.match(line)
        if slot is None:
            hit = _HIT.match(line)
            if hit is not None:
                x, y = hit["x"] or x, hit["y"] or y
            lines.append(line)
            continue
        x, y = slot["x1"] or x, slot["y1"] or y
        lines += [f"G00X{x}Y{y}", "M15"]
        x, y = slot["x2"] or x, slot["y2"] or y
        lines += [f"G01X{x}Y{y}", "M16", "G05"]
    return "\n".join([*lines, ""])
