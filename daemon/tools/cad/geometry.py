"""Polygons of pens and pads: circles, capsules, arcs, rings; mm, (N, 2) float64, y up."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

CHORD_ERROR_MM = 0.001
"""How far a chord may lie inside its arc: a twelfth of a pixel at 12 um/px."""


def shifted(points: Points, x: float, y: float) -> Points:
    """Return the points moved."""
    result: Points = points + np.array((x, y))
    return result


def arc_points(cx: float, cy: float, radius: float, start: float, sweep: float) -> Points:
    """Return points along an arc, both ends included; angles in radians, counter-clockwise positive."""
    step = 2.0 * math.acos(max(-1.0, 1.0 - CHORD_ERROR_MM / max(radius, 2.0 * CHORD_ERROR_MM)))
    count = min(max(2, math.ceil(abs(sweep) / step) + 1), 2000)
    angles = start + np.linspace(0.0, sweep, count)
    return np.column_stack((cx + radius * np.cos(angles), cy + radius * np.sin(angles)))


@lru_cache(maxsize=4096)
def disc(diameter_mm: float) -> Points:
    """Return a circle about the origin; shared, not to be written to."""
    points = arc_points(0.0, 0.0, diameter_mm / 2.0, 0.0, 2.0 * math.pi)[:-1]
    points.flags.writeable = False
    return points


@lru_cache(maxsize=4096)
def _both_ends(radius: float) -> Points:
    """Return the pen's half facing right, then the one facing left."""
    right = arc_points(0.0, 0.0, radius, -math.pi / 2.0, math.pi)
    return np.concatenate((right, -right))


def capsule(x1: float, y1: float, x2: float, y2: float, width_mm: float) -> Points:
    """Return what a round pen paints from one point to another."""
    length = math.hypot(x2 - x1, y2 - y1)
    if length < 1e-9:
        return shifted(disc(round(width_mm, 7)), x1, y1)
    c, s = (x2 - x1) / length, (y2 - y1) / length
    points: Points = _both_ends(round(width_mm / 2.0, 7)) @ np.array(((c, s), (-s, c)))
    half = len(points) // 2
    points[:half] += (x2, y2)
    points[half:] += (x1, y1)
    return points


def arc_sweep(p1: tuple[float, float], p2: tuple[float, float], centre: tuple[float, float], *, cw: bool) -> float:
    """Return the angle swept from p1 to p2; the same point twice is a whole turn (multi-quadrant mode)."""
    sweep = math.atan2(p2[1] - centre[1], p2[0] - centre[0]) - math.atan2(p1[1] - centre[1], p1[0] - centre[0])
    sweep %= 2.0 * math.pi
    if sweep < 1e-9 or math.dist(p1, p2) < 1e-9:
        sweep = 2.0 * math.pi
        return -sweep if cw else sweep
    return sweep - 2.0 * math.pi if cw else sweep


def along_arc(p1: tuple[float, float], p2: tuple[float, float], centre: tuple[float, float], *, cw: bool) -> Points:
    """Return points from p1 to p2 about the centre; the first and the last are p1 and p2 themselves."""
    sweep = arc_sweep(p1, p2, centre, cw=cw)
    start = math.atan2(p1[1] - centre[1], p1[0] - centre[0])
    points = arc_points(*centre, math.dist(p1, centre), start, sweep)
    points[0], points[-1] = p1, p2
    return points


def arc_stroke(
    p1: tuple[float, float], p2: tuple[float, float], centre: tuple[float, float], width_mm: float, *, cw: bool
) -> list[Points]:
    """Return what a round pen paints along an arc, in simple polygons: sectors of at most half a turn, and the ends."""
    radius, sweep = math.dist(p1, centre), arc_sweep(p1, p2, centre, cw=cw)
    start = math.atan2(p1[1] - centre[1], p1[0] - centre[0])
    pieces = 2 if abs(sweep) > math.pi * 0.999 else 1
    inner, outer = max(radius - width_mm / 2.0, 0.0), radius + width_mm / 2.0
    found = []
    for k in range(pieces):
        a, d = start + sweep * k / pieces, sweep / pieces
        found.append(np.concatenate((arc_points(*centre, outer, a, d), arc_points(*centre, inner, a, d)[::-1])))
    if math.dist(p1, p2) > 1e-9:
        found += [shifted(disc(round(width_mm, 7)), *end) for end in (p1, p2)]
    return found


def box_hull(half: Points, a: tuple[float, float], b: tuple[float, float]) -> Points:
    """Return the convex hull of a convex pad at two places: what a pen of that shape paints on a straight line."""
    return convex_hull(np.concatenate((shifted(half, *a), shifted(half, *b))))


def convex_hull(points: Points) -> Points:
    """Return the convex hull, counter-clockwise (Andrew's monotone chain)."""
    rows = sorted({(float(x), float(y)) for x, y in points})
    if len(rows) < 3:
        return np.array(rows)

    def chain(run: list[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for p in run:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], p) <= 0.0:
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return np.array(chain(rows) + chain(rows[::-1]))


def _turn(o: tuple[float, float], a: tuple[float, float], b: tuple[float, float]) -> float:
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def with_round_hole(outer: Points, diameter_mm: float) -> list[Points]:
    """Cut a round hole about the origin out of a convex polygon: two simple polygons, the hole shows what is below."""
    halves = []
    for sign in (1.0, -1.0):
        rim = _half_plane(outer * sign)
        inner = arc_points(0.0, 0.0, diameter_mm / 2.0, math.pi, -math.pi)
        if len(rim) < 3:
            continue
        halves.append(np.concatenate((rim, inner)) * sign)
    return halves


def _half_plane(polygon: Points) -> Points:
    """Return the part of a convex polygon with y >= 0, from its right crossing counter-clockwise to its left one."""
    kept = []
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if ay >= 0:
            kept.append((ax, ay))
        if (ay < 0) != (by < 0):
            kept.append((ax + (bx - ax) * ay / (ay - by), 0.0))
    points = np.array(kept)
    if not len(points):
        return np.empty((0, 2))
    order = np.argsort(np.arctan2(points[:, 1], points[:, 0]), kind="stable")
    return points[order]


def area(points: Points) -> float:
    """Return the signed area of a polygon, mm2; counter-clockwise positive."""
    x, y = points[:, 0], points[:, 1]
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2.0


def inside(points: Points, polygon: Points) -> NDArray[np.bool_]:
    """Say which of the points (M, 2) lie in the polygon (N, 2); even-odd."""
    (px, py), hit = points.T, np.zeros(len(points), bool)
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if ay != by:
            crosses = (ay > py) != (by > py)
            hit ^= crosses & (px < ax + (py - ay) * (bx - ax) / (by - ay))
    return hit
