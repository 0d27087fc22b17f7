"""References of a board: its CAD drawn about the places that are looked at, and drawn whole.

Drawing takes tens of milliseconds about a place and tenths of a second for a whole side, so it is done in worker
threads, while the head travels, and a few are kept.
"""

from __future__ import annotations

import asyncio
import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import cached_property
from typing import TypeVar

from daemon.domain.board import Board, SeatPlace
from daemon.station.board_obstacles import Obstacles
from vision.registration import (
    IndexedSide,
    LayerShifts,
    Reference,
    SideLayers,
    UniquePlace,
    Whole,
    draw_whole,
    how_unique,
    index_side,
    prepare,
    unique_places,
)

MOST_REFERENCES = 4
"""One takes some 10 MB."""
MOST_SEAT_PLACES = 8
T = TypeVar("T")


class BoardSides:
    """Both sides of a board as registration works with them; made when first asked for, by any thread."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._lock = threading.Lock()
        self._wholes: tuple[Whole, Whole | None] | None = None

    @cached_property
    def here(self) -> IndexedSide:
        """The probed side."""
        return index_side(self._layers())

    @cached_property
    def obstacles(self) -> Obstacles:
        """What stands in the needle's way on the probed side, or hides its metal."""
        return Obstacles(self._layers())

    def _layers(self) -> SideLayers:
        layers = self._board.side_layers(self._board.side)
        if layers is None:
            raise ValueError(f"the file of board {self._board.name} has no layers")
        return layers

    @cached_property
    def other(self) -> IndexedSide | None:
        """The side that lies below."""
        layers = self._board.side_layers("bottom" if self._board.side == "top" else "top")
        return index_side(layers) if layers is not None and (layers.copper or layers.openings) else None

    def whole(self) -> tuple[Whole, Whole | None]:
        """Return both sides drawn whole; blocks for tenths of a second the first time."""
        with self._lock:
            drawn = self._wholes  # once: it may be given up meanwhile
            if drawn is None:
                drawn = self._wholes = (draw_whole(self.here), None if self.other is None else draw_whole(self.other))
            return drawn

    def forget_whole(self) -> None:
        """Give up both sides drawn whole, some 30 MB; they are drawn again when they are next wanted."""
        self._wholes = None

    @cached_property
    def seat(self) -> tuple[SeatPlace, ...]:
        """The places by which the seat is told: those of the board file, else found now, which takes seconds."""
        if self._board.seat:
            return self._board.seat
        found = unique_places(self.here, self.other, count=MOST_SEAT_PLACES)
        return tuple(SeatPlace(x_um=p.x_um, y_um=p.y_um, rival=max(0.0, min(1.0, p.rival_score))) for p in found)


class BoardReferences:
    """Draw and keep the references of one board; used from the event loop alone, draws in worker threads."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._kept: OrderedDict[object, asyncio.Future[Reference]] = OrderedDict()
        self._unique: dict[tuple[tuple[float, float], bool], UniquePlace] = {}

    @cached_property
    def sides(self) -> BoardSides:
        """Both sides, for a worker thread."""
        return BoardSides(self._board)

    def begin(self, place_um: tuple[float, float], shifts: LayerShifts) -> asyncio.Future[Reference]:
        """Begin to draw what lies about a place, unless it is there or under way."""
        key = (place_um, shifts)
        if key not in self._kept or (self._kept[key].done() and self._kept[key].exception() is not None):
            self._kept[key] = _in_worker(lambda: prepare(self.sides.here, place_um, shifts))
        self._kept.move_to_end(key)
        while len(self._kept) > MOST_REFERENCES:
            self._kept.popitem(last=False)
        return self._kept[key]

    async def about(self, place_um: tuple[float, float], shifts: LayerShifts) -> Reference:
        """Return what lies about a place."""
        return await asyncio.shield(self.begin(place_um, shifts))

    def forget(self) -> None:
        """Give up what has been drawn, some 10 MB a place: the next look at one draws again while the head travels.

        What is under way goes on, and what was found out about places stays.
        """
        self._kept = OrderedDict((key, drawn) for key, drawn in self._kept.items() if not drawn.done())
        self.sides.forget_whole()

    async def how_unique(self, place_um: tuple[float, float], *, alone: bool = False) -> UniquePlace:
        """Return what of either side, turned or not, a look is likeliest to take for a place.

        alone: by a look for the board alone, which asks for more than one for a target does.
        """
        key = (place_um, alone)
        if key not in self._unique:
            self._unique[key] = await _in_worker(lambda: how_unique(place_um, *self.sides.whole(), alone=alone))
        return self._unique[key]

    async def seat(self) -> tuple[SeatPlace, ...]:
        """Return the places by which the seat is told, the most unique first."""
        return await _in_worker(lambda: self.sides.seat)


def _in_worker(work: Callable[[], T]) -> asyncio.Future[T]:
    """Begin work in a worker thread; if nobody waits for its end, its failure is not complained about."""
    future = asyncio.get_running_loop().run_in_executor(None, work)
    future.add_done_callback(lambda done: None if done.cancelled() else done.exception())
    return future
