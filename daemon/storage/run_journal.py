"""Runs in the journal: each board's run, from its beginning to its end, over any number of jobs."""

from __future__ import annotations

import json
import sqlite3
from typing import Any

from daemon.domain.board_run import BoardRun, RunState, RunSummary
from daemon.domain.point_test import PointRecord
from daemon.platform.clock import utc_now
from daemon.storage.journal_work import Work

RUNS_TABLE = """
CREATE TABLE runs (
    n INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, board_id TEXT NOT NULL, plan TEXT NOT NULL,
    plan_hash TEXT NOT NULL, state TEXT NOT NULL CHECK (state IN ('unfinished', 'done', 'abandoned')),
    begun_at TEXT NOT NULL, ended_at TEXT, body TEXT NOT NULL, jobs TEXT NOT NULL, stopped_by TEXT NOT NULL,
    summary TEXT
) STRICT;
CREATE INDEX runs_of_board ON runs(board_id, state);
"""
_OWN_COLUMNS = ("state", "ended_at", "jobs", "stopped_by", "summary")
_COLUMNS = ", ".join(("body", *_OWN_COLUMNS))


def run_of(row: tuple[Any, ...]) -> BoardRun:
    """Return the run of a row of `_COLUMNS`."""
    body, state, ended_at, jobs, stopped_by, summary = row
    told = json.loads(body) | {"state": state, "ended_at": ended_at, "jobs": json.loads(jobs), "stopped_by": stopped_by}
    return BoardRun.model_validate(told | {"summary": json.loads(summary) if summary else None})


def find_run(db: sqlite3.Connection, run_id: str) -> BoardRun | None:
    """Return a run by its id, by that of any job that worked on it, or, as `last`, the newest; None for none."""
    where = "?1 = 'last' OR id = ?1 OR instr(jobs, ?2) > 0"
    values = (run_id, json.dumps(run_id))
    row = db.execute(f"SELECT {_COLUMNS} FROM runs WHERE {where} ORDER BY n DESC LIMIT 1", values).fetchone()  # noqa: S608
    return run_of(row) if row else None


class RunJournal:
    """Keep runs and find them again."""

    def __init__(self, work: Work) -> None:
        self._work = work

    async def begin(self, run: BoardRun) -> None:
        """Write a run down before its first touch."""
        row = (
            run.id, run.board_id, run.plan.name, run.plan_hash, run.state, run.begun_at,
            run.model_dump_json(exclude=set(_OWN_COLUMNS)), json.dumps(run.jobs), "",
        )  # fmt: skip
        sql = (
            "INSERT INTO runs(id, board_id, plan, plan_hash, state, begun_at, body, jobs, stopped_by)"
            " VALUES (?,?,?,?,?,?,?,?,?)"
        )
        await self._work(lambda db: db.execute(sql, row))

    async def go_on(self, run: BoardRun, job_id: str) -> None:
        """Write down that another job works on a run."""
        row = (json.dumps([*run.jobs, job_id]), run.id)
        await self._work(lambda db: db.execute("UPDATE runs SET jobs=?, stopped_by='' WHERE id=?", row))

    async def tell(self, run_id: str, state: RunState, summary: RunSummary | None, stopped_by: str = "") -> None:
        """Write down how a run stands when a job is over with it."""
        ended_at = None if state == "unfinished" else utc_now()
        row = (state, ended_at, stopped_by, summary.model_dump_json() if summary else None, run_id)
        sql = "UPDATE runs SET state=?, ended_at=?, stopped_by=?, summary=coalesce(?, summary) WHERE id=?"
        await self._work(lambda db: db.execute(sql, row))

    async def unfinished(self, board_id: str) -> BoardRun | None:
        """Return the run of a board that is not finished."""
        sql = f"SELECT {_COLUMNS} FROM runs WHERE board_id=? AND state='unfinished' ORDER BY n DESC LIMIT 1"  # noqa: S608
        row = await self._work(lambda db: db.execute(sql, (board_id,)).fetchone())
        return run_of(row) if row else None

    async def records_of(self, run_id: str) -> list[PointRecord]:
        """Return the records of a run's points in the order in which they were tested."""
        sql = "SELECT record FROM points WHERE run=? ORDER BY n"
        rows = await self._work(lambda db: db.execute(sql, (run_id,)).fetchall())
        return [PointRecord.model_validate_json(row[0]) for row in rows]

    async def newest(self) -> dict[str, Any] | None:
        """Return the newest run in short, without its tests, and how many points have a record; None for none."""
        names = (
            "id",
            "board_id",
            "plan",
            "state",
            "begun_at",
            "ended_at",
            "stopped_by",
            "plan_version",
            "points",
            "done",
        )
        sql = (
            "SELECT id, board_id, plan, state, begun_at, ended_at, stopped_by, json_extract(body, '$.plan_version'),"
            " json_array_length(body, '$.plan.tests'), (SELECT count(*) FROM points WHERE run=runs.id)"
            " FROM runs ORDER BY n DESC LIMIT 1"
        )
        row = await self._work(lambda db: db.execute(sql).fetchone())
        return dict(zip(names, row, strict=True)) if row else None

    async def find(self, run_id: str) -> BoardRun | None:
        """Return a run as `find_run` does."""
        return await self._work(lambda db: find_run(db, run_id))
