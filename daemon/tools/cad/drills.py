"""Drills of a board: the reading of each drill file that makes its hits meet the copper's pads.

Excellon files often do not say their unit, digits or zeros, and sometimes say them wrongly. What they say is tried
first; the copper decides.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from scipy.spatial import KDTree

from daemon.tools.cad.excellon import DrillFile, DrillFormat, RawArc, RawHit, Tool
from daemon.tools.cad.geometry import along_arc
from daemon.tools.cad.gerber import GerberLayer
from daemon.tools.cad.model import Drill, Shape
from daemon.tools.cad.places import Places, likely_shifts, share_met, tree_of

_DIGITS = {
    "mm": ((3, 3), (3, 2), (4, 2), (4, 4), (4, 3), (3, 5), (5, 3)),
    "inch": ((2, 4), (2, 5), (2, 3), (3, 5), (1, 6)),
}
_ZEROS = ("trailing", "leading")
_SMALLEST_MM, _LARGEST_MM = 0.04, 30.0


@dataclass(frozen=True)
class Copper:
    """What drills must meet: pads of both sides, their tree, and the box of all copper (x0, y0, x1, y1)."""

    pads: Places
    tree: KDTree | None
    box: tuple[float, float, float, float]


def readings(said: DrillFormat) -> Iterator[DrillFormat]:
    """Yield complete formats: first what agrees with the file's own words, then the others."""
    seen: set[DrillFormat] = set()
    for reading in (*_completed(said), *_completed(DrillFormat())):
        whole = replace(said, unit=reading.unit) if said.has_points else reading
        if whole not in seen:
            seen.add(whole)
            yield whole


def _completed(said: DrillFormat) -> Iterator[DrillFormat]:
    """Fill in what is not said, in every usual way."""
    for unit in (said.unit,) if said.unit else ("mm", "inch"):
        for integers, decimals in ((said.integers, said.decimals),) if said.decimals is not None else _DIGITS[unit]:
            for zeros in (said.zeros_kept,) if said.zeros_kept else _ZEROS:
                yield DrillFormat(unit, integers, decimals, zeros)


def decide_format(file: DrillFile, copper: Copper) -> tuple[DrillFormat, float]:
    """Return the reading whose hits meet most pads, and their share; what the file says wins unless it fails."""
    best, best_share = None, -1.0
    hits = file.hits[:: max(1, len(file.hits) // 400)]
    for reading in readings(file.said):
        places = raw_places(hits, reading)
        if not _within(places, copper.box):
            continue
        share = share_met(places, copper.tree)
        if best is None or share > best_share + 0.1:
            best, best_share = reading, share
    if best is None:
        return next(readings(file.said)), 0.0
    return best, best_share


def _within(places: Places, box: tuple[float, float, float, float]) -> bool:
    """Say whether the hits have the board's size: a reading ten times too large or small is none."""
    if not len(places):
        return True
    size, board = np.ptp(places, axis=0).max(), max(box[2] - box[0], box[3] - box[1])
    middle = np.median(places, axis=0)
    away = max(abs(middle[0] - (box[0] + box[2]) / 2), abs(middle[1] - (box[1] + box[3]) / 2))
    return bool(size <= 1.6 * board + 5.0 and away <= 2.5 * board + 50.0)


def raw_places(hits: Iterable[RawHit], reading: DrillFormat) -> Places:
    """Return the hits' (and slots' starts') places (N, 2), mm."""
    return np.array([(reading.length_mm(h.x), reading.length_mm(h.y)) for h in hits], float).reshape(-1, 2)


def drills_of(file: DrillFile, reading: DrillFormat, *, plated: bool | None) -> tuple[list[Drill], list[int]]:
    """Return the drills of a file in mm, and the tools whose diameter nobody says."""
    unit_mm = _tool_unit_mm(file.tools.values(), reading)
    found: list[Drill] = []
    nameless: set[int] = set()
    for hit in file.hits:
        tool = file.tools.get(hit.tool)
        if tool is None or not tool.diameter:
            nameless.add(hit.tool)
            continue
        ends: tuple[float | None, float | None] = (None, None)
        if hit.end_x is not None and hit.end_y is not None and (hit.end_x, hit.end_y) != (hit.x, hit.y):
            ends = (reading.length_mm(hit.end_x), reading.length_mm(hit.end_y))
        own = tool.plated if tool.plated is not None else plated
        drill = Drill(
            reading.length_mm(hit.x), reading.length_mm(hit.y), tool.diameter * (tool.unit_mm or unit_mm), *ends,
            plated=own, capped=tool.capped,
        )  # fmt: skip
        found += _along_arc(drill, hit.arc, reading) if hit.arc is not None else [drill]
    return found, sorted(nameless)


def _along_arc(drill: Drill, arc: RawArc, reading: DrillFormat) -> list[Drill]:
    """Return an arc's chords as slots; a whole circle leaves nothing in its middle."""
    here = (drill.x_mm, drill.y_mm)
    there = (
        here[0] if drill.end_x_mm is None else drill.end_x_mm,
        here[1] if drill.end_y_mm is None else drill.end_y_mm,
    )
    if arc.radius:
        centre = _arc_centre(here, there, reading.length_mm(arc.radius), clockwise=arc.clockwise)
    else:
        centre = (here[0] + reading.length_mm(arc.i or "0"), here[1] + reading.length_mm(arc.j or "0"))
    if here == there:
        return [
            replace(drill, x_mm=centre[0], y_mm=centre[1], diameter_mm=drill.diameter_mm + 2 * math.dist(here, centre))
        ]
    points = along_arc(here, there, centre, cw=arc.clockwise).tolist()
    return [replace(drill, x_mm=x, y_mm=y, end_x_mm=u, end_y_mm=v) for (x, y), (u, v) in pairwise(points)]


def _arc_centre(
    here: tuple[float, float], there: tuple[float, float], radius_mm: float, *, clockwise: bool
) -> tuple[float, float]:
    """Return the middle of the shorter arc of a radius from one place to another."""
    dx, dy = there[0] - here[0], there[1] - here[1]
    length = max(math.hypot(dx, dy), 1e-9)
    up = math.sqrt(max(radius_mm**2 - length**2 / 4.0, 0.0)) * (-1.0 if clockwise else 1.0)
    return (here[0] + there[0]) / 2.0 - dy / length * up, (here[1] + there[1]) / 2.0 + dx / length * up


def _tool_unit_mm(tools: Iterable[Tool], reading: DrillFormat) -> float:
    """Return the unit of the diameters: the coordinates' own, unless no drill could be as large or small."""
    sizes = [t.diameter for t in tools if t.diameter and t.unit_mm is None]
    for unit_mm in (reading.unit_mm, 1.0, 25.4, 0.0254):
        if sizes and min(sizes) * unit_mm >= _SMALLEST_MM and max(sizes) * unit_mm <= _LARGEST_MM:
            return unit_mm
    return reading.unit_mm


def drills_of_gerber(layer: GerberLayer, *, plated: bool | None) -> list[Drill]:
    """Return the drills of a drill file that is written in Gerber: flashed discs and slots, and what a pen draws."""
    flashed = [s for s in layer.shapes if s.flashed and s.dark]
    found = [Drill(*s.round_mm, plated=plated) if s.round_mm else _flashed_slot(s, plated=plated) for s in flashed]
    for path in layer.paths:
        if path.width_mm > _SMALLEST_MM:
            for (ax, ay), (bx, by) in zip(path.points[:-1], path.points[1:], strict=True):
                found.append(Drill(float(ax), float(ay), path.width_mm, float(bx), float(by), plated=plated))
    return found


def _flashed_slot(shape: Shape, *, plated: bool | None) -> Drill:
    """Return the slot that fills the narrowest box round a flashed shape, however it is turned."""
    (x, y), (width, height), turn_deg = cv2.minAreaRect(shape.points_mm.astype(np.float32))
    turn = math.radians(turn_deg if width >= height else turn_deg + 90.0)
    half = abs(width - height) / 2.0
    dx, dy = half * math.cos(turn), half * math.sin(turn)
    return Drill(x - dx, y - dy, min(width, height), x + dx, y + dy, plated=plated)


def displacement_mm(drills: list[Drill], copper: Copper) -> tuple[float, float] | None:
    """Return how far drills lie from the pads they belong to; None where they meet them, or nothing tells."""
    meant = [d for d in drills if d.plated is not False and d.sides]  # others have no pad outside
    places = np.array([(d.x_mm, d.y_mm) for d in meant if d.end_x_mm is None], float).reshape(-1, 2)
    if len(places) < 4 or copper.tree is None:
        return None
    here = share_met(places, copper.tree)
    if here > 0.9:
        return None
    shifts = likely_shifts([(places, copper.pads)])
    best = max(shifts, key=lambda s: share_met(places + s, copper.tree))
    there = share_met(places + best, copper.tree)
    if there < 0.6 or there < here * 1.25 + 0.05:
        return None
    return -best[0] + 0.0, -best[1] + 0.0


def make_copper(pads: Places, box: tuple[float, float, float, float]) -> Copper:
    """Return the copper that drills are held against."""
    return Copper(pads, tree_of(pads), box)
