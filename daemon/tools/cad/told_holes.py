"""Holes that the netlist tells and no drill file has: added, so that nothing takes a hole for metal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daemon.tools.cad.model import Drill, Pin
from daemon.tools.cad.pins import BOTH
from daemon.tools.cad.places import SAME_PLACE_MM


def add_told_holes(drills: Sequence[Drill], pins: Sequence[Pin], source: str) -> tuple[list[Drill], list[str]]:
    """Return the drills and those of the pins that lie in none of them; and what to tell."""
    told = [p for p in pins if p.hole_mm]
    if not told:
        return list(drills), []
    places = np.array([(p.x_mm, p.y_mm) for p in told])
    known = np.zeros(len(told), bool)
    for drill in drills:
        known |= _lies_in(places, drill)
    added: dict[tuple[int, int], Drill] = {}
    for pin, is_known in zip(told, known, strict=True):
        if not is_known and pin.hole_mm:
            key = round(pin.x_mm * 100), round(pin.y_mm * 100)
            added.setdefault(key, Drill(pin.x_mm, pin.y_mm, pin.hole_mm, sides=pin.access or BOTH))
    if not added:
        return list(drills), []
    note = f"{len(added)} holes of {source} are in no drill file, and were taken from {source}; export all drills"
    return [*drills, *added.values()], [note]


def _lies_in(
    places: np.ndarray[tuple[int, ...], np.dtype[np.float64]], drill: Drill
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Say which places lie in a hole or a slot."""
    a = np.array((drill.x_mm, drill.y_mm))
    b = np.array(
        (a[0] if drill.end_x_mm is None else drill.end_x_mm, a[1] if drill.end_y_mm is None else drill.end_y_mm)
    )
    along = np.clip((places - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-12), 0.0, 1.0)
    away = np.hypot(*(places - a - along[:, None] * (b - a)).T)
    found: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = away < max(drill.diameter_mm / 2.0, SAME_PLACE_MM)
    return found
