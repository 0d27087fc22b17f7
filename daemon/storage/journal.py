"""Journal: every job, look, move and result in SQLite, written before anything is published.

One writer thread owns the connection, so the event loop never waits for the disk and writes keep their order. WAL with
synchronous=FULL: what was acknowledged survives a power cut. `seq` numbers every published event; numbers are handed
out from reserved blocks, so that they never repeat, not even after a crash.

A journal that cannot be written is in trouble and says so; `check` tries to go on when there is room again. One that
was deleted or replaced waits for `mend`, for what it held may be lost.
"""

from __future__ import annotations

import asyncio
import json
import sqlite3
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import structlog

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult
from daemon.platform.clock import utc_now
from daemon.storage.event_numbers import BLOCK, SPARE, EventNumbers
from daemon.storage.journal_file import FileLost, JournalFile
from daemon.storage.journal_schema import BUSY_MS, is_damage, set_meta
from daemon.storage.pinned_state import PinnedState

SEQ_BLOCK = BLOCK
JOBS_KEPT = 200_000
REPORTS_KEPT = 50_000
ALERTS_KEPT = 10_000
TRIM_EACH = 2_000
"""At most so many rows of a table go at once: the writer thread must not be held up."""
NEXT_SEQ = "next_seq"
PINNED = frozenset({"reference_doubt"})
"""Things kept that a full disk must not keep out; they must be small."""
LOST_ADVICE = "`reset` writes the journal to its place again; find out who deleted or replaced it"
FULL_ADVICE = "free disk space; the daemon goes on by itself"
DAMAGE_ADVICE = "`reset` moves the damaged file aside and begins a new journal"
T = TypeVar("T")
log = structlog.get_logger(__name__)


class StoredJob(NamedTuple):
    """What the journal knows of a job; `result` is None while it has none."""

    request: str
    result: JobResult | None


class Journal:
    """Keep and find again. Open with `Journal.open`; every method may be awaited from one event loop."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = JournalFile(path)
        self._pinned = PinnedState(path.with_suffix(".pinned"))
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="journal")
        self._numbers = EventNumbers()
        self._reserving: asyncio.Task[None] | None = None
        self._trouble: Fault | None = None
        self._goes_on_by_itself = True
        self.troubled = asyncio.Event()
        """Set when trouble begins; who looks after the journal waits for it and clears it."""

    @classmethod
    async def open(cls, path: Path) -> Journal:
        """Open or create the journal; one that cannot be written is in trouble: see `trouble`.

        A damaged file is moved aside and a new one begun: see `moved_to`. One of a newer version is refused: `Fault`.
        """
        journal = cls(path)
        try:
            await journal._in_writer(journal._open)
        except sqlite3.NotSupportedError as exc:
            journal._writer.shutdown()
            advice = "install the newer program again, or move the file aside to begin a new journal"
            raise Fault(FaultCode.JOURNAL_FAILED, f"{path}: {exc}", advice=advice) from exc
        await journal.reserve_seqs()
        return journal

    def _open(self) -> None:
        with suppress(OSError):
            self._pinned.load()
        self._numbers.begin(int(self._pinned.get(NEXT_SEQ) or 0))
        try:
            self._file.open()
        except sqlite3.NotSupportedError:
            raise
        except (sqlite3.Error, OSError) as exc:
            self._note_trouble(exc)
            with suppress(sqlite3.Error):
                self._file.open_to_read()
        self._numbers.begin(self._file.first_seq)

    async def close(self) -> None:
        """Give unused numbers back, write all and close; a file found damaged is left to be looked through."""
        if self._reserving is not None:
            await self._reserving
        try:
            await self._in_writer(self._close)
        finally:
            self._writer.shutdown()

    def _close(self) -> None:
        try:
            self._write_down(self._numbers.upcoming)
            self._file.close()
        except (sqlite3.Error, OSError) as exc:
            log.error("journal_not_closed", error=str(exc))

    # --- trouble ----------------------------------------------------------------------------------------------

    @property
    def trouble(self) -> Fault | None:
        """What keeps the journal from being written, None while it is well."""
        return self._trouble

    @property
    def moved_to(self) -> Path | None:
        """Where a predecessor that could not be read was put, None if there was none."""
        return self._file.moved_to

    @property
    def moved_because(self) -> str:
        """Why it was put there."""
        return self._file.moved_because

    async def check(self) -> Fault | None:
        """Look whether the journal is in its place and has room; in trouble, try to go on. Return what is wrong."""
        if self._trouble is None:
            with suppress(Fault):
                await self._run(lambda _db: self._file.require_room())
            if self._trouble is None:
                return None
        if self._goes_on_by_itself:
            await self._try(self._file.go_on)
        else:
            with suppress(sqlite3.Error, OSError):
                await self._in_writer(self._file.rescue)
        return self._trouble

    async def mend(self) -> Fault | None:
        """Do what a person's `reset` asks for: put back what was deleted, begin again where it is damaged."""
        if self._trouble is not None:
            await self._try(self._file.mend)
        return self._trouble

    async def _try(self, way: Callable[[], None]) -> None:
        """Leave the trouble if one way out of it succeeds."""
        try:
            await self._in_writer(way)
        except (sqlite3.Error, OSError) as exc:
            self._note_trouble(exc)
            return
        self._numbers.begin(self._file.first_seq)
        self._trouble, self._goes_on_by_itself = None, True
        await self.reserve_seqs()

    def _note_trouble(self, exc: Exception) -> Fault:
        """Remember what is wrong; the first cause stays, unless the file was lost or is damaged."""
        damaged = isinstance(exc, sqlite3.Error) and is_damage(exc)
        by_itself = not (isinstance(exc, FileLost) or damaged)
        advice = FULL_ADVICE if by_itself else DAMAGE_ADVICE if damaged else LOST_ADVICE
        fault = Fault(FaultCode.JOURNAL_FAILED, f"the journal cannot be written: {exc}"[:300], advice=advice)
        if self._trouble is None or (self._goes_on_by_itself and not by_itself):
            self._trouble, self._goes_on_by_itself = fault, by_itself
            log.error("journal_in_trouble", error=str(exc), advice=advice)
        return fault

    # --- numbers ----------------------------------------------------------------------------------------------

    async def reserve_seqs(self) -> None:
        """Write ahead that a block of event numbers is taken, so that none is ever given twice.

        Done before each job, with each heartbeat, and whenever half a block is used. Never raises: what cannot be
        written is not reserved, and no number beyond is given.
        """
        end = self._numbers.wanted
        if end is not None and self._numbers.upcoming > 0 and await self._in_writer(lambda: self._write_down(end)):
            self._numbers.reserved(end)

    def _write_down(self, next_seq: int) -> bool:
        """Write the first free number to both places it is looked for; return whether one of them has it."""
        written = False
        try:
            self._pinned.store(NEXT_SEQ, next_seq)
            written = True
        except OSError as exc:
            log.warning("numbers_not_pinned", error=str(exc))
        if self._file.is_writable:
            try:
                self._file.do(lambda db: set_meta(db, "next_seq", next_seq))
                written = True
            except (sqlite3.Error, OSError) as exc:
                self._note_trouble(exc)
        return written

    def take_seq(self) -> int:
        """Return the next event number; raise `Fault` if none is reserved. A block that gets short is followed up."""
        if self._numbers.wanted is not None and (self._reserving is None or self._reserving.done()):
            self._reserving = asyncio.create_task(self.reserve_seqs(), name="event numbers")
        return _number(self._numbers.take(SPARE))

    def lend_seq(self) -> int:
        """Return the number for an event that has yet to be written; `settle_seq` says whether it was."""
        return _number(self._numbers.lend())

    def settle_seq(self, *, used: bool) -> None:
        """Keep the number that was lent, or take it back; until then nobody may take another."""
        self._numbers.settle(used=used)

    @property
    def upcoming_seq(self) -> int:
        """The number the next event will carry."""
        return self._numbers.upcoming

    # --- jobs -------------------------------------------------------------------------------------------------

    async def add_job(self, job_id: str, op: str, request: str) -> None:
        """Write a job down before anything is done for it."""
        row = (job_id, op, request, utc_now())

        def write(db: sqlite3.Connection) -> None:
            self._file.require_room()  # for its looks and its result, too
            db.execute("INSERT INTO jobs(id, op, request, received_at) VALUES (?,?,?,?)", row)

        if self._trouble is not None:
            raise self._trouble
        await self._run(write)

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
        """Keep one thing under a name, instead of what was kept there; `body` must not change meanwhile.

        What is pinned counts as kept even if the journal cannot be written.
        """
        if key in PINNED and await self._pin(key, body):
            return
        sql = "INSERT INTO kept VALUES (?, ?) ON CONFLICT(key) DO UPDATE SET body=excluded.body"
        await self._run(lambda db: db.execute(sql, (key, json.dumps(body))))

    async def _pin(self, key: str, body: dict[str, Any]) -> bool:
        """Keep one thing in place; return whether that was possible."""
        try:
            await self._in_writer(lambda: self._pinned.store(key, body))
        except OSError as exc:
            log.warning("not_pinned", key=key, error=str(exc))
            return False
        return True

    async def kept(self, key: str) -> dict[str, Any] | None:
        """Return what is kept under a name; None for nothing, or for what cannot be read."""
        pinned = self._pinned.get(key) if key in PINNED else None
        if isinstance(pinned, dict):
            return pinned
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
        gone = await self._run(lambda db: _trim(db, measurements_kept))
        await self._run(_work_off_wal)
        return gone

    async def _run(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Do `work` in the writer thread; a failing disk is a `Fault`, and trouble."""
        try:
            return await self._in_writer(lambda: self._file.do(work))
        except sqlite3.IntegrityError as exc:
            raise Fault(FaultCode.JOURNAL_FAILED, f"the journal answers: {exc}") from exc
        except (sqlite3.Error, OSError) as exc:
            fault = self._note_trouble(exc)
            self.troubled.set()
            raise fault from exc

    async def _in_writer(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._writer, work)


def _number(found: int | None) -> int:
    if found is None:
        raise Fault(FaultCode.JOURNAL_FAILED, "no event number is reserved, and none can be while the disk is full")
    return found


def _work_off_wal(db: sqlite3.Connection) -> None:
    """Put into the file what is in its write-ahead log, and empty that, unless somebody reads just now."""
    db.execute("PRAGMA busy_timeout=0")
    try:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
    finally:
        db.execute(f"PRAGMA busy_timeout={BUSY_MS}")


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
