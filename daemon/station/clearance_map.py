"""Clearance map of a board: how high what stands on it and about it rises above its surface, as its file tells. Pure.

Of a part whose height nobody told, of what is beside the board, and of what may stick through a large hole nothing is
known: it counts as endlessly high. So does every place of a board whose file has no layers, or tells of no parts while
nobody said that none are fitted. Places are um in the board frame.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from daemon.config.sections.motion import ClearanceSection
from daemon.domain.board import Board, BoardPoint
from daemon.domain.board_layers import SideShapes, as_points
from daemon.station.board_obstacles import hole_outline
from daemon.station.outline_distance import Outlines, boxes_of, holds, near
from vision.geometry import Array

UNKNOWN = math.inf
LARGE_HOLE_UM = 900.0
"""Through a hole as wide a pin of the nest may stick, or a screw, whose head reaches by the hole's width beyond it."""
LEAD_HOLE_UM = 400.0
"""A soldered pad with a hole as wide carries a lead; narrower ones are vias."""
_LETTERS = re.compile(r"[A-Za-z]+")


@dataclass(frozen=True, eq=False)
class _Obstacle:
    """What stands on the board: its outline (N, 2), its height above the surface, how far it may reach beyond."""

    outline_um: Array
    height_um: float
    beyond_um: float = 0.0


class ClearanceMap:
    """What stands on one side of a board; made once for a board, it may be used by several threads."""

    def __init__(self, board: Board, section: ClearanceSection) -> None:
        """Read the board; what its file says of the probed side alone counts."""
        shapes = None if board.layers is None else getattr(board.layers, board.side)
        self.known = shapes is not None and _is_told(shapes, section)
        """Whether the file tells enough to go by."""
        obstacles = [*_obstacles(board, shapes, section)] if shapes is not None and self.known else []
        # The highest first: what is lower than one that was found needs no look
        self._obstacles = sorted(obstacles, key=lambda one: -one.height_um)
        self._heights = np.array([one.height_um for one in self._obstacles])
        beyond = np.array([one.beyond_um for one in self._obstacles]).reshape(-1, 1)
        self._boxes = boxes_of([one.outline_um for one in self._obstacles]) + beyond * (-1, -1, 1, 1)
        self._edges = [p.points_um for p in shapes.layers.outline if p.dark] if shapes is not None else []
        self._nest_um = _or_unknown(section.nest_um)

    def height_um(self, area_um: Array, reach_um: float) -> float:
        """Return how high the highest rises that stands within `reach_um` of a convex area (N, 2); inf: not known."""
        if not self.known:
            return UNKNOWN
        highest_um = self._nest_um if self._leaves_the_board(area_um, reach_um) else 0.0
        low, high = area_um.min(axis=0) - reach_um, area_um.max(axis=0) + reach_um
        met = (self._boxes[:, 2:] >= low).all(axis=1) & (self._boxes[:, :2] <= high).all(axis=1)
        for i in np.flatnonzero(met & (self._heights > highest_um)):
            one = self._obstacles[i]
            if near(area_um, one.outline_um, reach_um + one.beyond_um):
                return max(highest_um, one.height_um)
        return highest_um

    def _leaves_the_board(self, area_um: Array, reach_um: float) -> bool:
        """Whether an area, or what is within reach of it, lies beyond the board's edge."""
        return not any(_has_within(edge, area_um, reach_um) for edge in self._edges)


def _has_within(edge_um: Array, area_um: Array, reach_um: float) -> bool:
    """Whether an area lies within an outline, farther from it than that."""
    # Lines that come near to no line of the other lie in it as a whole, or not at all
    return holds(edge_um, area_um[0]) and not near(area_um, edge_um, reach_um, filled=False)


def _is_told(shapes: SideShapes, section: ClearanceSection) -> bool:
    """Whether a side's shapes tell its edge and its parts; one without any is bare, or not told of."""
    parts = bool(shapes.bodies or shapes.soldered.outlines)
    return any(p.dark for p in shapes.layers.outline) and (parts or section.bare)


def _obstacles(board: Board, shapes: SideShapes, section: ClearanceSection) -> Iterator[_Obstacle]:
    """Yield the parts, the solder and leads, and what may stick through cut-outs and large holes."""
    layers, nest_um = shapes.layers, _or_unknown(section.nest_um)
    for body in shapes.bodies:
        height_um = body.height_um if body.height_um is not None else _told_um(body.part, section)
        yield _Obstacle(as_points(body.outline), height_um, section.outline_um)
    yield from _solder(board, shapes, section)
    for point in board.points:
        if point.stands_um:
            yield _Obstacle(_about(point), point.stands_um)
    pads = Outlines([polygon.points_um for polygon in layers.soldered if polygon.dark])
    for hole in layers.holes:
        if hole.diameter_um >= LARGE_HOLE_UM and not pads.hold((hole.x_um, hole.y_um)):
            yield _Obstacle(hole_outline(hole), nest_um, hole.diameter_um)
    for polygon in layers.outline:
        if not polygon.dark:
            yield _Obstacle(polygon.points_um, nest_um)


def _about(point: BoardPoint) -> Array:
    """Return an outline (4, 2) about the metal of a point."""
    metal = np.vstack([as_points(outline) for outline in point.metal_um] or [np.array([point.place_um])])
    half = (point.diameter_um or 0.0) / 2
    low, high = metal.min(axis=0) - half, metal.max(axis=0) + half
    corners: Array = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    return corners


def _solder(board: Board, shapes: SideShapes, section: ClearanceSection) -> Iterator[_Obstacle]:
    """Yield what stands on the soldered pads; a part that has no outline there stands somewhere about its pads."""
    here = Outlines([polygon.points_um for polygon in shapes.layers.bodies])
    holes = np.array([(h.x_um, h.y_um) for h in shapes.layers.holes if h.diameter_um >= LEAD_HOLE_UM]).reshape(-1, 2)
    leads: list[Array] = []
    for pad in (polygon.points_um for polygon in shapes.layers.soldered if polygon.dark):
        low, high = pad.min(axis=0), pad.max(axis=0)
        middle = (low + high) / 2
        if here.hold(middle):
            yield _Obstacle(pad, section.solder_um)
        elif ((holes >= low) & (holes <= high)).all(axis=1).any():
            leads.append(pad)
        else:
            yield _Obstacle(pad, UNKNOWN, section.outline_um)
    yield from _led_through(board, leads, section)


def _led_through(board: Board, leads: Sequence[Array], section: ClearanceSection) -> Iterator[_Obstacle]:
    """Yield the parts that the file has on the other side, whose leads come through: they may as well stand here."""
    other = getattr(board.layers, "bottom" if board.side == "top" else "top")
    # The other side has a frame of its own, seen from there
    mirrored = [(board.width_um, 0.0) + as_points(body.outline) * (-1.0, 1.0) for body in other.bodies]
    middles = np.array([(pad.min(axis=0) + pad.max(axis=0)) / 2 for pad in leads]).reshape(-1, 2)
    owned = np.zeros(len(leads), dtype=bool)
    for body, outline in zip(other.bodies, mirrored, strict=True):
        near_it = ((middles >= outline.min(axis=0)) & (middles <= outline.max(axis=0))).all(axis=1)
        within = [int(i) for i in np.flatnonzero(near_it) if holds(outline, middles[i])]
        if within:
            owned[within] = True
            yield _Obstacle(outline, max(_told_um(body.part, section), section.lead_um), section.outline_um)
    for pad, is_owned in zip(leads, owned, strict=True):
        if not is_owned:
            yield _Obstacle(pad, UNKNOWN, section.outline_um)


def _told_um(part: str | None, section: ClearanceSection) -> float:
    """Return how high a part stands at most, by the letters that its name begins with."""
    letters = _LETTERS.match(part or "")
    return _or_unknown(section.heights_um.get(letters.group().upper()) if letters else None)


def _or_unknown(height_um: float | None) -> float:
    return UNKNOWN if height_um is None else height_um
