"""The journal: every job, look, move and result in SQLite, written before anything is published.

One writer thread owns the connection, so the event loop never waits for the disk and writes keep their order. WAL with
synchronous=FULL: what was acknowledged survives a power cut. `seq` numbers every published event; numbers are handed
out from reserved blocks, so that they never repeat, not even after a crash.
"""

from __future__ import annotations

import asyncio
import json
import sqlite3
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from daemon.clock import utc_now
from daemon.faults import Fault, Kind
from daemon.messages import JobResult

SCHEMA_VERSION = 1
SEQ_BLOCK = 1000
T = TypeVar("T")

_SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value INTEGER NOT NULL) STRICT;
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, op TEXT NOT NULL, request TEXT NOT NULL, received_at TEXT NOT NULL,
    seq INTEGER UNIQUE, finished_at TEXT, ok INTEGER, result TEXT
) STRICT;
CREATE TABLE steps (
    n INTEGER PRIMARY KEY AUTOINCREMENT, job TEXT NOT NULL REFERENCES jobs(id), at TEXT NOT NULL,
    kind TEXT NOT NULL CHECK (kind IN ('look', 'move')), body TEXT NOT NULL
) STRICT;
CREATE INDEX steps_of_job ON steps(job);
CREATE TABLE reports (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, job TEXT, retest TEXT, touches INTEGER NOT NULL
) STRICT;
CREATE TABLE alerts (seq INTEGER PRIMARY KEY, at TEXT NOT NULL, body TEXT NOT NULL) STRICT;
"""


class StoredJob(NamedTuple):
    """What the journal knows of a job; `result` is None while it has none."""

    request: str
    result: JobResult | None


class Journal:
    """Keep and find again. Open with `Journal.open`; every method may be awaited from one event loop."""

    def __init__(self, db: sqlite3.Connection, writer: ThreadPoolExecutor, next_seq: int) -> None:
        self._db = db
        self._writer = writer
        self._next_seq = next_seq
        self._reserved = next_seq

    @classmethod
    async def open(cls, path: Path) -> Journal:
        """Open or create the journal; raise `Fault` if it cannot be used."""
        writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="journal")
        try:
            db, next_seq = await asyncio.get_running_loop().run_in_executor(writer, _connect, path)
        except (sqlite3.Error, OSError) as exc:
            writer.shutdown()
            raise Fault(Kind.JOURNAL_FAILED, f"{path}: {exc}", advice="move the file aside or free disk space") from exc
        return cls(db, writer, next_seq)

    async def close(self) -> None:
        """Give unused numbers back, write all and close."""
        await self._run(lambda db: _set_meta(db, "next_seq", self._next_seq))
        await self._run(lambda db: db.close())
        self._writer.shutdown()

    async def reserve_seqs(self) -> None:
        """Write ahead that a block of event numbers is taken, so that none is ever given twice.

        Called before each job and with each heartbeat, between which far fewer than half a block are used.
        """
        if self._next_seq + SEQ_BLOCK // 2 >= self._reserved:
            reserved = self._next_seq + SEQ_BLOCK
            await self._run(lambda db: _set_meta(db, "next_seq", reserved))
            self._reserved = reserved

    def take_seq(self) -> int:
        """Return the next event number."""
        seq = self._next_seq
        self._next_seq += 1
        return seq

    @property
    def upcoming_seq(self) -> int:
        """The number the next event will carry."""
        return self._next_seq

    async def add_job(self, job_id: str, op: str, request: str) -> None:
        """Write a job down before anything is done for it."""
        row = (job_id, op, request, utc_now())
        await self._run(lambda db: db.execute("INSERT INTO jobs(id, op, request, received_at) VALUES (?,?,?,?)", row))

    async def add_step(self, job_id: str, kind: str, body: dict[str, Any]) -> None:
        """Write down one look or move of a job."""
        row = (job_id, utc_now(), kind, json.dumps(body))
        await self._run(lambda db: db.execute("INSERT INTO steps(job, at, kind, body) VALUES (?,?,?,?)", row))

    async def finish_job(self, result: JobResult) -> None:
        """Write a job's result down."""
        row = (result.seq, result.finished_at, int(result.ok), result.model_dump_json(), result.id)
        sql = "UPDATE jobs SET seq=?, finished_at=?, ok=?, result=? WHERE id=?"
        await self._run(lambda db: db.execute(sql, row))

    async def job(self, job_id: str) -> StoredJob | None:
        """Find one job."""
        row = await self._run(
            lambda db: db.execute("SELECT request, result FROM jobs WHERE id=?", (job_id,)).fetchone()
        )
        return StoredJob(row[0], JobResult.model_validate_json(row[1]) if row[1] else None) if row else None

    async def results(self, since: int, limit: int) -> list[JobResult]:
        """Return results from event number `since` on, oldest first."""
        sql = "SELECT result FROM jobs WHERE seq>=? ORDER BY seq LIMIT ?"
        rows = await self._run(lambda db: db.execute(sql, (since, limit)).fetchall())
        return [JobResult.model_validate_json(row[0]) for row in rows]

    async def last_result(self) -> JobResult | None:
        """Return the newest result."""
        sql = "SELECT result FROM jobs WHERE seq IS NOT NULL ORDER BY seq DESC LIMIT 1"
        row = await self._run(lambda db: db.execute(sql).fetchone())
        return JobResult.model_validate_json(row[0]) if row else None

    async def unfinished(self) -> list[tuple[str, str]]:
        """Return (id, op) of jobs without a result: a stop caught them."""
        sql = "SELECT id, op FROM jobs WHERE result IS NULL ORDER BY received_at"
        return await self._run(lambda db: db.execute(sql).fetchall())

    async def add_report(self, job_id: str | None, retest: str | None, touches: int) -> None:
        """Write down what the tester saw."""
        row = (utc_now(), job_id, retest, touches)
        await self._run(lambda db: db.execute("INSERT INTO reports(at, job, retest, touches) VALUES (?,?,?,?)", row))

    async def touches(self) -> int:
        """Return all touches reported so far."""
        row = await self._run(lambda db: db.execute("SELECT coalesce(sum(touches), 0) FROM reports").fetchone())
        return int(row[0])

    async def add_alert(self, seq: int, body: dict[str, Any]) -> None:
        """Write down an alert."""
        row = (seq, utc_now(), json.dumps(body))
        await self._run(lambda db: db.execute("INSERT INTO alerts(seq, at, body) VALUES (?,?,?)", row))

    async def _run(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Do `work` in the writer thread; a failing disk is a `Fault`."""
        try:
            return await asyncio.get_running_loop().run_in_executor(self._writer, work, self._db)
        except sqlite3.Error as exc:
            raise Fault(Kind.JOURNAL_FAILED, f"the journal answers: {exc}") from exc


def _connect(path: Path) -> tuple[sqlite3.Connection, int]:
    """Open the file, make or check its schema; return the connection and the first free event number."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # Only the writer thread uses the connection; close() comes through it too.
    db = sqlite3.connect(path, isolation_level=None, timeout=5.0, check_same_thread=False)
    db.execute("PRAGMA journal_mode=WAL")
    db.execute("PRAGMA synchronous=FULL")
    version = db.execute("PRAGMA user_version").fetchone()[0]
    if version > SCHEMA_VERSION:
        db.close()
        raise sqlite3.DatabaseError(f"written by a newer version (schema {version}, this one knows {SCHEMA_VERSION})")
    if version == 0:
        db.executescript(f"BEGIN; {_SCHEMA} PRAGMA user_version={SCHEMA_VERSION}; COMMIT;")
    row = db.execute("SELECT value FROM meta WHERE key='next_seq'").fetchone()
    return db, int(row[0]) if row else 1


def _set_meta(db: sqlite3.Connection, key: str, value: int) -> None:
    """Write one number."""
    db.execute("INSERT INTO meta VALUES (?, ?) ON CONFLICT(key) DO UPDATE SET value=excluded.value", (key, value))
