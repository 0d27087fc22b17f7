"""Points of a plane, asked which are near a place."""

from __future__ import annotations

import math
from collections.abc import Iterable


def _cell(x_mm: float, y_mm: float) -> tuple[int, int]:
    return (round(x_mm / 0.1), round(y_mm / 0.1))


class Nearest:
    """Find the point nearest to a place, within a tenth of a millimetre."""

    def __init__(self, points_mm: Iterable[tuple[float, float]]) -> None:
        self._points = list(points_mm)
        self._cells: dict[tuple[int, int], list[int]] = {}
        for index, (x, y) in enumerate(self._points):
            self._cells.setdefault(_cell(x, y), []).append(index)

    def within(self, x_mm: float, y_mm: float, reach_mm: float) -> list[int]:
        """Return the indices within `reach_mm`, nearest first."""
        i, j = _cell(x_mm, y_mm)
        near = [k for a in (-1, 0, 1) for b in (-1, 0, 1) for k in self._cells.get((i + a, j + b), ())]
        distances = sorted((math.dist(self._points[k], (x_mm, y_mm)), k) for k in near)
        return [k for distance, k in distances if distance <= reach_mm]
