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
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import structlog

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_mark import PointMark
from daemon.domain.point_test import PadWear, PointRecord
from daemon.domain.results import JobResult
from daemon.platform.clock import utc_now
from daemon.storage.event_numbers import BLOCK, SPARE, EventNumbers
from daemon.storage.journal_file import FileLost, JournalFile, NotAFile
from daemon.storage.journal_schema import BUSY_MS, is_damage, set_meta
from daemon.storage.pinned_state import PinnedState
from daemon.storage.point_marks import PointMarks
from daemon.storage.record_stream import RecordStream, trim_records
from daemon.storage.run_journal import RunJournal

SEQ_BLOCK = BLOCK
JOBS_KEPT = 200_000
REPORTS_KEPT = 50_000
ALERTS_KEPT = 10_000
TOUCHES_KEPT = 500_000
ORDERS_KEPT = 200_000
POINTS_KEPT = 500_000
RUNS_KEPT = 50_000
TOUCH_FACTS = frozenset(
    {
        "z_end_um", "pressed_um", "force_n", "speed_um_s", "ended_by", "verdict", "value", "unit", "presses", "proof",
        "reading",
    }
)  # fmt: skip
"""Columns of a touch that are known after it began."""
MAX_ROW = 2**63 - 1
TRIM_EACH = 2_000
"""At most so many rows of a table go at once: the writer thread must not be held up."""
VERIFY_LOG_EVERY_S = 10.0
"""So often the whole write-ahead log is read: some 4 MB at most, which takes some ms beside the event loop."""
NEXT_SEQ = "next_seq"
PINNED = frozenset({"reference_doubt"})
"""Things kept that a full disk must not keep out; they must be small."""
LOST_ADVICE = "`reset` writes the journal to its place again; find out who deleted or replaced it"
FULL_ADVICE = "free disk space; the daemon goes on by itself"
PLACE_ADVICE = "move away what lies there; the daemon goes on by itself"
DENIED_ADVICE = "see that its folder is there and that the daemon's user may write; the daemon goes on by itself"
DAMAGE_ADVICE = "`reset` moves the damaged file aside and begins a new journal"
_DENIED = frozenset({sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM, sqlite3.SQLITE_READONLY})
T = TypeVar("T")
log = structlog.get_logger(__name__)


class StoredJob(NamedTuple):
    """What the journal knows of a job; `result` is None while it has none."""

    request: str
    result: JobResult | None


class PastWanted(NamedTuple):
    """Which results are looked for; None: any."""

    op: str | None = None
    test_point: str | None = None
    board_id: str | None = None
    outcome: str | None = None


_BOARD = "json_extract(request, '$.board_id')"
_COLUMNS = PastWanted("op", "json_extract(result, '$.test_point')", _BOARD, "json_extract(result, '$.outcome')")
"""As the indices have them."""


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
        self._verify_at_s = 0.0
        self.runs = RunJournal(self._run)
        """Runs over boards, and the records of their points."""
        self.marks = PointMarks(self._run)
        """What people said of points of boards."""
        self.stream = RecordStream(self._run)
        """All that is kept, in one order and under one count."""
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
            with suppress(sqlite3.Error, OSError):
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
                await self._run(lambda _db: self._look())
            if self._trouble is None:
                return None
        if self._goes_on_by_itself:
            await self._try(self._file.go_on)
        else:
            with suppress(sqlite3.Error, OSError):
                await self._in_writer(self._file.rescue)
        return self._trouble

    def _look(self) -> None:
        """Raise if there is no room, or now and then if the write-ahead log was changed by somebody else."""
        self._file.require_room()
        if time.monotonic() >= self._verify_at_s:
            self._file.verify_log()
            self._verify_at_s = time.monotonic() + VERIFY_LOG_EVERY_S

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
        by_itself = not (isinstance(exc, FileLost) or (isinstance(exc, sqlite3.Error) and is_damage(exc)))
        advice = _advice(exc)
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

    async def history(self, wanted: PastWanted, before: int | None, limit: int) -> list[tuple[JobResult, str | None]]:
        """Return results below event number `before`, newest first, each with the board its request named."""
        asked = [(column, value) for column, value in zip(_COLUMNS, wanted, strict=True) if value is not None]
        where = " AND ".join(["seq IS NOT NULL", *(f"{column}=?" for column, _ in asked)])
        values: list[str | int] = [value for _, value in asked]
        if before is not None:
            where, values = f"{where} AND seq<?", [*values, before]
        sql = f"SELECT result, {_BOARD} FROM jobs WHERE {where} ORDER BY seq DESC LIMIT ?"  # noqa: S608  # our columns
        rows = await self._run(lambda db: db.execute(sql, (*values, limit)).fetchall())
        return [(JobResult.model_validate_json(result), board) for result, board in rows]

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

    # --- orders -----------------------------------------------------------------------------------------------

    async def begin_order(self, client: str, role: str, by: str | None, op: str, fields: str) -> int:
        """Write down who gave an order, with its fields as JSON, before it is carried out; return its number."""
        row = (utc_now(), client, role, by, op, fields)
        sql = "INSERT INTO orders(at, client, role, by, op, fields) VALUES (?,?,?,?,?,?)"
        return int(await self._run(lambda db: db.execute(sql, row).lastrowid or 0))

    async def end_order(self, number: int, outcome: str) -> None:
        """Write down what came of an order."""
        await self._run(lambda db: db.execute("UPDATE orders SET outcome=? WHERE n=?", (outcome, number)))

    async def orders(self, before: int | None, limit: int) -> list[dict[str, Any]]:
        """Return orders of a number below `before`, newest first."""
        sql = "SELECT n, at, client, role, by, op, fields, outcome FROM orders WHERE n<? ORDER BY n DESC LIMIT ?"
        bound = MAX_ROW if before is None else before
        rows = await self._run(lambda db: db.execute(sql, (bound, limit)).fetchall())
        names = ("n", "at", "client", "role", "by", "op", "fields", "outcome")
        return [dict(zip(names, row, strict=True)) | {"fields": json.loads(row[6])} for row in rows]

    # --- touches ----------------------------------------------------------------------------------------------

    async def begin_touch(
        self, job_id: str, board_id: str | None, point: str, *, visit: str | None = None, rung: str | None = None
    ) -> int:
        """Write a touch down before the needle goes down, so that a kill loses none; return its number.

        `visit`: the test of the point, over restarts, of which it is a part. `rung`: why it is touched.
        """
        row = (utc_now(), job_id, board_id, point, visit, rung)
        sql = "INSERT INTO touches(at, job, board_id, point, visit, rung) VALUES (?,?,?,?,?,?)"
        return int(await self._run(lambda db: db.execute(sql, row).lastrowid or 0))

    async def tell_touch(self, number: int, facts: Mapping[str, Any]) -> None:
        """Write down what came of a touch, by names of `TOUCH_FACTS`; ValueError for another one."""
        if not TOUCH_FACTS.issuperset(facts):
            raise ValueError(f"a touch has no {', '.join(sorted(facts.keys() - TOUCH_FACTS))}")
        columns = ", ".join(f"{name}=?" for name in facts)
        row = (*facts.values(), number)
        await self._run(lambda db: db.execute(f"UPDATE touches SET {columns} WHERE n=?", row))  # noqa: S608  # our names

    async def touches_of(self, board_id: str | None, point: str, since: str) -> int:
        """Return how often a pad was touched: of a named board in its life, and by any name since a time; "" for ever.

        `since`: when the board was laid in; what was touched after that was this board, whoever named it or not.
        """
        sql = "SELECT count(*) FROM touches WHERE point=? AND (board_id=? OR at>=?)"
        row = await self._run(lambda db: db.execute(sql, (point, board_id, since)).fetchone())
        return int(row[0])

    async def wear_of(self, board_id: str | None, point: str, since: str, visit: str) -> PadWear:
        """Return how often a pad was touched and pressed, in all as `touches_of` counts, and in one visit."""
        sql = (
            "SELECT count(*), coalesce(sum(presses), 0), coalesce(sum(visit IS ?1), 0),"
            " coalesce(sum(presses * (visit IS ?1)), 0) FROM touches WHERE point=?2 AND (board_id=?3 OR at>=?4)"
        )
        row = await self._run(lambda db: db.execute(sql, (visit, point, board_id, since)).fetchone())
        return PadWear(*map(int, row))

    # --- points -----------------------------------------------------------------------------------------------

    async def mark_of(self, board: str, side: str, point: str) -> PointMark | None:
        """Return what a person said of a point of a board; None: nothing."""
        return await self.marks.of_point(board, side, point)

    async def add_point(self, job_id: str, record: PointRecord) -> int:
        """Write down what came of a point's test; return the row's number."""
        row = (
            record.at,
            job_id,
            record.run,
            record.board_id,
            record.point,
            record.verdict.value,
            record.model_dump_json(),
        )
        sql = "INSERT INTO points(at, job, run, board_id, point, verdict, record) VALUES (?,?,?,?,?,?,?)"
        return int(await self._run(lambda db: db.execute(sql, row).lastrowid or 0))

    async def points_of(self, run: str, since: int, limit: int) -> list[tuple[int, str, PointRecord]]:
        """Return the points of a run with numbers from `since` on, in the order of their tests: number, job, record."""
        sql = "SELECT n, job, record FROM points WHERE run=? AND n>=? ORDER BY n LIMIT ?"
        rows = await self._run(lambda db: db.execute(sql, (run, since, limit)).fetchall())
        return [(int(n), job, PointRecord.model_validate_json(record)) for n, job, record in rows]

    async def last_points(self, limit: int) -> list[PointRecord]:
        """Return what came of the last points, of all runs and probes, in the order of their tests."""
        sql = "SELECT record FROM points ORDER BY n DESC LIMIT ?"
        rows = await self._run(lambda db: db.execute(sql, (limit,)).fetchall())
        return [PointRecord.model_validate_json(record) for (record,) in reversed(rows)]

    async def tests_of(
        self, point: str, board_id: str | None, before: int | None, limit: int
    ) -> list[tuple[int, str, PointRecord]]:
        """Return the tests of a point, newest first, on one board or all, of lower numbers than `before`."""
        sql = (
            "SELECT n, job, record FROM points WHERE point=?1 AND (?2 IS NULL OR board_id=?2) AND n<?3"
            " ORDER BY n DESC LIMIT ?4"
        )
        values = (point, board_id, before if before is not None else 2**63 - 1, limit)
        rows = await self._run(lambda db: db.execute(sql, values).fetchall())
        return [(int(n), job, PointRecord.model_validate_json(record)) for n, job, record in rows]

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
            return await self._in_writer(lambda: self._do(work))
        except sqlite3.IntegrityError as exc:
            raise Fault(FaultCode.JOURNAL_FAILED, f"the journal answers: {exc}") from exc
        except (sqlite3.Error, OSError) as exc:
            fault = self._note_trouble(exc)
            self.troubled.set()
            raise fault from exc

    def _do(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Do `work` in the writer thread, in the circumstances that were set last."""
        if self.stream.is_pending and self._file.is_writable:
            self._file.do(self.stream.write_pending)
        return self._file.do(work)

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
        for table, kept in (("measurements", measurements_kept), ("reports", REPORTS_KEPT), ("touches", TOUCHES_KEPT),
                            ("points", POINTS_KEPT), ("runs", RUNS_KEPT), ("orders", ORDERS_KEPT)):  # fmt: skip
            rows = _oldest(db, table, "n", kept)
            if rows and table == "reports":
                sql = "SELECT coalesce(sum(touches), 0) FROM reports WHERE n<=?"
                _add_meta(db, "touches_trimmed", int(db.execute(sql, (rows,)).fetchone()[0]))
            gone += db.execute(f"DELETE FROM {table} WHERE n<=?", (rows,)).rowcount  # noqa: S608  # names are ours
        gone += db.execute("DELETE FROM alerts WHERE seq<=?", (_oldest(db, "alerts", "seq", ALERTS_KEPT),)).rowcount
        gone += trim_records(db)
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


def _advice(exc: Exception) -> str:
    """Return what to do about a journal in trouble."""
    if isinstance(exc, FileLost):
        return LOST_ADVICE
    if isinstance(exc, NotAFile):
        return PLACE_ADVICE
    if isinstance(exc, sqlite3.Error):
        if is_damage(exc):
            return DAMAGE_ADVICE
        if int(getattr(exc, "sqlite_errorcode", 0)) & 0xFF in _DENIED:
            return DENIED_ADVICE
    return FULL_ADVICE
