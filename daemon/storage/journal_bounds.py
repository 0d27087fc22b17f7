"""Bounds of the journal: how much of each kind is kept, and how the oldest beyond that goes, some at a time."""

from __future__ import annotations

import sqlite3

from daemon.storage.journal_schema import BUSY_MS
from daemon.storage.record_stream import trim_records

JOBS_KEPT = 200_000
REPORTS_KEPT = 50_000
ALERTS_KEPT = 10_000
TOUCHES_KEPT = 500_000
ORDERS_KEPT = 200_000
POINTS_KEPT = 500_000
RUNS_KEPT = 50_000
TRIM_EACH = 2_000
"""At most so many rows of a table go at once: the writer thread must not be held up."""


def work_off_wal(db: sqlite3.Connection) -> None:
    """Put into the file what is in its write-ahead log, and empty that, unless somebody reads just now."""
    db.execute("PRAGMA busy_timeout=0")
    try:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
    finally:
        db.execute(f"PRAGMA busy_timeout={BUSY_MS}")


def trim(db: sqlite3.Connection, measurements_kept: int) -> int:
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
