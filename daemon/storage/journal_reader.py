"""Journal reader: read-only, beside a running daemon or without one, in constant memory.

A read-only connection of SQLite holds up nobody: the daemon goes on writing its WAL. Rows are fetched a page at a time,
each page a transaction of its own, so that a slow reader does not keep the WAL from being worked off.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from daemon.domain.board_run import BoardRun
from daemon.domain.point_test import PointRecord
from daemon.platform.finite_json import to_json
from daemon.storage.journal_schema import SCHEMA_VERSION
from daemon.storage.run_journal import find_run

PAGE = 200
NEEDED = {
    "jobs": {"id", "op", "request", "received_at", "seq", "finished_at", "ok", "result"},
    "steps": {"n", "job", "at", "kind", "body"},
    "alerts": {"seq", "at", "body"},
}
"""What is read; later versions may have more."""
_JOB = "id, op, request, received_at, finished_at, ok, result"


class NoJournal(ValueError):
    """The journal cannot be read; the message says why, `advice` what to do."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


@dataclass(frozen=True)
class JobRow:
    """One job. `ok` and `result` are None while it has no result."""

    id: str
    op: str
    received_at: str
    finished_at: str | None
    ok: bool | None
    request: dict[str, Any]
    result: dict[str, Any] | None

    @property
    def error(self) -> dict[str, Any] | None:
        """Return the error it ended with."""
        return self.result["error"] if self.result else None

    @property
    def seconds(self) -> float | None:
        """Return how long it worked."""
        if self.result is None:
            return None
        return sum(float(row.get("total", 0.0)) for row in self.result["timing_ms"].values()) / 1e3


@dataclass(frozen=True)
class Step:
    """One look or move of a job."""

    at: str
    kind: str
    body: dict[str, Any]


class JournalReader:
    """Read jobs, steps and alerts. Use it in a `with` statement; not for several threads."""

    def __init__(self, file: Path) -> None:
        """Open; raise `NoJournal` if it is missing, damaged, or of a version this program does not know."""
        self.file = file
        self._db = _open(file)
        try:
            self.version = _checked_version(self._db, file)
        except BaseException:
            self._db.close()
            raise

    def __enter__(self) -> Self:
        """Use it."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        """Close it."""
        self._db.close()

    def jobs(
        self, *, failed: bool = False, op: str | None = None, since: str | None = None, newest_first: bool = False
    ) -> Iterator[JobRow]:
        """Yield jobs in the order in which they came, or the other way round; `since` is UTC, ISO 8601."""
        where, values = ["1"], []
        if failed:
            where.append("ok = 0")
        if op is not None:
            where.append("op = ?")
            values.append(op)
        if since is not None:
            where.append("received_at >= ?")
            values.append(since)
        yield from (_job(row) for row in self._pages("jobs", _JOB, where, values, newest_first=newest_first))

    def job(self, job_id: str) -> JobRow | None:
        """Find one job."""
        rows = self._rows(f"SELECT {_JOB} FROM jobs WHERE id = ?", (job_id,))  # noqa: S608  # our own column names
        return _job(rows[0]) if rows else None

    def steps(self, job_id: str) -> list[Step]:
        """Return a job's looks and moves in their order."""
        rows = self._rows("SELECT at, kind, body FROM steps WHERE job = ? ORDER BY n", (job_id,))
        return [Step(at, kind, json.loads(body)) for at, kind, body in rows]

    def line(self, row: JobRow) -> str:
        """Return all there is of a job as one line of JSON: request, result and every look and move."""
        steps = [vars(step) for step in self.steps(row.id)]
        whole = {"id": row.id, "op": row.op, "received_at": row.received_at, "request": row.request}
        return to_json({**whole, "result": row.result, "steps": steps})

    def alerts(self) -> Iterator[dict[str, Any]]:
        """Yield alerts in their order."""
        for seq, at, body in self._pages("alerts", "seq, at, body", ["1"], []):
            yield {"seq": seq, "at": at, **json.loads(body)}

    def measurements(self, since: str, before: str) -> Iterator[tuple[str, int, dict[str, Any]]]:
        """Yield (at, touches, what was measured) from `since` on and before `before`, UTC, ISO 8601, oldest first."""
        if self._has("measurements"):
            where, values = ["at >= ?", "at < ?"], [since, before]
            for at, touches, body in self._pages("measurements", "at, touches, body", where, values):
                yield at, touches, json.loads(body)

    def touches(self, since: str, before: str) -> int:
        """Return how many touches were measured from `since` on and before `before`, UTC, ISO 8601.

        Each measurement tells what came since the one before it in the file, whatever a clock said then. What came
        before the oldest is no part of it where rows before that were dropped for their age.
        """
        if not self._has("measurements"):
            return 0
        first = "CASE WHEN n = 1 THEN 0 ELSE touches END"  # before the very first there were none
        sql = (
            "SELECT coalesce(sum(max(touches - earlier, 0)), 0) FROM (SELECT at, touches,"  # noqa: S608  # our own words
            f" lag(touches, 1, {first}) OVER (ORDER BY n) AS earlier FROM measurements) WHERE at >= ? AND at < ?"
        )
        return int(self._rows(sql, (since, before))[0][0])

    def run(self, run_id: str) -> BoardRun | None:
        """Find a run by its id, by that of a job that worked on it, or, as `last`, the newest."""
        try:
            return find_run(self._db, run_id) if self._has("runs") else None
        except sqlite3.DatabaseError as exc:
            raise _unreadable(self.file, exc) from exc

    def run_ids(self, count: int) -> list[str]:
        """Return the ids of the newest runs, newest first."""
        if not self._has("runs"):
            return []
        return [row[0] for row in self._rows("SELECT id FROM runs ORDER BY n DESC LIMIT ?", (count,))]

    def points(self, run_id: str) -> Iterator[PointRecord]:
        """Yield the records of a run's points in the order of their tests."""
        if self._has("points"):
            for (record,) in self._pages("points", "record", ["run = ?"], [run_id]):
                yield PointRecord.model_validate_json(record)

    def _has(self, table: str) -> bool:
        """Whether the file is new enough to have a table."""
        return bool(self._rows("SELECT 1 FROM sqlite_master WHERE name = ?", (table,)))

    def _pages(
        self, table: str, columns: str, where: list[str], values: list[Any], *, newest_first: bool = False
    ) -> Iterator[tuple[Any, ...]]:
        """Yield rows by rowid, which grows as they come, a page at a time."""
        beyond, order, last = ("<", "DESC", 2**63 - 1) if newest_first else (">", "ASC", -1)
        sql = (
            f"SELECT rowid, {columns} FROM {table} WHERE rowid {beyond} ? AND {' AND '.join(where)}"  # noqa: S608
            f" ORDER BY rowid {order} LIMIT {PAGE}"
        )
        while rows := self._rows(sql, (last, *values)):
            yield from (row[1:] for row in rows)
            last = rows[-1][0]

    def _rows(self, sql: str, values: tuple[Any, ...]) -> list[tuple[Any, ...]]:
        try:
            return self._db.execute(sql, values).fetchall()
        except sqlite3.DatabaseError as exc:
            raise _unreadable(self.file, exc) from exc


def _open(file: Path) -> sqlite3.Connection:
    if not file.exists():
        raise NoJournal(f"{file} does not exist", "give the configuration of a station that has run")
    # Without a daemon there may be no WAL, and a folder that may not be written: the file is then read as it lies.
    still = not Path(f"{file}-wal").exists()
    for extra in ("", "&immutable=1") if still else ("",):
        db = sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro{extra}", uri=True, timeout=5.0)
        try:
            db.execute("SELECT count(*) FROM sqlite_master").fetchone()
        except sqlite3.DatabaseError as exc:
            db.close()
            failed = exc
        else:
            return db
    raise _unreadable(file, failed) from failed


def _unreadable(file: Path, exc: sqlite3.Error) -> NoJournal:
    return NoJournal(f"{file} cannot be read: {exc}", "is it the daemon's journal, and may you read it and its folder?")


def _checked_version(db: sqlite3.Connection, file: Path) -> int:
    version = int(db.execute("PRAGMA user_version").fetchone()[0])
    if version > SCHEMA_VERSION:
        text = f"{file} was written by a newer version (schema {version}, this one knows {SCHEMA_VERSION})"
        raise NoJournal(text, "use the program that wrote it, or a newer one")
    for table, wanted in NEEDED.items():
        have = {row[1] for row in db.execute(f"PRAGMA table_info({table})")}
        if not wanted <= have:
            text = f"{file} (schema {version}) lacks {', '.join(sorted(wanted - have))} of {table}"
            raise NoJournal(text, "it is no journal of this daemon")
    return version


def _job(row: tuple[Any, ...]) -> JobRow:
    job_id, op, request, received_at, finished_at, ok, result = row
    return JobRow(
        job_id, op, received_at, finished_at, None if ok is None else bool(ok),
        json.loads(request), json.loads(result) if result else None,
    )  # fmt: skip
