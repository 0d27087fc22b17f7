"""Points of a board that a plane through its surface is measured on."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

from daemon.domain.board import Board, BoardPoint

LEAST_PLACES = 4
LEAST_PINS = 40
"""The roomier half of a board's pins is offered to chance, of few all."""


class SurfacePoints(NamedTuple):
    """What may be touched to measure a surface, by how truly it tells the height of it."""

    flat: tuple[BoardPoint, ...] = ()
    """Round bare metal without solder: the surface itself."""
    pads: tuple[BoardPoint, ...] = ()
    """Pads of parts, where CAD is known: solder on them is some ten um high."""
    pins: tuple[BoardPoint, ...] = ()
    """Rings of leads, where CAD is known, the roomiest first: what solder stands there varies most."""

    @property
    def number(self) -> int:
        """How many there are of all kinds."""
        return sum(map(len, self))

    def only(self, wanted: Callable[[BoardPoint], bool]) -> SurfacePoints:
        """Return those that are wanted."""
        return SurfacePoints(*(tuple(filter(wanted, some)) for some in self))

    def without(self, names: Collection[str]) -> SurfacePoints:
        """Return those of other names."""
        return self.only(lambda point: point.name not in names)


def surface_points(board: Board) -> SurfacePoints:
    """Return what a board's surface may be measured on.

    Of pins those with most room: it is them that will be touched, and a plane that does not go through them is refused.
    """
    if board.layers is None:
        return SurfacePoints(board.flat_points())
    pins = board.pins()
    return SurfacePoints(board.flat_points(), board.part_pads(), pins[: max(LEAST_PINS, len(pins) // 2)])
