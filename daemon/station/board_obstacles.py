"""Obstacles on a board's side: open holes and what covers metal, each with its box, so that few have to be outlined."""

from __future__ import annotations

import cv2
import numpy as np

from vision.geometry import Array
from vision.registration import Hole, SideLayers

_TURNS = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
_CIRCLE = np.column_stack((np.cos(_TURNS), np.sin(_TURNS)))


class Obstacles:
    """The obstacles of one side; made once for a board, it may be used by several threads."""

    def __init__(self, layers: SideLayers) -> None:
        self._holes = [hole for hole in layers.holes if not hole.covered]
        self._covers = [polygon.points_um for polygon in (*layers.bodies, *layers.soldered)]
        self._hole_boxes = _boxes([_box_of(hole) for hole in self._holes])
        self._cover_boxes = _boxes([(*c.min(axis=0), *c.max(axis=0)) for c in self._covers])

    def holes_near(self, low_um: Array, high_um: Array) -> list[Array]:
        """Return the outlines (N, 2) of the open holes that reach into a box."""
        return [hole_outline(self._holes[i]) for i in _reaching(self._hole_boxes, low_um, high_um)]

    def covers_near(self, low_um: Array, high_um: Array) -> list[Array]:
        """Return the outlines (N, 2) of the parts and the solder that reach into a box."""
        return [self._covers[i] for i in _reaching(self._cover_boxes, low_um, high_um)]


def round_outline(x_um: float, y_um: float, diameter_um: float) -> Array:
    """Return a circle's outline (48, 2)."""
    outline: Array = np.array((x_um, y_um)) + _CIRCLE * diameter_um / 2
    return outline


def _reaching(boxes: Array, low_um: Array, high_um: Array) -> list[int]:
    """Return which of the boxes (N, 4) reach into one."""
    inside = (boxes[:, 2:] >= low_um).all(axis=1) & (boxes[:, :2] <= high_um).all(axis=1)
    return [int(i) for i in np.flatnonzero(inside)]


def _boxes(boxes: list[tuple[float, ...]]) -> Array:
    return np.array(boxes, dtype=float).reshape(-1, 4)


def _ends(hole: Hole) -> list[tuple[float, float]]:
    """Return a hole's middle, or a slot's two ends."""
    if hole.end_x_um is None or hole.end_y_um is None:
        return [(hole.x_um, hole.y_um)]
    return [(hole.x_um, hole.y_um), (hole.end_x_um, hole.end_y_um)]


def _box_of(hole: Hole) -> tuple[float, ...]:
    ends, radius_um = np.array(_ends(hole)), hole.diameter_um / 2
    return (*(ends.min(axis=0) - radius_um), *(ends.max(axis=0) + radius_um))


def hole_outline(hole: Hole) -> Array:
    """Return a hole's outline, a slot's as the hull of its two ends."""
    circles = [round_outline(x_um, y_um, hole.diameter_um) for x_um, y_um in _ends(hole)]
    if len(circles) == 1:
        return circles[0]
    hull = cv2.convexHull(np.vstack(circles).astype(np.float32))
    return np.asarray(hull[:, 0, :], dtype=float)
