"""Journal: every job, look, move and result in SQLite, written before anything is published.

WAL with synchronous=FULL: what was acknowledged survives a power cut. How it is written, and what becomes of one that
cannot be, is the writer's (`journal_writer`).
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import structlog

from daemon.domain.point_mark import PointMark
from daemon.domain.point_test import PadWear, PointRecord
from daemon.domain.results import JobResult, StepKind
from daemon.platform.clock import utc_now
from daemon.storage import journal_bounds
from daemon.storage.journal_writer import JournalWriter
from daemon.storage.point_marks import PointMarks
from daemon.storage.record_stream import RecordStream
from daemon.storage.run_journal import RunJournal

TOUCH_FACTS = frozenset(
    {
        "z_end_um", "pressed_um", "force_n", "speed_um_s", "ended_by", "verdict", "value", "unit", "presses", "proof",
        "reading",
    }
)  # fmt: skip
"""Columns of a touch that are known after it began."""
MAX_ROW = 2**63 - 1
PINNED = frozenset({"reference_doubt"})
"""Things kept that a full disk must not keep out; they must be small."""
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


class Journal(JournalWriter):
    """Keep and find again. Open with `Journal.open`; every method may be awaited from one event loop."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.runs = RunJournal(self._run)
        """Runs over boards, and the records of their points."""
        self.marks = PointMarks(self._run)
        """What people said of points of boards."""
        self.stream = RecordStream(self._run)
        """All that is kept, in one order and under one count."""

    def _do(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Do `work` in the writer thread, in the circumstances that were set last."""
        if self.stream.is_pending and self._file.is_writable:
            self._file.do(self.stream.write_pending)
        return super()._do(work)

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

    async def add_step(self, job_id: str, kind: StepKind, body: dict[str, Any]) -> None:
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
        gone = await self._run(lambda db: journal_bounds.trim(db, measurements_kept))
        await self._run(journal_bounds.work_off_wal)
        return gone
