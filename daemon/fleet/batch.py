"""Batch of records: what one message up carries, and the answer down: how far they are stored. No I/O.

A batch holds records of one journal in the order of their numbers, without a gap: what the station no longer has is a
record itself, `lost`, that says from where to where. So nobody behind the station can mistake a hole for silence.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

VERSION = 1
MAX_SEQ = 2**63 - 1
MAX_ROWS = 500
MAX_ID = 64
LOST = "lost"
Row = dict[str, Any]


class Nonsense(ValueError):
    """A message that says nothing; the text tells why."""


class Stored(NamedTuple):
    """How far the records of a journal are stored; no journal: nothing of the station is."""

    journal: str | None
    seq: int
    resume: bool = False
    """Whether the station has to go on from here, for what it sent beyond was not taken."""

    def to_json(self) -> bytes:
        """Return it as one message."""
        return json.dumps({"v": VERSION, **self._asdict()}).encode()

    @classmethod
    def of(cls, payload: bytes) -> Stored:
        """Read a message; raise `Nonsense` if it is none."""
        said = _object(payload)
        journal = None if said.get("journal") is None else _id(said, "journal")
        return cls(journal, _number(said, "seq"), said.get("resume") is True)


class Batch(NamedTuple):
    """Records of one journal."""

    journal: str
    first_seq: int
    """First number of the journal."""
    previous: Stored | None
    """The journal before it with its last number; None for the first one of a file."""
    after: int
    """Number of the record before the first."""
    rows: list[Row]

    @property
    def last(self) -> int:
        """Number of the last record."""
        return int(self.rows[-1]["seq"])

    def to_json(self) -> bytes:
        """Return it as one message."""
        before = None if self.previous is None else {"journal": self.previous.journal, "seq": self.previous.seq}
        return json.dumps({"v": VERSION, **self._asdict(), "previous": before}, separators=(",", ":")).encode()

    @classmethod
    def of(cls, payload: bytes) -> Batch:
        """Read a message; raise `Nonsense` if it is none, or has a gap.

        Of a row only its number is looked at here: one that nobody can read must not keep the others back.
        """
        said = _object(payload)
        rows, before = said.get("rows"), said.get("previous")
        if not isinstance(rows, list) or not 0 < len(rows) <= MAX_ROWS:
            raise Nonsense(f"rows: 1 to {MAX_ROWS} are taken")
        if before is not None and not isinstance(before, dict):
            raise Nonsense("previous is no object")
        previous = None if before is None else Stored(_id(before, "journal"), _number(before, "seq"))
        batch = cls(_id(said, "journal"), _number(said, "first_seq"), previous, _number(said, "after"), rows)
        _require_whole(batch)
        return batch


def _require_whole(batch: Batch) -> None:
    """Raise `Nonsense` where a number is missing and no record says that it is lost."""
    if batch.after < batch.first_seq - 1:
        raise Nonsense(f"it goes on after {batch.after}, and its journal begins with {batch.first_seq}")
    at = batch.after
    for row in batch.rows:
        if not isinstance(row, dict):
            raise Nonsense(f"the row after {at} is no object")
        seq = _number(row, "seq")
        if seq != at + 1 and lost_of(row) != (at + 1, seq):
            raise Nonsense(f"after {at} comes {seq}, and nothing says what is between them")
        at = seq


def lost_row(first: int, last: int) -> Row:
    """Return the record that says of the numbers from `first` to `last` that they are lost."""
    return {"seq": last, "kind": LOST, "at": None, "body": {"from_seq": first, "to_seq": last}, "circumstances": {}}


def lost_of(row: Mapping[str, Any]) -> tuple[int, int] | None:
    """Return which numbers a record says are lost, both ends included; None for a record of another kind."""
    body = row.get("body")
    if row.get("kind") != LOST or not isinstance(body, dict):
        return None
    first, last = body.get("from_seq"), body.get("to_seq")
    return (first, last) if type(first) is int and type(last) is int and first <= last else None


def without_holes(after: int, rows: Iterable[Row]) -> Iterator[Row]:
    """Yield rows above `after`, with a record `lost` in each place where numbers are missing.

    A row without a body is as good as missing: it was trimmed before its number was, or the station cannot read it.
    """
    at = end = after
    for row in rows:
        seq = int(row["seq"])
        end = max(end, seq)
        if seq <= at or row["body"] is None:
            continue
        if seq > at + 1:
            yield lost_row(at + 1, seq - 1)
        yield row
        at = seq
    if end > at:
        yield lost_row(at + 1, end)


def batch_of(page: Mapping[str, Any], journal: str | None, since: int) -> Batch | None:
    """Return what a page of `records`, asked for by journal and number, holds; None for nothing new."""
    first_seq = int(page["first_seq"])
    begin = max(since, first_seq) if page["journal"] == journal else first_seq
    before, gone = page["previous"], page["lost"]
    rows = list(without_holes(begin - 1, page["records"]))
    if gone is not None and not rows:
        rows = [lost_row(begin, int(gone["to_seq"]))]
    if not rows:
        return None
    previous = None if before is None else Stored(str(before["journal"]), int(before["seq"]))
    return Batch(str(page["journal"]), first_seq, previous, begin - 1, rows)


def _object(payload: bytes) -> dict[str, Any]:
    try:
        said = json.loads(payload)
    except (ValueError, RecursionError) as exc:
        raise Nonsense(f"it is not JSON: {exc}"[:200]) from exc
    if not isinstance(said, dict):
        raise Nonsense("it is not a JSON object")
    if said.get("v") != VERSION:
        raise Nonsense(f"it is of version {str(said.get('v'))[:20]}, and {VERSION} is spoken here")
    return said


def _number(said: Mapping[str, Any], name: str) -> int:
    value = said.get(name)
    if type(value) is not int or not 0 <= value <= MAX_SEQ:
        raise Nonsense(f"{name} is no number from 0 to {MAX_SEQ}")
    return value


def _id(said: Mapping[str, Any], name: str) -> str:
    value = said.get(name)
    if not isinstance(value, str) or not 0 < len(value) <= MAX_ID or not value.isprintable():
        raise Nonsense(f"{name} is no id")
    return value
