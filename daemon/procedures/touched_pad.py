"""Touched pad: which pad of which board is touched, how often it was, and whether it may be once more."""

from __future__ import annotations

from dataclasses import dataclass

from daemon.config.sections.touching import TouchSection
from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import StationContext, TouchBook


@dataclass(frozen=True)
class TouchedPad:
    """One pad of the board in the nest, as its touches are counted."""

    point: str
    board_id: str | None
    """Of the board in the nest; None where nobody has named it."""
    since: str
    """When it was aligned, UTC, ISO 8601; "" where it was not: any touch may have been one of this board."""
    book: TouchBook

    @classmethod
    def below(cls, context: StationContext, point: str, board_id: str | None, book: TouchBook) -> TouchedPad:
        """Return the pad that a request means; who leaves out the board means the one that was aligned."""
        aligned = context.calibrations.alignment(context.board)
        if aligned is None:
            return cls(point, board_id, "", book)
        return cls(point, board_id if board_id is not None else aligned.board_id, aligned.made_at, book)

    async def refuse_forbidden(self, board: Board) -> None:
        """Raise `Fault` where a person has forbidden this point of the board to the needle."""
        mark = await self.book.mark_of(board.name, board.side, self.point)
        if mark is not None:
            mark.refuse()

    async def touches(self) -> int:
        """Return how often it was touched: in the life of a named board, else since the board lies there."""
        return await self.book.touches_of(self.board_id, self.point, self.since)

    async def touches_in_life(self) -> int | None:
        """Return how often it was touched in the life of its board; None for a board that nobody named."""
        return None if self.board_id is None else await self.touches()

    async def require(self, most: TouchSection, *, seen: bool) -> None:
        """Raise `Fault` for a pad whose touches are spent, or that was pressed since anybody saw it below the tip.

        `most`: how often a pad of a named board may be touched and pressed, in its life.
        """
        wear = await self.book.wear_of(self.board_id, self.point, self.since, "")
        done = wear.touches
        if self.board_id is not None and done >= most.touches_per_pad:
            raise Fault(
                FaultCode.TOUCH_BUDGET_SPENT,
                f"{self.point} of board {self.board_id} was touched {done} times (touch.touches_per_pad)",
                touches=done,
                limit=most.touches_per_pad,
            )
        if self.board_id is not None and wear.presses >= most.presses_per_pad:
            raise Fault(
                FaultCode.TOUCH_BUDGET_SPENT,
                f"{self.point} of board {self.board_id} was pressed {wear.presses} times (touch.presses_per_pad)",
                presses=wear.presses,
                limit=most.presses_per_pad,
            )
        if done and not seen:
            raise Fault(FaultCode.LOOK_NEEDED, f"{self.point} was pressed before and not seen since")
