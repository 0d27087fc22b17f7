"""Record stream: everything the journal keeps, in one order and under one count, for who carries it away.

Triggers of the database give a number to each row the moment it is written, in the same transaction, whoever writes it:
`seq` counts without a gap. A row that changes later (a touch that ends, an order that is carried out) comes again under
a new number. The number refers to the row, nothing is kept twice; a row that is trimmed meanwhile is told as gone.

A **journal** is what one opening of the file writes. Each gets an id of its own, for a file that was put back from a
backup counts over numbers that were used before; so (journal, seq) never means two things, however the file came back.

With each row stand the circumstances it was written in: program, configuration, board, needle, calibrations.
"""

from __future__ import annotations

import json
import sqlite3
import uuid
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

from daemon.storage.journal_work import Work
from daemon.storage.record_tables import CIRCUMSTANCES, SOURCES

RECORDS_KEPT = 2_000_000
"""Some 40 bytes each; the rows themselves have bounds of their own."""
JOURNALS_KEPT = 10_000
TRIM_EACH = 2_000
PAGE_BYTES = 512 * 1024
"""A page is cut when its rows have grown to this; it has one row at least."""
PAGE_SCAN = 20_000
"""So many numbers are looked through for a page of some kinds only: a rare one must not hold the writer's thread up."""


class StreamRecord(NamedTuple):
    """One record; `body` is None where the row was trimmed before anybody fetched it, or cannot be read."""

    seq: int
    kind: str
    at: str | None
    body: dict[str, Any] | None
    circumstances: dict[str, Any]


class RecordPage(NamedTuple):
    """Records of one journal, oldest first, and where they stand in all there are."""

    journal: str
    first_seq: int
    """Of this journal."""
    previous: tuple[str, int] | None
    """The journal before it that has records, and its last number; None for the first one of the file."""
    lost: tuple[int, int] | None
    """From and to, both included: asked for, of this journal, and trimmed before anybody fetched them."""
    records: list[StreamRecord]
    through_seq: int
    """The last number that was looked at: what is beyond comes with the next page."""
    oldest_seq: int
    """Oldest number kept, of any journal; `next_seq` where none is."""
    next_seq: int


class RecordStream:
    """Read the stream, and say in which circumstances the next records are written."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._pending: str | None = None

    def set_circumstances(self, facts: Mapping[str, Any]) -> None:
        """Have all that is written from now on carry these facts; they are written down with the next row."""
        self._pending = json.dumps(facts, sort_keys=True)

    @property
    def is_pending(self) -> bool:
        """Whether circumstances were set that are not written down yet."""
        return self._pending is not None

    def write_pending(self, db: sqlite3.Connection) -> None:
        """Write down what was set; to be called in the writer's thread before the next piece of work."""
        body = self._pending
        if body is None:
            return
        sql = "SELECT 1 FROM circumstances JOIN meta ON n=value WHERE key=? AND body=?"
        if db.execute(sql, (CIRCUMSTANCES, body)).fetchone() is None:
            number = db.execute("INSERT INTO circumstances(body) VALUES (?)", (body,)).lastrowid
            sql = "INSERT INTO meta VALUES (?, ?) ON CONFLICT(key) DO UPDATE SET value=excluded.value"
            db.execute(sql, (CIRCUMSTANCES, number))
        if self._pending is body:
            self._pending = None

    async def read(
        self, journal: str | None, since: int, limit: int, kinds: Collection[str] | None = None
    ) -> RecordPage:
        """Return records from number `since` on, of one journal; those of the next one come with the next page.

        `journal`: what the number is one of. Where that journal ended before it (the file was put back), the page
        begins after its end; one that is not known here is as if nothing had been fetched yet. None: any.
        `kinds`: only of these; None: of all.
        """
        return await self._work(lambda db: _page(db, journal, since, limit, kinds))

    async def journal(self) -> str:
        """Return the id of the journal that is written now; empty where the file is too old to have one."""
        return await self._work(_newest_journal)


def _newest_journal(db: sqlite3.Connection) -> str:
    """Return the id, empty where an older file could be opened for reading only."""
    if not db.execute("SELECT 1 FROM sqlite_master WHERE name='journals'").fetchone():
        return ""
    return str(db.execute("SELECT id FROM journals ORDER BY n DESC LIMIT 1").fetchone()[0])


def begin_journal(db: sqlite3.Connection) -> None:
    """Let what is written from now on belong to a journal of its own."""
    known = db.execute("SELECT 1 FROM journals").fetchone()
    row = (uuid.uuid4().hex, _next_seq(db) if known else 1)
    db.execute("INSERT INTO journals(id, first_seq) VALUES (?, ?)", row)
    db.execute("DELETE FROM journals WHERE n <= (SELECT max(n) FROM journals) - ?", (JOURNALS_KEPT,))


def trim_records(db: sqlite3.Connection) -> int:
    """Drop the oldest numbers beyond the bound, some at a time, and the circumstances of none; return how many went.

    Circumstances are numbered as they follow each other, so that none is older than those of the oldest record.
    """
    beyond = min(_oldest_seq(db) + TRIM_EACH, _next_seq(db) - RECORDS_KEPT)
    gone = db.execute("DELETE FROM records WHERE seq<?", (beyond,)).rowcount
    if gone:
        db.execute(
            "DELETE FROM circumstances WHERE n < coalesce("
            "(SELECT circumstances FROM records WHERE circumstances IS NOT NULL ORDER BY seq LIMIT 1),"
            " (SELECT value FROM meta WHERE key=?))",
            (CIRCUMSTANCES,),
        )
    return gone


def _next_seq(db: sqlite3.Connection) -> int:
    row = db.execute("SELECT seq FROM sqlite_sequence WHERE name='records'").fetchone()
    return int(row[0]) + 1 if row else 1


def _oldest_seq(db: sqlite3.Connection) -> int:
    oldest = db.execute("SELECT min(seq) FROM records").fetchone()[0]
    return _next_seq(db) if oldest is None else int(oldest)


def _page(
    db: sqlite3.Connection, journal: str | None, since: int, limit: int, kinds: Collection[str] | None
) -> RecordPage:
    oldest, following = _oldest_seq(db), _next_seq(db)
    begin = _begin(db, journal, since)
    name, first, end = _journal_of(db, begin)
    begin = max(begin, first)
    lost = (begin, min(oldest - 1, end)) if begin < min(oldest, end + 1) else None
    last = end if kinds is None else min(end, max(begin, oldest) + PAGE_SCAN - 1)
    sql = (
        "SELECT seq, kind, ref, body FROM records LEFT JOIN circumstances ON n=circumstances"
        " WHERE seq BETWEEN ?1 AND ?2 AND (?4 IS NULL OR kind IN (SELECT value FROM json_each(?4)))"
        " ORDER BY seq LIMIT ?3"
    )
    wanted = None if kinds is None else json.dumps(sorted(kinds))
    rows = db.execute(sql, (begin, last, limit, wanted)).fetchall()
    told = _told(db, rows)
    through = told[-1].seq if len(told) < len(rows) or len(rows) == limit else last
    return RecordPage(name, first, _before(db, first), lost, told, through, oldest, following)


def _before(db: sqlite3.Connection, first_seq: int) -> tuple[str, int] | None:
    """Return the journal that wrote the number before one, with that number."""
    row = db.execute("SELECT id FROM journals WHERE first_seq<? ORDER BY n DESC LIMIT 1", (first_seq,)).fetchone()
    return (str(row[0]), first_seq - 1) if row else None


def _begin(db: sqlite3.Connection, journal: str | None, since: int) -> int:
    """Return the number a page begins with."""
    if journal is None:
        return since
    row = db.execute("SELECT n FROM journals WHERE id=?", (journal,)).fetchone()
    if row is None:
        return 1
    after = db.execute("SELECT min(first_seq) FROM journals WHERE n>?", row).fetchone()[0]
    return since if after is None else min(since, int(after))


def _journal_of(db: sqlite3.Connection, seq: int) -> tuple[str, int, int]:
    """Return id, first and last number of the journal that a number belongs to; the oldest known for an older one.

    Of journals that begin with the same number all but the newest wrote nothing.
    """
    sql = "SELECT n, id, first_seq FROM journals WHERE first_seq<=? ORDER BY n DESC LIMIT 1"
    row = db.execute(sql, (seq,)).fetchone()
    row = row or db.execute("SELECT n, id, first_seq FROM journals ORDER BY first_seq, n DESC LIMIT 1").fetchone()
    after = db.execute("SELECT min(first_seq) FROM journals WHERE n>?", (row[0],)).fetchone()[0]
    return str(row[1]), int(row[2]), (_next_seq(db) if after is None else int(after)) - 1


def _told(db: sqlite3.Connection, rows: list[tuple[int, str, int, str | None]]) -> list[StreamRecord]:
    records: list[StreamRecord] = []
    size = 0
    for seq, kind, ref, circumstances in rows:
        at, text = _row(db, kind, ref)
        size += len(text or "") + len(circumstances or "")
        if records and size > PAGE_BYTES:
            break
        records.append(StreamRecord(seq, kind, at, _object(text), _object(circumstances) or {}))
    return records


def _row(db: sqlite3.Connection, kind: str, ref: int) -> tuple[str | None, str | None]:
    """Return time and text of a row; None for both where it is gone, or not JSON."""
    try:
        row = db.execute(SOURCES[kind], (ref,)).fetchone() if kind in SOURCES else None
    except sqlite3.OperationalError as exc:
        if "malformed JSON" not in str(exc):
            raise
        row = None
    return row or (None, None)


def _object(text: str | None) -> dict[str, Any] | None:
    try:
        found = json.loads(text) if text else None
    except ValueError:
        return None
    return found if isinstance(found, dict) else None
