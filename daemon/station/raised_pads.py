"""Raised pads: metal that stands above the board's surface, as solder and leads do, as far as the board file tells.

CAD says of no pad how much solder is on it, nor how far a lead comes through the board. So a height is what a person
wrote into the board file (`stands_um`); of every other soldered pad nothing is known, and that is said.
"""

from __future__ import annotations

import numpy as np

from daemon.domain.board import Board, BoardPoint
from vision.geometry import Array

NEAR_UM = 1_000.0
"""A needle as near as this to a raised pad's place may meet it."""
SOLDERED = frozenset({"pad", "pin"})
"""Kinds of parts' pads, on which solder is, and through which leads come."""


class RaisedPads:
    """Of one board."""

    def __init__(self, board: Board) -> None:
        """Sort its points; one of no part lies as flat as the board."""
        fitted = _is_fitted(board)
        self._known = _places([p for p in board.points if p.stands_um])
        self._stands_um = np.array([p.stands_um for p in board.points if p.stands_um], dtype=float)
        self._unknown = _places([p for p in board.points if fitted and p.kind in SOLDERED and p.stands_um is None])

    @property
    def is_flat(self) -> bool:
        """Whether nothing of it is raised, or may be."""
        return not len(self._known) and not len(self._unknown)

    def stands_um(self, board_um: Array) -> float:
        """Return how high metal stands about a place (2,), board frame; 0 where none is known to."""
        if not len(self._known):
            return 0.0
        near = np.hypot(*(self._known - board_um).T) <= NEAR_UM
        return float(self._stands_um[near].max()) if near.any() else 0.0

    def is_unknown(self, board_um: Array) -> bool:
        """Whether a pad is about that place of which nobody has told how high it stands."""
        return bool(len(self._unknown)) and bool((np.hypot(*(self._unknown - board_um).T) <= NEAR_UM).any())


def _is_fitted(board: Board) -> bool:
    """Whether parts are on it: a bare board's pads are flat; a file without layers does not tell."""
    if board.layers is None:
        return True
    shapes = board.layers.top if board.side == "top" else board.layers.bottom
    return bool(shapes.soldered.outlines or shapes.bodies)


def _places(points: list[BoardPoint]) -> Array:
    return np.array([p.place_um for p in points], dtype=float).reshape(-1, 2)
