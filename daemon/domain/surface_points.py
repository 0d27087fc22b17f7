"""Points of a board that a plane through its surface is measured on."""

from __future__ import annotations

from daemon.domain.board import Board, BoardPoint

LEAST_PLACES = 4
LEAST_PINS = 40
"""Of a board with pins alone the roomier half is offered to chance, of few all."""


def surface_points(board: Board) -> tuple[tuple[BoardPoint, ...], tuple[BoardPoint, ...]]:
    """Return what a board's surface is measured on: flat points, and by CAD what stands in for them.

    Those are pads of parts. A board with pins alone is measured on the rings of those with most room: it is them that
    will be touched there, and a plane that does not go through them is refused.
    """
    flat, pads = board.flat_points(), board.part_pads() if board.layers is not None else ()
    if board.layers is not None and len(flat) + len(pads) < LEAST_PLACES:
        pins = board.pins()
        pads = (*pads, *pins[: max(LEAST_PINS, len(pins) // 2)])
    return flat, pads
