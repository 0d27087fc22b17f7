"""Event numbers: handed out from blocks that were written down as taken, so that none is ever given twice."""

from __future__ import annotations

BLOCK = 10_000
"""A kill costs a gap of as many at most; a burst of events between two writes must not use up half of them."""
SPARE = 100
"""The last of a block are for results and alerts, which are in the journal, too."""


class EventNumbers:
    """The next number, and how far numbers may be given. No I/O: who writes a block down says so by `reserved`."""

    def __init__(self) -> None:
        self._next = 0
        self._end = 0
        self._lent: int | None = None

    def begin(self, first: int) -> None:
        """Take numbers from `first` on, or go on where they are already beyond; nothing is reserved by it."""
        if first > self._next:
            self._next = self._end = first

    @property
    def upcoming(self) -> int:
        """The number the next event will carry."""
        return self._next if self._lent is None else self._lent

    @property
    def wanted(self) -> int | None:
        """Up to where a block should be reserved now; None while half a block is left."""
        return self._next + BLOCK if self._next + BLOCK // 2 >= self._end else None

    def reserved(self, end: int) -> None:
        """Say that all numbers below `end` are written down as taken."""
        self._end = max(self._end, end)

    def take(self, spare: int = SPARE) -> int | None:
        """Return the next number; None if no more than `spare` are left, for then it might be given twice."""
        if self._next + spare >= self._end:
            return None
        self._next += 1
        return self._next - 1

    def lend(self) -> int | None:
        """Return the next number for what has yet to be written; `settle` says whether it was used."""
        self._lent = self.take(0)
        return self._lent

    def settle(self, *, used: bool) -> None:
        """Keep the number that was lent, or take it back; none may have been taken since."""
        if not used and self._lent is not None:
            if self._next != self._lent + 1:
                raise RuntimeError("a number was taken while one was lent")
            self._next = self._lent
        self._lent = None
