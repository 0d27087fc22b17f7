"""Ledger of what is stored of a station: which rows of a batch are taken, and what is answered. No I/O.

The rule that loses nothing: a batch is taken only if all before it is stored, and what is stored moves in the same
transaction as the rows. Journals follow each other as links of a chain; a new one is taken only when the one before it
is stored to its end, or when it is the first of a new file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from daemon.fleet.batch import Batch, Row, Stored

ANOTHER = (
    "a journal goes on that was followed by another one: two stations report under this name, or two copies of one "
    "station run"
)


@dataclass
class Ledger:
    """What is stored of one station: journal -> its last stored number, in the order in which they began."""

    cursors: dict[str, int] = field(default_factory=dict)

    @property
    def newest(self) -> str | None:
        """The journal that began last."""
        return next(reversed(self.cursors), None)

    @property
    def stored(self) -> Stored:
        """How far the newest journal is stored."""
        newest = self.newest
        return Stored(None, 0, resume=True) if newest is None else Stored(newest, self.cursors[newest], resume=True)


@dataclass(frozen=True)
class Decision:
    """What to do with a batch."""

    rows: list[Row]
    """To be stored, all of numbers that are not stored yet; empty for none."""
    answer: Stored | None
    """How far it is stored afterwards; None: nobody is answered."""
    refusal: str = ""
    """Why a batch was not taken that can never be."""


def decide(batch: Batch, ledger: Ledger) -> Decision:
    """Say what is taken of a batch, and write it down in the ledger."""
    if batch.journal not in ledger.cursors:
        missing = _missing_before(batch, ledger.cursors)
        if missing is not None:
            return Decision([], missing)
    cursor = ledger.cursors.get(batch.journal, batch.first_seq - 1)
    if batch.after > cursor:
        return Decision([], Stored(batch.journal, cursor, resume=True))
    rows = [row for row in batch.rows if row["seq"] > cursor]
    if not rows:
        return Decision([], Stored(batch.journal, cursor))
    if batch.journal in ledger.cursors and batch.journal != ledger.newest:
        return Decision([], None, ANOTHER)
    ledger.cursors[batch.journal] = batch.last
    return Decision(rows, Stored(batch.journal, batch.last))


def _missing_before(batch: Batch, cursors: Mapping[str, Any]) -> Stored | None:
    """Return from where on the station has to send before a new journal can be taken; None: it can."""
    before = batch.previous
    if before is None:
        return None
    if before.journal is None or before.journal not in cursors:
        return Stored(None, 0, resume=True)
    cursor = int(cursors[before.journal])
    return None if cursor >= before.seq else Stored(before.journal, cursor, resume=True)
