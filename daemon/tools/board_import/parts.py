"""Parts on the board: their bodies as far as files draw them, else as their pads let one guess; the side each is on.

The drawing for fabrication shows bodies; where there is none a body is taken to reach to the middles of the part's
pads on the surface, and over the whole of its rings on the side that it stands on.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.tools.board_import.frame import Box, Painted, Points, SideCad
from daemon.tools.board_import.raster import Window
from daemon.tools.cad.model import Pin, Side

MOST_PIXELS = 4000
LEAST_BODY_UM = 1500.0
"""A closed drawing larger than this both ways is a body, not a letter."""
INNER_UM = 150.0
"""A pad whose middle lies further inside of the outermost pads' middles lies under the part."""
EDGE_SHARE = 0.9
"""A closed drawing that is this much of the board's size both ways is its edge."""
ARRAY_SHARE = 0.3
"""With this share of its pads inside, a part is a grid of balls or lands, and lies over all of them."""
GUESS_MARGIN_UM = 100.0
ONE_PLACE_UM = 50.0
RING_BODY_MARGIN_UM = 300.0
"""How far a part on pins is taken to reach beyond the middles of its outermost pins' rings."""


@dataclass(frozen=True, slots=True, eq=False)
class PartBody:
    """The outline of one body on this side, um. drawn: a file says it; otherwise it is guessed from the pads."""

    polygon: Points
    part: str | None
    drawn: bool

    @property
    def box(self) -> Box:
        """Its box."""
        (x0, y0), (x1, y1) = self.polygon.min(axis=0), self.polygon.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)


@dataclass(frozen=True)
class Part:
    """One part with more than one pin: where its pins are on this side, and the side it stands on."""

    name: str
    side: Side
    pads: Points
    rings: Points
    middle: tuple[float, float]

    @cached_property
    def is_array(self) -> bool:
        """Whether its pads fill an area, as those of a ball grid do: then the body lies over all of them."""
        if len(self.pads) < 9 or self.side_hull is None:
            return False
        inner = sum(self.depth_um(x, y) > INNER_UM for x, y in self.pads)
        return inner >= ARRAY_SHARE * len(self.pads)

    @cached_property
    def side_hull(self) -> NDArray[np.float32] | None:
        """Corners of the hull of its pads' middles; None where they lie in a row."""
        if len(self.pads) < 3:
            return None
        hull = cv2.convexHull(self.pads.astype(np.float32)).reshape(-1, 2).astype(np.float32)
        return hull if len(hull) >= 3 and cv2.contourArea(hull) > INNER_UM**2 else None

    def depth_um(self, x: float, y: float) -> float:
        """Return how far inside of its outermost pads' middles a place lies; negative outside, 0 for a row."""
        if self.side_hull is None:
            return 0.0
        return float(cv2.pointPolygonTest(self.side_hull, (float(x), float(y)), measureDist=True))

    def outward(self, x: float, y: float, long_axis: tuple[float, float] | None) -> tuple[float, float]:
        """Return the direction from the body to the free end of the pad at a place; long_axis: of the pad, or None.

        It stands across the edge of the part that the pad lies on; at a corner, where two edges meet, along the pad.
        """
        away = np.array((x - self.middle[0], y - self.middle[1]))
        candidates = [away, *self._edge_normals(x, y)]
        if self.side_hull is None and long_axis is not None and len(self.pads) > 2:
            candidates = [away, np.array(long_axis) * np.sign(away @ long_axis or 1.0)]
        units = [c / norm for c in candidates if (norm := float(np.hypot(*c))) > 0.5]
        if not units:
            return 0.0, 0.0
        if long_axis is None or len(self.pads) <= 2:
            best = units[-1] if len(units) == 2 else units[0]
        else:
            best = max(units, key=lambda u: abs(float(u @ np.array(long_axis))))
        return float(best[0]), float(best[1])

    def _edge_normals(self, x: float, y: float) -> list[NDArray[np.float64]]:
        """Return the outward normals of the edges of the hull that a place lies on, each 1 um long."""
        if self.side_hull is None:
            return []
        corners, units, lengths, normals = self._edges
        away = np.array((x, y)) - corners
        along = (away * units).sum(axis=1)
        on = (np.abs((away * normals).sum(axis=1)) < INNER_UM) & (along > -INNER_UM) & (along < lengths + INNER_UM)
        return list(normals[on])

    @cached_property
    def _edges(self) -> tuple[Points, Points, Points, Points]:
        """Return each edge of the hull: its first corner, its direction, its length and its outward normal."""
        hull = np.empty((0, 2)) if self.side_hull is None else self.side_hull.astype(np.float64)
        edges = np.roll(hull, -1, axis=0) - hull
        lengths = np.hypot(edges[:, 0], edges[:, 1])
        units = edges / np.maximum(lengths, 1e-9)[:, None]
        normals = np.column_stack((units[:, 1], -units[:, 0]))
        inwards = ((np.array(self.middle) - hull) * normals).sum(axis=1) > 0
        return hull, units, lengths, np.where(inwards[:, None], -normals, normals)


def closed_drawings(layer: Painted, frame_um: tuple[float, float]) -> list[Points]:
    """Return the outer outlines, filled, of what a layer's lines enclose."""
    if not layer.polygons:
        return []
    low, high = layer.boxes[:, :2].min(axis=0), layer.boxes[:, 2:].max(axis=0)
    pitch = max(25.0, max(*(high - low), *frame_um) / MOST_PIXELS)
    window = Window.over((low[0] - pitch, low[1] - pitch, high[0] + pitch, high[1] + pitch), pitch)
    picture = cv2.morphologyEx(window.paint(layer), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    contours, tree = cv2.findContours(picture, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    if tree is None:
        return []
    # In a two-level tree the fourth entry is the parent, the third the first child: without one nothing is enclosed.
    return [
        window.um(c.reshape(-1, 2))
        for c, links in zip(contours, tree[0], strict=True)
        if links[3] < 0 and (links[2] >= 0 or cv2.contourArea(c) * pitch**2 > LEAST_BODY_UM**2) and len(c) >= 3
    ]


def find_parts(pins: Sequence[Pin], places: Points, side: SideCad, other: SideCad) -> dict[str, Part]:
    """Return the parts with two or more pins; where the netlist numbers none, those at two or more places."""
    members: defaultdict[str, list[int]] = defaultdict(list)
    for i, pin in enumerate(pins):
        if pin.part and not pin.is_via and pin.feature not in ("test_point", "fiducial"):
            members[pin.part].append(i)
    parts = {}
    for name, indices in members.items():
        if len({pins[i].pin or tuple(np.rint(places[i] / ONE_PLACE_UM)) for i in indices}) < 2:
            continue
        surface = [i for i in indices if pins[i].hole_mm is None]
        rings = [i for i in indices if pins[i].hole_mm is not None]
        low, high = places[indices].min(axis=0), places[indices].max(axis=0)
        stands = _stands_on([pins[i] for i in surface], (*low, *high), side, other)
        middle = (low + high) / 2
        parts[name] = Part(name, stands, places[surface], places[rings], (float(middle[0]), float(middle[1])))
    return parts


def _stands_on(surface: Sequence[Pin], box: tuple[float, ...], side: SideCad, other: SideCad) -> Side:
    """Say on which side a part stands: where its pads are, else where more is drawn about it, else on the top."""
    sides = {s for pin in surface for s in pin.access}
    if len(sides) == 1:
        return next(iter(sides))
    width = side.frame.size_um[0]
    here = (box[0] - 1000.0, box[1] - 1000.0, box[2] + 1000.0, box[3] + 1000.0)
    there = (width - here[2], here[1], width - here[0], here[3])
    drawn = {
        s.side: sum(len(layer.within(b)) for layer in (s.fabrication, s.courtyard, s.silk))
        for s, b in ((side, here), (other, there))
    }
    return "bottom" if drawn["bottom"] > 2 * drawn["top"] else "top"


def bodies(side: SideCad, parts: dict[str, Part]) -> list[PartBody]:
    """Return the bodies that stand on this side: drawn ones, and guesses for parts that no drawing covers."""
    here = {name: part for name, part in parts.items() if part.side == side.side}
    drawings = closed_drawings(side.fabrication, side.frame.size_um)
    found = [_named(polygon, here) for polygon in drawings if not _is_edge(polygon, side)]
    drawn = [b for b in found if b is not None]
    covered = {b.part for b in drawn}
    guessed = [_guess(part) for name, part in here.items() if name not in covered]
    return drawn + [b for b in guessed if b is not None]


def _is_edge(polygon: Points, side: SideCad) -> bool:
    """Say whether a drawing is the board's own edge (of one board of a panel), or a frame about it: no body."""
    size = np.ptp(polygon, axis=0)
    boxes = [b for b, dark in zip(side.outline.boxes, side.outline.dark, strict=True) if dark]
    return any(
        (size >= EDGE_SHARE * (b[2:] - b[:2])).all() for b in (*boxes, np.array((0.0, 0.0, *side.frame.size_um)))
    )


def _named(polygon: Points, parts: dict[str, Part]) -> PartBody | None:
    """Say whose body a closed drawing is: the part whose middle lies in it; None for letters and marks."""
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    contour = polygon.astype(np.float32)
    inside = [
        part
        for part in parts.values()
        if low[0] <= part.middle[0] <= high[0]
        and low[1] <= part.middle[1] <= high[1]
        and cv2.pointPolygonTest(contour, part.middle, measureDist=False) >= 0
    ]
    if inside:
        centre = (low + high) / 2
        nearest = min(inside, key=lambda p: float(np.hypot(*(centre - p.middle))))
        return PartBody(polygon, nearest.name, drawn=True)
    return PartBody(polygon, None, drawn=True) if (high - low).min() > LEAST_BODY_UM else None


def _guess(part: Part) -> PartBody | None:
    """Guess a body from where the pins are."""
    if len(part.rings) and len(part.pads) < 2:
        hull = _hull(np.vstack((part.rings, part.pads)))
        return PartBody(_grown(hull, RING_BODY_MARGIN_UM), part.name, drawn=False)
    if len(part.pads) < 2:
        return None
    return PartBody(_grown(_hull(part.pads), GUESS_MARGIN_UM), part.name, drawn=False)


def _hull(points: Points) -> Points:
    hull: NDArray[np.float64] = cv2.convexHull(points.astype(np.float32)).reshape(-1, 2).astype(np.float64)
    return hull


def _grown(polygon: Points, margin: float) -> Points:
    square = np.array([(-margin, -margin), (margin, -margin), (margin, margin), (-margin, margin)])
    return _hull((polygon[:, None] + square[None]).reshape(-1, 2))
