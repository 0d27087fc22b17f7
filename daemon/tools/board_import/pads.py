"""Bare metal of each pin: what shows of its pad through the mask, less the hole, as a small picture.

The openings of the mask are sorted into clusters on a coarse picture of the whole side; only clusters that hold a pin
are drawn finely. A pad in a large opening, an exposed plane, is cut to a window about its pin.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.tools.board_import.frame import Box, Hole, Points, SideCad
from daemon.tools.board_import.place_index import SAME_PLACE_UM, PlaceIndex
from daemon.tools.board_import.raster import Picture, Window

COARSE_PIXELS, COARSE_UM = 2500, 20.0
FINE_UM, FINEST_UM, PIXELS_ACROSS = 6.0, 2.0, 120
"""Largest and smallest pitch of a window; between them so many pixels lie across an opening."""
LARGEST_UM = 8000.0
"""An opening longer than this is not drawn whole, but about each of its pins."""
HALF_WINDOW_UM, HALF_DRILLED_UM = 2500.0, 1500.0
ABOUT_VIA_UM = 500.0
"""A via in a large bare surface is touched within this distance of its hole."""
CROP_UM = 150.0
LIKE_SIZE = math.log(1.6)
"""A pad is taken for the one that a pin tells of up to this ratio of their areas: corners may be cut or round."""
BESIDE_HOLE_UM = 100.0
"""Metal of a pin whose middle is a hole begins no farther from the hole than this."""


_AROUND = np.cos(np.arange(24) * np.pi / 12), np.sin(np.arange(24) * np.pi / 12)


@dataclass(frozen=True, slots=True, eq=False)
class Pad:
    """The bare metal of one place.

    metal: 1 where it is bare; others: bare metal of other pads in the same window; groups: all that share its metal.
    """

    index: int
    x: float
    y: float
    window: Window
    metal: Picture
    others: Picture
    hole: Hole | None
    groups: frozenset[str]


class Openings:
    """The openings of one side's mask, sorted into clusters that do not touch."""

    def __init__(self, side: SideCad) -> None:
        self._side = side
        boxes = side.mask.boxes
        width, height = side.frame.size_um
        low = np.minimum((0.0, 0.0), boxes[:, :2].min(axis=0, initial=0.0))
        high = np.maximum((width, height), boxes[:, 2:].max(axis=0, initial=0.0))
        pitch = max(COARSE_UM, float((high - low).max()) / COARSE_PIXELS)
        self._window = Window.over((low[0] - pitch, low[1] - pitch, high[0] + pitch, high[1] + pitch), pitch)
        picture = self._window.paint(side.mask)
        _, self._labels, self._stats, _ = cv2.connectedComponentsWithStats(picture, connectivity=8)

    def at(self, x: float, y: float) -> int:
        """Return the number of the cluster at a place; 0: mask."""
        where = self._window.at(x, y)
        return int(self._labels[where]) if where is not None else 0

    def box(self, cluster: int) -> Box:
        """Return the box of a cluster, um."""
        column, row, columns, rows = (int(v) for v in self._stats[cluster][:4])
        pitch, x0, y0 = self._window.pitch, self._window.x0, self._window.y0
        return x0 + column * pitch, y0 + row * pitch, x0 + (column + columns) * pitch, y0 + (row + rows) * pitch


class HoleFinder:
    """The hole at a place."""

    def __init__(self, side: SideCad) -> None:
        self._holes = side.holes
        self._index = PlaceIndex(((h.x + h.end_x) / 2, (h.y + h.end_y) / 2) for h in side.holes)

    def at(self, x: float, y: float) -> Hole | None:
        """Return the largest hole in whose middle a place lies."""
        return max((self._holes[i] for i in self._index.at(x, y)), key=lambda h: h.diameter, default=None)


def windows(
    openings: Openings, holes: HoleFinder, places: Points, chosen: Sequence[int]
) -> Iterator[tuple[Window, list[int]]]:
    """Yield windows over bare places, each with the places (indices into `places`, out of `chosen`) that lie in it."""
    clusters: defaultdict[int, list[int]] = defaultdict(list)
    for i in chosen:
        cluster = openings.at(*places[i])
        if cluster:
            clusters[cluster].append(i)
    for cluster, members in clusters.items():
        x0, y0, x1, y1 = openings.box(cluster)
        longest = max(x1 - x0, y1 - y0)
        if longest <= LARGEST_UM:
            yield Window.over((x0, y0, x1, y1), min(FINE_UM, max(FINEST_UM, longest / PIXELS_ACROSS))), members
            continue
        for i in members:
            x, y = places[i]
            half = HALF_WINDOW_UM if holes.at(x, y) is None else HALF_DRILLED_UM
            box = (max(x0, x - half), max(y0, y - half), min(x1, x + half), min(y1, y + half))
            yield Window.over(box, FINE_UM), [i]


def bare_pads(
    side: SideCad, openings: Openings, holes: HoleFinder, places: Points, chosen: Sequence[int], groups: Sequence[str],
    sizes: Sequence[float | None] = (),
) -> Iterator[Pad]:  # fmt: skip
    """Yield the bare metal of each chosen place that has some; groups: what tells the places' pads apart, as names.

    Places in one piece of metal share it where they are of one group; where not, each has what its own pad painted.
    sizes: area of each place's pad as its pin tells, um2: of several pads over one another the one that fits is meant.
    """
    for window, members in windows(openings, holes, places, chosen):
        metal = window.bare_metal(side)
        labels, boxes, found = _pieces(metal, window, holes, places, members)
        sharing: defaultdict[int, set[str]] = defaultdict(set)
        for i, (label, _) in found.items():
            sharing[label].add(groups[i])
        for i, (label, hole) in found.items():
            x, y = (float(v) for v in places[i])
            limit = _limit(
                side, x, y, hole, sizes[i] if sizes else None, alone=len(sharing[label]) == 1, few=len(members) == 1
            )
            piece = boxes[label] if limit is None else _meet(window, boxes[label], limit)
            if piece is None:
                continue
            cut, near = _cut(window, piece)
            mine = (labels[cut] == label).astype(np.uint8)
            if limit is not None:
                own = near.blank()
                near.fill(own, limit, 1)
                mine &= own
            if mine.any():
                others = (metal[cut] & ~mine & 1).astype(np.uint8)
                yield Pad(i, x, y, near, mine, others, hole, frozenset(sharing[label]))


def _pieces(
    metal: Picture, window: Window, holes: HoleFinder, places: Points, members: Sequence[int]
) -> tuple[NDArray[np.int32], dict[int, NDArray[np.int_]], dict[int, tuple[int, Hole | None]]]:
    """Mark the pieces of metal that places lie on with numbers from 2 on; what else is metal stays 1.

    Returns the marked picture; each piece's box: column, row, columns, rows; and each place's piece and hole.
    """
    labels: NDArray[np.int32] = metal.astype(np.int32)
    boxes: dict[int, NDArray[np.int_]] = {}
    found: dict[int, tuple[int, Hole | None]] = {}
    for i in members:
        x, y = (float(v) for v in places[i])
        hole = holes.at(x, y)
        seed = _metal_at(labels, window, x, y, hole)
        if seed is None:
            continue
        if labels[seed] == 1:
            box = cv2.floodFill(labels, None, (seed[1], seed[0]), len(boxes) + 2)[3]
            boxes[len(boxes) + 2] = np.array(box)
        found[i] = int(labels[seed]), hole
    return labels, boxes, found


def _limit(
    side: SideCad, x: float, y: float, hole: Hole | None, size: float | None, *, alone: bool, few: bool
) -> Points | None:
    """Return the polygon to which a pad is cut out of the metal that it is one piece with; None: it is all of it."""
    if not alone:
        return _own_copper(side, x, y, size)
    if few or hole is None:
        return None
    turns = np.arange(48) * (np.pi / 24)
    return np.array((x, y)) + (hole.diameter / 2 + ABOUT_VIA_UM) * np.column_stack((np.cos(turns), np.sin(turns)))


def _meet(window: Window, box: NDArray[Any], polygon: Points) -> NDArray[np.int_] | None:
    """Return what a box (column, row, columns, rows) and a polygon's box have in common; None: nothing."""
    low = np.maximum(np.floor(window.pixels(polygon.min(axis=0))).astype(int), box[:2])
    high = np.minimum(np.ceil(window.pixels(polygon.max(axis=0))).astype(int) + 1, box[:2] + box[2:4])
    return np.concatenate((low, high - low)) if (high > low).all() else None


def _cut(window: Window, box: NDArray[Any]) -> tuple[tuple[slice, slice], Window]:
    """Return the part of a window that holds a piece of metal and a margin; the less, the faster all that follows."""
    margin = int(CROP_UM / window.pitch)
    column, row, columns, rows = (int(v) for v in box[:4])
    left, top = max(0, column - margin), max(0, row - margin)
    right, bottom = min(window.columns, column + columns + margin), min(window.rows, row + rows + margin)
    x0, y0 = window.x0 + left * window.pitch, window.y0 + top * window.pitch
    return (slice(top, bottom), slice(left, right)), Window(x0, y0, right - left, bottom - top, window.pitch)


def _metal_at(
    labels: NDArray[np.int32], window: Window, x: float, y: float, hole: Hole | None
) -> tuple[int, int] | None:
    """Return row and column of metal at a place, or nearest to it about its hole; None: there is none."""
    where = window.at(x, y)
    if where is not None and labels[where]:
        return where
    inner, reach = 0.0, SAME_PLACE_UM
    if hole is not None and not hole.filled:
        inner = hole.diameter / 2
        reach = inner + BESIDE_HOLE_UM + max(abs(hole.end_x - hole.x), abs(hole.end_y - hole.y)) / 2
    radii = np.arange(inner + window.pitch, reach + window.pitch, 2 * window.pitch)[:, None]
    columns = ((x + radii * _AROUND[0] - window.x0) / window.pitch).astype(int).clip(0, window.columns - 1)
    rows = ((y + radii * _AROUND[1] - window.y0) / window.pitch).astype(int).clip(0, window.rows - 1)
    first = np.flatnonzero(labels[rows, columns])
    return (int(rows.flat[first[0]]), int(columns.flat[first[0]])) if len(first) else None


def _own_copper(side: SideCad, x: float, y: float, size: float | None) -> Points:
    """Return the copper that was drawn over a place as its pad: without what it touches, and no via in it.

    It is the flash whose area is nearest to `size`, um2; not knowing it, the smallest flash; without flashes alike.
    """
    copper = side.copper
    containing = [
        i
        for i in copper.within((x, y, x, y))
        if copper.dark[i]
        and cv2.pointPolygonTest(copper.polygons[i].astype(np.float32), (x, y), measureDist=False) >= 0
    ]
    if not containing:
        return np.array(((x, y), (x, y), (x, y)))
    areas = [cv2.contourArea(copper.polygons[i].astype(np.float32)) for i in containing]
    off = [abs(math.log(max(a, 1.0) / size)) if size else 0.0 for a in areas]
    other = [size is not None and o > LIKE_SIZE for o in off]
    flashed = [copper.shapes[i].flashed for i in containing]
    order = zip(other, (not f for f in flashed), off if size else areas, areas, containing, strict=True)
    polygon: Points = copper.polygons[min(order)[-1]]
    return polygon
