"""What lies in the nest: a board side as it was made, and what the needle left on it.

Replaced as a whole when a board is exchanged or made otherwise: a camera's thread may be drawing the old one.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

from sim_hw.board.board import Board
from sim_hw.board.finish import Finish
from sim_hw.board.parts import Bodies
from sim_hw.board.surface import Surface

_serial = itertools.count(1)


@dataclass(frozen=True)
class Mark:
    """A dent the needle left in metal; CAD mm, um."""

    x_mm: float
    y_mm: float
    radius_um: float


@dataclass(frozen=True)
class InNest:
    """One board, one side up. `number` tells it from every other that lay here; `marks` only ever grows."""

    board: Board
    finish: Finish
    surface: Surface
    bodies: Bodies
    marks: list[Mark] = field(default_factory=list)
    number: int = field(default_factory=lambda: next(_serial))

    @classmethod
    def made(cls, board: Board, finish: Finish | None = None, marks: list[Mark] | None = None) -> InNest:
        """Return a board side made so."""
        finish = finish or Finish()
        shifts = (_cad_mm(board, finish.ink_shift_um), _cad_mm(board, finish.mask_shift_um))
        return cls(board, finish, Surface(board, *shifts), Bodies(board.bodies), [] if marks is None else marks)

    def relief_um(self, x_mm: float, y_mm: float) -> float:
        """Return the height of the part at a CAD place above the board, 0 where there is none."""
        body = self.bodies.over(x_mm, y_mm)
        return 0.0 if body is None else body.height_um


def _cad_mm(board: Board, seen_um: tuple[float, float]) -> tuple[float, float]:
    """Return a shift as this side is seen (um) in CAD mm: the bottom is seen from below."""
    across_um = seen_um[0] if board.side == "top" else -seen_um[0]
    return across_um / 1e3, seen_um[1] / 1e3
