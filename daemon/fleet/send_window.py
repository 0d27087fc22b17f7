"""Send window of the uplink: which records to send next, given what the centre says it has stored. No I/O, no clock.

The centre's word is all that counts, for the broker's is worth nothing when it is killed: what is not said to be stored
is sent again. Nothing is kept here over a restart.
"""

from __future__ import annotations

from typing import NamedTuple

from daemon.fleet.batch import Batch, Stored

BATCHES_OUT = 4
STALL_S, STALL_MOST_S = 2.0, 32.0
"""So long without a word of progress, and what is out is taken for lost; longer each time that nothing is said, for a
centre that has much to do gets no further by getting it twice."""


class Position(NamedTuple):
    """Where to read on: a number, and the journal it is one of; no journal: from the oldest."""

    journal: str | None
    since: int


class SendWindow:
    """What is out and where to go on. Times are seconds of any clock that never goes back."""

    def __init__(self) -> None:
        self._stored = Stored(None, 0)
        self._next = Position(None, 0)
        self._out: list[Stored] = []
        """The last record of each batch that is on its way."""
        self._limit = 1
        self._since_s = 0.0
        self._stall_s = STALL_S

    @property
    def position(self) -> Position:
        """Where to read on."""
        return self._next

    @property
    def stored(self) -> Stored:
        """What the centre said last."""
        return self._stored

    @property
    def is_empty(self) -> bool:
        """Whether nothing is on its way."""
        return not self._out

    @property
    def has_room(self) -> bool:
        """Whether another batch may be sent; until the centre answers it is one alone."""
        return len(self._out) < self._limit

    def may_send(self, batch: Batch) -> bool:
        """Whether a batch may go now: one of another journal waits until all before it is stored."""
        return self.has_room and all(sent.journal == batch.journal for sent in self._out)

    def sent(self, batch: Batch, now_s: float) -> None:
        """Take note of a batch that was sent."""
        if not self._out:
            self._since_s = now_s
        self._out.append(Stored(batch.journal, batch.last))
        self._next = Position(batch.journal, batch.last + 1)

    def heard(self, said: Stored, now_s: float) -> None:
        """Go by what the centre has stored: as expected, ahead, or back, where it did not take what is out."""
        known = [sent for sent in self._out if sent.journal == said.journal]
        before = self._stored.seq if self._stored.journal == said.journal else -1
        if said.seq > before:
            self._since_s = now_s
        self._stored, self._limit, self._stall_s = said, BATCHES_OUT, STALL_S
        if known and before <= said.seq <= known[-1].seq and not said.resume:
            self._out = [sent for sent in known if sent.seq > said.seq]
        else:
            self._go_back()

    def is_stalled(self, now_s: float) -> bool:
        """Whether something is out and the centre has said nothing for too long."""
        return bool(self._out) and now_s - self._since_s >= self._stall_s

    def retry(self) -> None:
        """Send again what is not stored, one batch until the centre answers."""
        self._go_back()
        self._limit, self._stall_s = 1, min(2 * self._stall_s, STALL_MOST_S)

    def disbelieve(self) -> None:
        """Begin from the oldest: what the centre said cannot be."""
        self._stored = Stored(None, 0)
        self.retry()

    def _go_back(self) -> None:
        self._out = []
        self._next = Position(self._stored.journal, self._stored.seq + 1)
