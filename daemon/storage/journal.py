"""Journal: every job, look, move and result in SQLite, written before anything is published.

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

import structlog

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult
from daemon.platform.clock import utc_now
from daemon.storage.journal_schema import close_file, is_damage, open_file, set_meta

log = structlog.get_logger(__name__)
SEQ_BLOCK = 1000
JOBS_KEPT = 200_000
REPORTS_KEPT = 50_000
ALERTS_KEPT = 10_000
TRIM_EACH = 2_000
"""At most so many rows of a table go at once: the writer thread must not be held up."""
ROOM, ROOM_BYTES = "room", 1_000_000
"""Name and size of what is written to see whether the disk has room again."""
T = TypeVar("T")


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
        self.moved_to: Path | None = None
        """Where a predecessor that could not be read was put, None if there was none."""
        self.moved_because = ""
        self._damaged = False

    @classmethod
    async def open(cls, path: Path) -> Journal:
        """Open or create the journal; raise `Fault` if it cannot be used.

        A damaged file is moved aside and a new one begun: see `moved_to`. One of a newer version is refused.
        """
        writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="journal")
        try:
            opened = await asyncio.get_running_loop().run_in_executor(writer, open_file, path)
        except (sqlite3.Error, OSError) as exc:
            writer.shutdown()
            newer = isinstance(exc, sqlite3.NotSupportedError)
            advice = (
                "install the newer program again, or move the file aside to begin a new journal"
                if newer
                else "see that the folder is the service's own and the disk is not full"
            )
            raise Fault(FaultCode.JOURNAL_FAILED, f"{path}: {exc}", advice=advice) from exc
        journal = cls(opened.db, writer, opened.next_seq)
        journal.moved_to, journal.moved_because = opened.moved_to, opened.why
        return journal

    async def close(self) -> None:
        """Give unused numbers back, write all and close; a file found damaged is left to be looked through.

        On a full disk the numbers are not given back, and nothing else is lost.
        """
        try:
            if self._damaged:
                await self._run(lambda db: db.close())
                return
            try:
                await self._run(lambda db: set_meta(db, "next_seq", self._next_seq))
                await self._run(close_file)
            except Fault as disk:
                log.error("journal_not_closed_in_order", error=disk.message)
                await self._run(lambda db: db.close())
        finally:
            self._writer.shutdown()

    async def reserve_seqs(self) -> None:
        """Write ahead that a block of event numbers is taken, so that none is ever given twice.

        Called before each job and with each heartbeat, between which far fewer than half a block are used.
        """
        if self._next_seq + SEQ_BLOCK // 2 >= self._reserved:
            reserved = self._next_seq + SEQ_BLOCK
            await self._run(lambda db: set_meta(db, "next_seq", reserved))
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
        sql = (
            "SELECT (SELECT coalesce(sum(touches), 0) FROM reports)"
            " + coalesce((SELECT value FROM meta WHERE key='touches_trimmed'), 0)"
        )
        row = await self._run(lambda db: db.execute(sql).fetchone())
        return int(row[0])

    async def add_alert(self, seq: int, body: dict[str, Any]) -> None:
        """Write down an alert."""
        row = (seq, utc_now(), json.dumps(body))
        await self._run(lambda db: db.execute("INSERT INTO alerts(seq, at, body) VALUES (?,?,?)", row))

    # --- maintenance ------------------------------------------------------------------------------------------

    async def alerts(self, since: int, limit: int) -> list[dict[str, Any]]:
        """Return alert events from number `since` on, oldest first, each with `seq` and `time`."""
        sql = "SELECT seq, at, body FROM alerts WHERE seq>=? ORDER BY seq LIMIT ?"
        rows = await self._run(lambda db: db.execute(sql, (since, limit)).fetchall())
        return [{"seq": seq, "time": at, **json.loads(body)} for seq, at, body in rows]

    async def set_standing(self, name: str, body: dict[str, Any] | None) -> None:
        """Keep an alert that stands as it is now, or, with None, no longer."""
        if body is None:
            await self._run(lambda db: db.execute("DELETE FROM standing WHERE name=?", (name,)))
            return
        sql = "INSERT INTO standing VALUES (?, ?) ON CONFLICT(name) DO UPDATE SET body=excluded.body"
        row = (name, json.dumps(body))
        await self._run(lambda db: db.execute(sql, row))

    async def standing(self) -> list[dict[str, Any]]:
        """Return the alerts that stand."""
        rows = await self._run(lambda db: db.execute("SELECT body FROM standing ORDER BY name").fetchall())
        return [json.loads(row[0]) for row in rows]

    async def add_measurement(self, at: str, touches: int, job: str, body: dict[str, Any]) -> int:
        """Write down what was measured; return the row's number."""
        row = (at, touches, job, json.dumps(body))
        sql = "INSERT INTO measurements(at, touches, job, body) VALUES (?,?,?,?)"
        return int(await self._run(lambda db: db.execute(sql, row).lastrowid or 0))

    async def measurements(self, after: int, limit: int) -> list[tuple[int, str, int, str, dict[str, Any]]]:
        """Return rows (number, at, touches, job, body) with numbers above `after`, oldest first."""
        sql = "SELECT n, at, touches, job, body FROM measurements WHERE n>? ORDER BY n LIMIT ?"
        rows = await self._run(lambda db: db.execute(sql, (after, limit)).fetchall())
        return [(n, at, touches, job, json.loads(body)) for n, at, touches, job, body in rows]

    async def keep(self, key: str, body: dict[str, Any]) -> None:
        """Keep one thing under a name, instead of what was kept there; `body` must not change meanwhile."""
        sql = "INSERT INTO kept VALUES (?, ?) ON CONFLICT(key) DO UPDATE SET body=excluded.body"
        await self._run(lambda db: db.execute(sql, (key, json.dumps(body))))

    async def try_room(self) -> None:
        """Write and remove as much as a job may need: raise `Fault` if the disk has no room for it.

        Something small may find room in pages that are free by chance, where the next job then finds none.
        """
        await self.keep(ROOM, {"filler": "x" * ROOM_BYTES})
        await self._run(lambda db: db.execute("DELETE FROM kept WHERE key=?", (ROOM,)))

    async def kept(self, key: str) -> dict[str, Any] | None:
        """Return what is kept under a name; None for nothing, or for what cannot be read."""
        row = await self._run(lambda db: db.execute("SELECT body FROM kept WHERE key=?", (key,)).fetchone())
        try:
            body = json.loads(row[0]) if row else None
        except ValueError:
            return None
        return body if isinstance(body, dict) else None

    async def trim(self, measurements_kept: int) -> int:
        """Drop the oldest rows beyond each table's bound, some at a time; return how many went.

        Touches are still counted when their reports are gone. An id whose job is gone is taken for a new one.
        """
        return await self._run(lambda db: _trim(db, measurements_kept))

    async def _run(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Do `work` in the writer thread; a failing disk is a `Fault`."""
        try:
            return await asyncio.get_running_loop().run_in_executor(self._writer, work, self._db)
        except sqlite3.Error as exc:
            self._damaged = self._damaged or is_damage(exc)
            raise Fault(FaultCode.JOURNAL_FAILED, f"the journal answers: {exc}") from exc


def _trim(db: sqlite3.Connection, measurements_kept: int) -> int:
    """Drop what is beyond the bounds, in one transaction."""
    gone = 0
    db.execute("BEGIN")
    try:
        for table, kept in (("measurements", measurements_kept), ("reports", REPORTS_KEPT)):
            rows = _oldest(db, table, "n", kept)
            if rows and table == "reports":
                sql = "SELECT coalesce(sum(touches), 0) FROM reports WHERE n<=?"
                _add_meta(db, "touches_trimmed", int(db.execute(sql, (rows,)).fetchone()[0]))
            gone += db.execute(f"DELETE FROM {table} WHERE n<=?", (rows,)).rowcount  # noqa: S608  # names are ours
        gone += db.execute("DELETE FROM alerts WHERE seq<=?", (_oldest(db, "alerts", "seq", ALERTS_KEPT),)).rowcount
        last = (_oldest(db, "jobs", "rowid", JOBS_KEPT),)
        db.execute("DELETE FROM steps WHERE job IN (SELECT id FROM jobs WHERE rowid<=? AND result IS NOT NULL)", last)
        gone += db.execute("DELETE FROM jobs WHERE rowid<=? AND result IS NOT NULL", last).rowcount
    except BaseException:
        db.execute("ROLLBACK")
        raise
    db.execute("COMMIT")
    return gone


def _oldest(db: sqlite3.Connection, table: str, key: str, kept: int) -> int:
    """Return the key up to which rows are beyond the bound, of `TRIM_EACH` at most; 0 if none is."""
    count = int(db.execute(f"SELECT count(*) FROM {table}").fetchone()[0])  # noqa: S608  # names are ours
    beyond = min(count - kept, TRIM_EACH)
    if beyond <= 0:
        return 0
    sql = f"SELECT {key} FROM {table} ORDER BY {key} LIMIT 1 OFFSET ?"  # noqa: S608  # names are ours
    return int(db.execute(sql, (beyond - 1,)).fetchone()[0])


def _add_meta(db: sqlite3.Connection, key: str, more: int) -> None:
    """Add to one number."""
    sql = "INSERT INTO meta VALUES (?, ?) ON CONFLICT(key) DO UPDATE SET value=value+excluded.value"
    db.execute(sql, (key, more))
