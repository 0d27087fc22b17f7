"""What was written is found again, and numbers are never given twice."""

import sqlite3
from pathlib import Path

import pytest

from daemon.clock import utc_now
from daemon.faults import Fault, Kind
from daemon.journal import SEQ_BLOCK, Journal
from daemon.messages import JobResult


def _result(journal: Journal, job_id: str) -> JobResult:
    return JobResult(
        id=job_id, op="home", ok=True, seq=journal.take_seq(), station="s", finished_at=utc_now(), outcome="homed"
    )


async def test_a_result_survives_closing(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.reserve_seqs()
    await journal.add_job("a", "home", "{}")
    await journal.add_step("a", "move", {"x_um": 1.0})
    result = _result(journal, "a")
    await journal.finish_job(result)
    await journal.close()
    journal = await Journal.open(tmp_path / "j.sqlite")
    stored = await journal.job("a")
    assert stored is not None
    assert stored.result == result == await journal.last_result()
    assert await journal.results(since=result.seq, limit=10) == [result]
    assert await journal.results(since=result.seq + 1, limit=10) == []
    assert await journal.unfinished() == []
    await journal.close()


async def test_a_job_without_a_result_is_found_at_the_next_start(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.add_job("cut", "correct", "{}")
    journal._db.close()
    journal._writer.shutdown()  # as a kill would leave it
    journal = await Journal.open(tmp_path / "j.sqlite")
    assert await journal.unfinished() == [("cut", "correct")]
    await journal.close()


async def test_numbers_go_on_after_a_clean_stop_and_never_repeat_after_a_kill(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.reserve_seqs()
    first = [journal.take_seq() for _ in range(3)]
    await journal.close()
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.reserve_seqs()
    assert journal.take_seq() == first[-1] + 1
    journal._db.close()
    journal._writer.shutdown()
    journal = await Journal.open(tmp_path / "j.sqlite")
    assert first[-1] + 1 < journal.upcoming_seq <= first[-1] + 1 + SEQ_BLOCK
    await journal.close()


async def test_reports_add_up(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.add_report(None, None, 20)
    await journal.add_report(None, "pass", 5)
    assert await journal.touches() == 25
    await journal.close()


async def test_a_journal_of_a_newer_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    db = sqlite3.connect(path)
    db.execute("PRAGMA user_version=99")
    db.close()
    with pytest.raises(Fault, match="newer version") as caught:
        await Journal.open(path)
    assert caught.value.kind is Kind.JOURNAL_FAILED


async def test_a_file_that_is_no_journal_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    path.write_bytes(b"not a database at all" * 100)
    with pytest.raises(Fault, match="not a database"):
        await Journal.open(path)
