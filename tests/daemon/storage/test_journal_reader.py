"""The journal is read beside its writer and without it, of every version, and nothing is changed by reading."""

from __future__ import annotations

import sqlite3
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from daemon.domain.results import ErrorBody, JobResult
from daemon.platform.clock import utc_now
from daemon.storage import journal_reader
from daemon.storage.journal import Journal
from daemon.storage.journal_reader import JournalReader, NoJournal

ERROR = ErrorBody(code=2101, name="tip_not_found", message="not there", advice="look")
FIRST_SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value INTEGER NOT NULL) STRICT;
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, op TEXT NOT NULL, request TEXT NOT NULL, received_at TEXT NOT NULL,
    seq INTEGER UNIQUE, finished_at TEXT, ok INTEGER, result TEXT
) STRICT;
CREATE TABLE steps (
    n INTEGER PRIMARY KEY AUTOINCREMENT, job TEXT NOT NULL REFERENCES jobs(id), at TEXT NOT NULL,
    kind TEXT NOT NULL CHECK (kind IN ('look', 'move')), body TEXT NOT NULL
) STRICT;
CREATE TABLE alerts (seq INTEGER PRIMARY KEY, at TEXT NOT NULL, body TEXT NOT NULL) STRICT;
INSERT INTO jobs VALUES ('old', 'home', '{"op": "home"}', '2024-05-01T00:00:00.000+00:00', NULL, NULL, NULL, NULL);
"""
"""As the first version wrote it."""


def _result(n: int, *, ok: bool) -> JobResult:
    return JobResult(
        id=f"j{n}", op="correct" if n % 2 else "place", ok=ok, seq=n + 1, station="s", finished_at=utc_now(),
        outcome="corrected" if ok else "failed", error=None if ok else ERROR,
        timing_ms={"look": {"total": 500.0}, "move": {"total": 250.0}},
    )  # fmt: skip


@pytest_asyncio.fixture
async def file(tmp_path: Path) -> AsyncIterator[Path]:
    """A journal of ten jobs, every third of them failed, that is open for writing."""
    journal = await Journal.open(tmp_path / "journal.sqlite")
    for n in range(10):
        result = _result(n, ok=n % 3 != 0)
        await journal.add_job(result.id, result.op, '{"op": "x"}')
        await journal.add_step(result.id, "look", {"n": n})
        await journal.add_step(result.id, "move", {"n": n})
        await journal.finish_job(result)
    await journal.add_job("open", "home", '{"op": "home"}')
    yield tmp_path / "journal.sqlite"
    await journal.close()


async def test_jobs_come_in_their_order_page_by_page_while_the_daemon_writes(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal_reader, "PAGE", 3)
    with JournalReader(file) as journal:
        ids = [row.id for row in journal.jobs()]
        assert ids == [*(f"j{n}" for n in range(10)), "open"]
        assert [row.id for row in journal.jobs(newest_first=True)] == ids[::-1]
        row = journal.job("j3")
        assert row is not None
        assert (row.ok, row.seconds, row.error and row.error["name"]) == (False, 0.75, "tip_not_found")
        assert [step.kind for step in journal.steps("j3")] == ["look", "move"]


async def test_jobs_are_chosen_by_failure_operation_and_time(file: Path) -> None:
    with JournalReader(file) as journal:
        assert [row.id for row in journal.jobs(failed=True)] == ["j0", "j3", "j6", "j9"]
        assert [row.id for row in journal.jobs(failed=True, op="correct")] == ["j3", "j9"]
        assert list(journal.jobs(since="2999-01-01")) == []
        open_one = journal.job("open")
        assert open_one is not None
        assert (open_one.ok, open_one.result, open_one.seconds) == (None, None, None)
        assert journal.job("nobody") is None


async def test_reading_cannot_write(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    connect, opened = sqlite3.connect, list[sqlite3.Connection]()

    def watched(*args: Any, **options: Any) -> sqlite3.Connection:
        opened.append(connect(*args, **options))
        return opened[-1]

    monkeypatch.setattr(sqlite3, "connect", watched)
    with JournalReader(file):
        assert opened
        for connection in opened:
            with pytest.raises(sqlite3.OperationalError, match="readonly"):
                connection.execute("DELETE FROM jobs")


def test_a_journal_of_the_first_version_is_read(tmp_path: Path) -> None:
    db = sqlite3.connect(tmp_path / "j.sqlite")
    db.executescript(FIRST_SCHEMA + "PRAGMA user_version=1;")
    db.close()
    with JournalReader(tmp_path / "j.sqlite") as journal:
        assert journal.version == 1
        assert [row.id for row in journal.jobs()] == ["old"]


def test_a_newer_version_is_refused_by_name(tmp_path: Path) -> None:
    db = sqlite3.connect(tmp_path / "j.sqlite")
    db.executescript(FIRST_SCHEMA + "PRAGMA user_version=99;")
    db.close()
    with pytest.raises(NoJournal, match=r"newer version \(schema 99"):
        JournalReader(tmp_path / "j.sqlite")


@pytest.mark.parametrize(
    ("content", "says"),
    [(None, "does not exist"), (b"no database at all, but long enough" * 40, "cannot be read"), (b"", "lacks")],
)
def test_what_is_no_journal_is_refused_with_what_to_do(tmp_path: Path, content: bytes | None, says: str) -> None:
    file = tmp_path / "j.sqlite"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(NoJournal, match=says) as caught:
        JournalReader(file)
    assert caught.value.advice
