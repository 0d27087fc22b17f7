"""Distance of a convex area from an outline: whether one comes as near to the other as asked. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.geometry import Array


def near(area: Array, outline: Array, reach: float, *, filled: bool = True) -> bool:
    """Tell whether an area (N, 2) is within `reach` of an outline (M, 2), closed; both in the same unit.

    The area is convex; a single place and a way between two are areas too. `filled`: what the outline encloses belongs
    to it; else only its line does. Where both cross, or one holds the other, they are near.
    """
    if holds(area, outline[0]) or (filled and holds(outline, area[0])):
        return True
    return _lines_near(area, np.roll(area, -1, axis=0), outline, np.roll(outline, -1, axis=0), reach)


def boxes_of(outlines: Sequence[Array]) -> Array:
    """Return x0, y0, x1, y1 of each outline, (N, 4)."""
    boxes: Array = np.array([(*o.min(axis=0), *o.max(axis=0)) for o in outlines], dtype=float).reshape(-1, 4)
    return boxes


class Outlines:
    """Outlines that are asked by place."""

    def __init__(self, outlines: Sequence[Array]) -> None:
        self._outlines = outlines
        self._boxes = boxes_of(outlines)

    def hold(self, place: ArrayLike) -> bool:
        """Tell whether any of them holds a place (2,)."""
        at = np.asarray(place, dtype=float)
        met = (self._boxes[:, :2] <= at).all(axis=1) & (at <= self._boxes[:, 2:]).all(axis=1)
        return any(holds(self._outlines[i], at) for i in np.flatnonzero(met).tolist())


def holds(outline: Array, place: Array) -> bool:
    """Tell whether an outline holds a place, or has it on its line."""
    if len(outline) < 3:
        return False
    return cv2.pointPolygonTest(outline.astype(np.float32), (float(place[0]), float(place[1])), measureDist=False) >= 0


def _lines_near(a0: Array, a1: Array, b0: Array, b1: Array, reach: float) -> bool:
    """Tell whether any of the lines a0..a1 (N, 2) comes within `reach` of any of the lines b0..b1 (M, 2)."""
    if bool(_cross(a0[:, None], a1[:, None], b0[None], b1[None]).any()):
        return True
    # Lines that do not cross are nearest to each other at an end of one of them
    ends = (_to_line(b0[None], a0[:, None], a1[:, None]), _to_line(a0[:, None], b0[None], b1[None]))
    return any(bool((squared <= reach * reach).any()) for squared in ends)


def _to_line(place: Array, start: Array, end: Array) -> Array:
    """Return the squared distances of places from lines; all three broadcast to (N, M, 2)."""
    way = end - start
    length = np.maximum((way * way).sum(axis=-1), 1e-12)
    share = np.clip(((place - start) * way).sum(axis=-1) / length, 0.0, 1.0)
    off = place - start - share[..., None] * way
    squared: Array = (off * off).sum(axis=-1)
    return squared


def _cross(a0: Array, a1: Array, b0: Array, b1: Array) -> NDArray[np.bool_]:
    """Tell which lines cross; those that only touch are near by the distance of an end."""
    sides_b = _side(a0, a1, b0) * _side(a0, a1, b1)
    sides_a = _side(b0, b1, a0) * _side(b0, b1, a1)
    crossing: NDArray[np.bool_] = (sides_a < 0.0) & (sides_b < 0.0)
    return crossing


def _side(start: Array, end: Array, place: Array) -> Array:
    """Return on which side of a line a place is: its sign tells."""
    way, off = end - start, place - start
    side: Array = way[..., 0] * off[..., 1] - way[..., 1] * off[..., 0]
    return side
