"""Index of places: which of many lie at a given one, in a few microseconds."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable

SAME_PLACE_UM = 30.0
"""Netlists round to 2.54 um and drills to 1 um; two entries this near are one place."""


class PlaceIndex:
    """Places, um, in square cells as wide as `SAME_PLACE_UM`."""

    def __init__(self, places: Iterable[tuple[float, float]]) -> None:
        self._places = [(float(x), float(y)) for x, y in places]
        self._cells: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
        for i, (x, y) in enumerate(self._places):
            self._cells[math.floor(x / SAME_PLACE_UM), math.floor(y / SAME_PLACE_UM)].append(i)

    def at(self, x: float, y: float) -> list[int]:
        """Return the indices of the places no farther than `SAME_PLACE_UM` from one."""
        column, row = math.floor(x / SAME_PLACE_UM), math.floor(y / SAME_PLACE_UM)
        return [
            i
            for dx in (-1, 0, 1)
            for dy in (-1, 0, 1)
            for i in self._cells.get((column + dx, row + dy), ())
            if math.dist((x, y), self._places[i]) <= SAME_PLACE_UM
        ]
