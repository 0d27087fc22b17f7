"""Board outline: pen strokes and regions chained into closed polygons, the edge told from frames and cut-outs."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from daemon.tools.cad.geometry import Points, area, inside
from daemon.tools.cad.gerber_paint import Path
from daemon.tools.cad.model import Shape
from daemon.tools.cad.places import Places

_JOIN_MM = (0.002, 0.05, 0.3)
"""Ends this near are one corner: exact ends first, then sloppy ones."""
_SMALLEST_MM2 = 0.5
ALL_PADS, MOST_PADS = 0.97, 0.8
"""Share of the pads that an edge holds: some stand over it; targets and coupons for the maker lie outside."""
Box = tuple[float, float, float, float]


def closed_polygons(paths: Iterable[Path]) -> list[Points]:
    """Chain strokes end to end into closed polygons; what stays open is dropped."""
    open_ways = [p.points for p in paths if len(p.points) > 1]
    closed: list[Points] = []
    for reach_mm in _JOIN_MM:
        open_ways, found = _chain(open_ways, reach_mm)
        closed += found
    return [p for p in closed if len(p) > 2 and abs(area(p)) > _SMALLEST_MM2]


def _chain(ways: list[Points], reach_mm: float) -> tuple[list[Points], list[Points]]:
    """Join ways whose ends meet; return those still open and the closed."""
    ends = _Ends(ways, reach_mm)
    still_open, closed = [], []
    for k in range(len(ways)):
        if not ends.take(k):
            continue
        chain = [ways[k]]
        for _ in range(2):  # from the end, then from the start
            while not _is_closed(chain, reach_mm) and (way := ends.following(chain[-1][-1])) is not None:
                chain.append(way)
            chain = [w[::-1] for w in chain[::-1]]
        whole = np.concatenate([chain[0], *(w[1:] for w in chain[1:])])
        if _is_closed(chain, reach_mm) and len(whole) > 3:
            closed.append(whole[:-1])
        else:
            still_open.append(whole)
    return still_open, closed


def _is_closed(chain: list[Points], reach_mm: float) -> bool:
    return (len(chain) > 1 or len(chain[0]) > 2) and math.dist(chain[0][0], chain[-1][-1]) <= reach_mm


class _Ends:
    """The ends of ways, looked up by cell."""

    def __init__(self, ways: list[Points], reach_mm: float) -> None:
        self._ways, self._reach_mm = ways, reach_mm
        self._free = set(range(len(ways)))
        self._cells: dict[tuple[int, int], set[int]] = {}
        for k, way in enumerate(ways):
            for end in (way[0], way[-1]):
                self._cells.setdefault(self._cell(end), set()).add(k)

    def _cell(self, point: Points) -> tuple[int, int]:
        return round(float(point[0]) / self._reach_mm), round(float(point[1]) / self._reach_mm)

    def take(self, k: int) -> bool:
        """Take a way out; False if it is gone."""
        there = k in self._free
        self._free.discard(k)
        return there

    def following(self, tail: Points) -> Points | None:
        """Take out the way that begins (or ends) nearest to the tail, turned to begin there."""
        i, j = self._cell(tail)
        near = {k for a in (i - 1, i, i + 1) for b in (j - 1, j, j + 1) for k in self._cells.get((a, b), ())}
        gaps = [
            (math.dist(tail, way[0]), math.dist(tail, way[-1]), k)
            for k in near & self._free
            for way in (self._ways[k],)
        ]
        best = min(gaps, key=lambda g: min(g[0], g[1]), default=None)
        if best is None or min(best[0], best[1]) > self._reach_mm:
            return None
        self._free.discard(best[2])
        way = self._ways[best[2]]
        return way if best[0] <= best[1] else way[::-1]


def board_edges(polygons: list[Points], pads: Places) -> tuple[Shape, ...]:
    """Return the edge (or the edges of a panel's boards) and its cut-outs; () where no polygon holds the pads.

    The edge is the smallest polygon that holds all pads, or else most: a frame is larger, a cut-out holds none.
    """
    if not polygons or not len(pads):
        return tuple(Shape(p) for p in _outermost(polygons))
    held = [int(inside(pads, p).sum()) for p in polygons]
    whole = [k for k, n in enumerate(held) if n >= ALL_PADS * len(pads)]
    whole = whole or [k for k, n in enumerate(held) if n >= MOST_PADS * len(pads)]
    if whole:
        edges = [min(whole, key=lambda k: abs(area(polygons[k])))]
    else:
        outer = _outermost(polygons)
        edges = [k for k, p in enumerate(polygons) if any(p is q for q in outer) and held[k]]
        if sum(held[k] for k in edges) < MOST_PADS * len(pads):
            return ()
    cut = [
        polygons[k] for k in range(len(polygons))
        if k not in edges and any(_holds(polygons[e], polygons[k]) for e in edges) and held[k] <= 0.05 * len(pads)
    ]  # fmt: skip
    return (*(Shape(polygons[k]) for k in edges), *(Shape(p, dark=False) for p in _outermost(cut)))


def _outermost(polygons: list[Points]) -> list[Points]:
    found: list[Points] = []
    for polygon in sorted(polygons, key=lambda p: -abs(area(p))):
        if not any(_holds(outer, polygon) for outer in found):
            found.append(polygon)
    return found


def _holds(outer: Points, inner: Points) -> bool:
    """Say whether a polygon lies in another one, or is the same drawn again."""
    if abs(area(inner)) > abs(area(outer)) + 1e-9:
        return False
    sample = inner[:: max(1, len(inner) // 16)]
    middle = sample.mean(axis=0)
    shrunk = middle + (sample - middle) * 0.98
    return bool(inside(shrunk, outer).mean() > 0.9)


def box_of(points: Iterable[Points]) -> Box | None:
    """Return the box (x0, y0, x1, y1) round polygons."""
    lows_highs = [(p.min(axis=0), p.max(axis=0)) for p in points if len(p)]
    if not lows_highs:
        return None
    low = np.min([a for a, _ in lows_highs], axis=0)
    high = np.max([b for _, b in lows_highs], axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def box_shape(box: Box) -> Shape:
    """Return a box as an outline."""
    x0, y0, x1, y1 = box
    return Shape(np.array(((x0, y0), (x1, y0), (x1, y1), (x0, y1))))
