"""Drill sizes from a report beside the drill file: tool number, size, unit, as people read them.

EAGLE's `.dri`, the `.rep`, `.lst` and `.tol` of others: lines such as `T1 0.0300 13`, ` T01 0.0240inch 14`,
`1 0.450 mm 1`, `T3 39mil (1mm) Round 5 PTH`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from daemon.tools.cad.excellon import DrillFile, Tool
from daemon.tools.cad.folder import CadFile

_LINE = re.compile(r"^\W*T?0*(\d{1,3})\s*[:=|,;\t ]\s*([\d.]+)\s*(mm|mils?|inch(?:es)?|in\b|\")?", re.IGNORECASE)
_UNIT_MM = {"mm": 1.0, "mil": 0.0254, "mils": 0.0254, "in": 25.4, "inch": 25.4, "inches": 25.4, '"': 25.4}
_HEADING = re.compile(r"\b(mm|mils?|inch(?:es)?)\b", re.IGNORECASE)


def add_tool_sizes(file: DrillFile, reports: Iterable[CadFile]) -> str | None:
    """Give sizes to tools that have none; return the report's name, None if no report names them all."""
    nameless = {h.tool for h in file.hits} - {n for n, t in file.tools.items() if t.diameter}
    if not nameless:
        return None
    for report in reports:
        sizes = _sizes(report.text[:50_000])
        if nameless <= set(sizes):
            for number in nameless:
                file.tools[number] = Tool(*sizes[number])
            return report.name
    return None


def _sizes(text: str) -> dict[int, tuple[float, float | None]]:
    """Return tool -> (size, unit in mm or None where the report does not say it)."""
    heading = _HEADING.search(text)
    usual = _UNIT_MM[heading[1].lower()] if heading else None
    found: dict[int, tuple[float, float | None]] = {}
    for line in text.splitlines():
        if row := _LINE.match(line):
            try:
                found.setdefault(int(row[1]), (float(row[2]), _UNIT_MM[row[3].lower()] if row[3] else usual))
            except ValueError:
                continue
    return found
