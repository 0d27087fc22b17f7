"""Trust in the board: whether the one in the nest is known to lie as high as the surface that was measured.

A measured surface is that of the board which lay there then. Nobody tells when a hand puts in another one. So it is
trusted once a look has shown the pin free where a higher board would have pushed it in, and no longer than the station
goes on working: a board cannot be changed under a head that moves. Until then every way down is slow from the highest
surface that is possible.
"""

from __future__ import annotations

import time
from collections.abc import Callable

CHANGED_WITHIN_S = 5.0
"""Nobody opens the hood, changes a board and closes it again in less."""


class BoardTrust:
    """Of one station, over reloads of its configuration."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._until_s = self._recognised_until_s = 0.0

    @property
    def holds(self) -> bool:
        """Whether the board is known to be the one that was measured, or one as high."""
        return self._now_s() < self._until_s

    @property
    def is_recognised(self) -> bool:
        """Whether the same looks have shown by CAD that it is this board, and where it was aligned."""
        return self.holds and self._now_s() < self._recognised_until_s

    def recognised(self) -> None:
        """Hear that a look has shown the board by CAD, below the needle."""
        self._recognised_until_s = self._now_s() + CHANGED_WITHIN_S

    def seen_free(self) -> None:
        """Hear that the pin was seen free at the height of looks over a measured surface."""
        self._until_s = self._now_s() + CHANGED_WITHIN_S

    def moved(self) -> None:
        """Hear that the head moved just now: what was trusted until then still lies there."""
        if self.is_recognised:
            self.recognised()
        if self.holds:
            self.seen_free()

    def end(self) -> None:
        """Hear of a doubt: a fault, another board, a start."""
        self._until_s = self._recognised_until_s = 0.0
