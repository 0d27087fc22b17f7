"""Journal schema: tables, older versions brought up to date, and what is done with a file that cannot be read.

A file of a newer version is refused: this program would not understand it, and moving it aside would lose it. A file
that is damaged is moved aside with all that belongs to it, and a new one is begun: a station has to go on.
"""

from __future__ import annotations

import shutil
import sqlite3
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import structlog

from daemon.platform.oldest import drop_oldest
from daemon.storage.point_marks import MARKS_TABLE
from daemon.storage.record_stream import begin_journal
from daemon.storage.record_tables import STREAM_TABLES
from daemon.storage.run_journal import RUNS_TABLE
from daemon.storage.write_ahead_log import commits

SCHEMA_VERSION = 5
BUSY_MS = 5000
"""How long a write waits for somebody else's."""
BASE_TABLES = """
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
NAME_THE_PLANS = """
UPDATE points SET record = json_set(record, '$.plan_hash', (SELECT plan_hash FROM runs WHERE runs.id = points.run))
WHERE run IN (SELECT id FROM runs) AND json_valid(record);
"""
"""Records of points did not say by which plan they were tested."""
BASE_NAMES = frozenset({"meta", "jobs", "steps", "reports", "alerts"})
UPGRADES = {
    1: """
CREATE TABLE measurements (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, touches INTEGER NOT NULL, job TEXT NOT NULL,
    body TEXT NOT NULL
) STRICT;
CREATE INDEX measurements_at ON measurements(at);
CREATE TABLE standing (name TEXT PRIMARY KEY, body TEXT NOT NULL) STRICT;
CREATE TABLE kept (key TEXT PRIMARY KEY, body TEXT NOT NULL) STRICT;
CREATE INDEX alerts_at ON alerts(at);
""",
    2: """
CREATE TABLE touches (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, job TEXT NOT NULL, board_id TEXT, point TEXT NOT NULL,
    z_end_um REAL, pressed_um REAL, force_n REAL, speed_um_s REAL, ended_by TEXT, verdict TEXT, value REAL, unit TEXT
) STRICT;
CREATE INDEX touches_of_pad ON touches(point, board_id);
""",
    3: """
ALTER TABLE touches ADD COLUMN visit TEXT;
ALTER TABLE touches ADD COLUMN rung TEXT;
ALTER TABLE touches ADD COLUMN presses INTEGER NOT NULL DEFAULT 1;
ALTER TABLE touches ADD COLUMN proof INTEGER;
ALTER TABLE touches ADD COLUMN reading TEXT;
CREATE TABLE points (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, job TEXT NOT NULL, run TEXT, board_id TEXT,
    point TEXT NOT NULL, verdict TEXT NOT NULL, record TEXT NOT NULL
) STRICT;
CREATE INDEX points_of_run ON points(run, n);
CREATE INDEX points_of_job ON points(job, n);
"""
    + RUNS_TABLE
    + """
CREATE TABLE orders (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, client TEXT NOT NULL, role TEXT NOT NULL, by TEXT,
    op TEXT NOT NULL, fields TEXT NOT NULL, outcome TEXT
) STRICT;
CREATE INDEX jobs_of_op ON jobs(op, seq);
CREATE INDEX jobs_of_point ON jobs(json_extract(result, '$.test_point'), seq);
CREATE INDEX jobs_of_board ON jobs(json_extract(request, '$.board_id'), seq);
CREATE INDEX jobs_of_outcome ON jobs(json_extract(result, '$.outcome'), seq);
""",
    4: "CREATE INDEX points_of_point ON points(point, n);" + NAME_THE_PLANS + MARKS_TABLE + STREAM_TABLES,
}
"""Version -> what makes the next one of it."""
CORRUPT_KEPT, CORRUPT_BYTES = 5, 500_000_000
"""Journals that were moved aside: so many are kept, and not more than this together."""
_UNREADABLE = frozenset({sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB})
_OPEN = "open"
log = structlog.get_logger(__name__)


class Unreadable(Exception):
    """The file is no journal, or a damaged one."""


@dataclass(frozen=True)
class Opened:
    """An open journal: the first free event number, and where a damaged predecessor was put, with why."""

    db: sqlite3.Connection
    next_seq: int
    moved_to: Path | None = None
    why: str = ""


def open_file(path: Path) -> Opened:
    """Open, make or bring up to date the journal at `path`; raise sqlite3.Error or OSError if it cannot be used."""
    path.parent.mkdir(parents=True, exist_ok=True)
    log_file = path.with_name(f"{path.name}-wal")
    ends = commits(log_file)
    try:
        db, next_seq, taken = _connect(path)
        return _with_log_lost(Opened(db, next_seq), path, log_file, [end for end in ends if end > taken])
    except Unreadable as exc:
        why = str(exc)
    first_seq = max(salvaged_seq(path), int(time.time()))
    moved = move_aside(path)
    log.error("journal_moved_aside", file=str(moved), why=why)
    db, _, _ = _connect(path)
    set_meta(db, "next_seq", first_seq)
    return Opened(db, first_seq, moved, why)


def _with_log_lost(opened: Opened, path: Path, log_file: Path, lost: Sequence[int]) -> Opened:
    """Say it, and keep the log, where more than its last transaction was not taken over: each before it was whole.

    The last one alone may have been cut off by a loss of power while it was written: nobody was told that it was done.
    """
    if len(lost) < 2:  # more than the last one
        return opened
    kept = _name_aside(path)
    shutil.copyfile(log_file, kept)
    why = f"its write-ahead log was damaged: the last {len(lost)} writes are lost"
    log.error("journal_log_damaged", file=str(kept), writes_lost=len(lost))
    _drop_old(path)
    return replace(opened, moved_to=kept, why=why)


def set_meta(db: sqlite3.Connection, key: str, value: int) -> None:
    """Write one number."""
    db.execute("INSERT INTO meta VALUES (?, ?) ON CONFLICT(key) DO UPDATE SET value=excluded.value", (key, value))


def close_file(db: sqlite3.Connection) -> None:
    """Note that it was closed in order, and close it."""
    set_meta(db, _OPEN, 0)
    db.close()


def move_aside(path: Path) -> Path:
    """Give the file and what belongs to it another name; return the new one."""
    moved = _name_aside(path)
    path.replace(moved)
    for tail in ("-wal", "-shm"):
        beside = path.with_name(path.name + tail)
        if beside.exists():
            beside.replace(moved.with_name(moved.name + tail))
    moved.touch()  # the newest of its kind, however old its last row
    _drop_old(path)
    return moved


def _name_aside(path: Path) -> Path:
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    moved = path.with_name(f"{path.stem}-corrupt-{stamp}{path.suffix}")
    while moved.exists():
        moved = moved.with_name(f"{moved.stem}x{path.suffix}")
    return moved


def _drop_old(path: Path) -> None:
    for old in drop_oldest(
        path.parent, f"{path.stem}-corrupt-*{path.suffix}", keep=CORRUPT_KEPT, keep_bytes=CORRUPT_BYTES
    ):
        for tail in ("-wal", "-shm"):
            old.with_name(old.name + tail).unlink(missing_ok=True)


def _connect(path: Path) -> tuple[sqlite3.Connection, int, int]:
    """Open the file, make or check its tables; return the connection and the first free event number.

    And how many frames of a log that was left behind SQLite has taken over.
    """
    # Only the writer thread uses the connection; close() comes through it too.
    db = sqlite3.connect(path, isolation_level=None, timeout=BUSY_MS / 1e3, check_same_thread=False)
    try:
        return db, *_prepare(db)
    except BaseException as exc:
        db.close()
        if isinstance(exc, sqlite3.DatabaseError) and is_damage(exc):
            raise Unreadable(str(exc)) from exc
        raise


def is_damage(exc: sqlite3.Error) -> bool:
    """Tell whether an error says that the file itself is damaged, by SQLite's primary error code."""
    code = int(getattr(exc, "sqlite_errorcode", 0))
    return code & 0xFF in _UNREADABLE


def _prepare(db: sqlite3.Connection) -> tuple[int, int]:
    """Set the connection up and bring the tables up to date; return the first free event number, and frames taken."""
    version = int(db.execute("PRAGMA user_version").fetchone()[0])
    if version > SCHEMA_VERSION:
        raise sqlite3.NotSupportedError(
            f"written by a newer version (schema {version}, this one knows {SCHEMA_VERSION})"
        )
    tables = {row[0] for row in db.execute("SELECT name FROM sqlite_master WHERE type='table'")}
    if (version == 0 and tables) or (version > 0 and BASE_NAMES - tables):
        raise Unreadable("it is a database, but no journal of this program")
    db.execute("PRAGMA journal_mode=WAL")
    taken = int(db.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()[1])
    db.execute("PRAGMA synchronous=FULL")
    if version == 0:
        db.executescript(f"BEGIN; {BASE_TABLES} PRAGMA user_version=1; COMMIT;")
        version = 1
    numbers = dict(db.execute("SELECT key, value FROM meta").fetchall())
    if numbers.get(_OPEN):
        _check(db)
    for old in range(version, SCHEMA_VERSION):
        db.executescript(f"BEGIN; {UPGRADES[old]} PRAGMA user_version={old + 1}; COMMIT;")
    set_meta(db, _OPEN, 1)
    begin_journal(db)
    return int(numbers.get("next_seq", 1)), taken


def _check(db: sqlite3.Connection) -> None:
    """Look through a file that was not closed in order; raise Unreadable if it is damaged."""
    found = db.execute("PRAGMA quick_check(1)").fetchone()[0]
    if found != "ok":
        raise Unreadable(str(found).splitlines()[-1])


def salvaged_seq(path: Path) -> int:
    """Return the next event number of a damaged file if it can still be read, else 0: numbers should not repeat.

    The caller takes the time in seconds where this is less, which a station that sends an event a second stays below.
    """
    try:
        db = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=1.0)
        try:
            return int(db.execute("SELECT value FROM meta WHERE key='next_seq'").fetchone()[0])
        finally:
            db.close()
    except (sqlite3.Error, TypeError, ValueError):
        return 0
