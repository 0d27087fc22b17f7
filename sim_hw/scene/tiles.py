"""Image of a whole board of which only the tiles lately looked at take memory."""

from __future__ import annotations

import mmap
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Tile = tuple[int, int]

TILE = 1024
_BYTES = 4
"""Of a texel: four planes. A row of a tile is then a page of memory, which can be given back alone."""
MOST_TILES = 28
"""4 MiB each. A picture shows ten to twenty-five, and where the head goes next is drawn while it travels."""
KEPT_WHOLE = 44
"""A board of no more tiles than this is kept whole, and drawn whole before anybody asks."""


class TileStore:
    """An image (height, width, 4) of zeros, and which of its tiles (row, column) hold something.

    `most` is how many it keeps; None: MOST_TILES, or KEPT_WHOLE of a small board. However many it may keep, no more
    than that are drawn unasked: who has much memory has not more time.
    """

    def __init__(self, width: int, height: int, most: int | None = None) -> None:
        columns = -(-width // TILE) * TILE
        self._stride = columns * _BYTES
        # Private pages: those nobody wrote to cost nothing, and those given back are zeros again.
        self._memory = mmap.mmap(-1, height * self._stride, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        whole = np.frombuffer(self._memory, dtype=np.uint8).reshape(height, columns, _BYTES)
        self.image: Image = whole[:, :width]
        self.rows, self.columns = -(-height // TILE), -(-width // TILE)
        usual = MOST_TILES if self.rows * self.columns > KEPT_WHOLE else KEPT_WHOLE
        self._most = usual if most is None else most
        self._unasked = min(usual, self._most)
        self._height = height
        self._held: dict[Tile, None] = {}

    def holds(self, tile: Tile) -> bool:
        """Tell whether a tile is drawn."""
        return tile in self._held

    def full(self) -> bool:
        """Tell whether so many tiles are held that no other is drawn unasked."""
        return len(self._held) >= self._unasked

    def missing(self) -> list[Tile]:
        """Return the tiles that are not drawn."""
        return [(i, j) for i in range(self.rows) for j in range(self.columns) if (i, j) not in self._held]

    def hold(self, tile: Tile) -> None:
        """Note that a tile is drawn, or was looked at again."""
        self._held.pop(tile, None)
        self._held[tile] = None

    def forget_beyond(self, wanted: Iterable[Tile]) -> None:
        """Give back what was not looked at for longest, until the rest fits; never what is wanted now."""
        keep = set(wanted)
        spare = [tile for tile in self._held if tile not in keep]
        for tile in spare[: max(0, len(self._held) - self._most)]:
            self.forget(tile)

    def forget(self, tile: Tile) -> None:
        """Give back a tile's memory."""
        if tile not in self._held:
            return
        del self._held[tile]
        i, j = tile
        for row in range(i * TILE, min((i + 1) * TILE, self._height)):
            start = row * self._stride + j * TILE * _BYTES
            self._memory.madvise(mmap.MADV_DONTNEED, start, TILE * _BYTES)
