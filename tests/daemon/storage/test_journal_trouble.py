"""A journal that cannot be written says so, gives no number twice, and goes on where it was."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult
from daemon.platform.clock import utc_now
from daemon.storage.journal import Journal
from tests.daemon.storage.small_disk import fill, make_room, small_disk

DOUBT = "reference_doubt"


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    with small_disk(tmp_path / "disk") as folder:
        yield folder


def _result(job_id: str, seq: int) -> JobResult:
    return JobResult(id=job_id, op="home", ok=True, seq=seq, station="s", finished_at=utc_now(), outcome="homed")


async def _kept(folder: Path) -> Journal:
    """Open a journal with a finished job."""
    journal = await Journal.open(folder / "j.sqlite")
    await journal.add_job("done", "home", "{}")
    await journal.finish_job(_result("done", journal.take_seq()))
    return journal


def _as_a_kill_leaves_it(folder: Path, to: Path) -> Path:
    """Copy all files of a journal that is open; return the copy."""
    to.mkdir()
    for file in folder.glob("j.*"):
        shutil.copy(file, to)
    return to / "j.sqlite"


async def test_on_a_full_disk_no_job_is_taken_and_numbers_go_on_without_ever_repeating(
    disk: Path, tmp_path: Path
) -> None:
    journal = await _kept(disk)
    fill(disk)
    with pytest.raises(Fault) as refused:
        await journal.add_job("a", "home", "{}")
    assert refused.value.kind is FaultCode.JOURNAL_FAILED
    given = []
    for _ in range(30_000):  # three blocks: at a heartbeat a second some eight hours
        given.append(journal.take_seq())
        if len(given) % 1000 == 0:
            await journal.reserve_seqs()
    assert given == list(range(given[0], given[0] + 30_000))
    again = await Journal.open(_as_a_kill_leaves_it(disk, tmp_path / "killed"))
    assert again.upcoming_seq > given[-1]
    await again.close()
    make_room(disk)
    assert await journal.check() is None
    await journal.add_job("a", "home", "{}")
    await journal.close()


async def test_a_start_on_a_full_disk_reads_what_is_there_and_goes_on_when_there_is_room(disk: Path) -> None:
    journal = await _kept(disk)
    last = journal.take_seq()
    await journal.close()
    fill(disk)
    journal = await Journal.open(disk / "j.sqlite")
    assert await journal.check() is not None
    assert (await journal.last_result() or _result("none", 0)).id == "done"
    assert journal.take_seq() > last
    with pytest.raises(Fault):
        await journal.add_job("a", "home", "{}")
    assert await journal.check() is not None, "nothing has changed"
    make_room(disk)
    assert await journal.check() is None
    await journal.add_job("a", "home", "{}")
    assert await journal.unfinished() == [("a", "home")]
    await journal.close()


async def test_a_start_on_a_full_disk_after_a_kill_gives_no_number_twice(disk: Path, tmp_path: Path) -> None:
    journal = await _kept(tmp_path)
    last = journal.take_seq()
    left = _as_a_kill_leaves_it(tmp_path, disk / "killed")
    await journal.close()
    fill(disk)
    given: list[int] = []
    for _ in range(3):  # each is killed
        journal = await Journal.open(left)
        assert await journal.check() is not None
        given.append(journal.take_seq())
    assert [last, *given] == sorted({last, *given})
    make_room(disk)
    assert await journal.check() is None
    assert journal.take_seq() > given[-1]
    await journal.close()


async def test_a_doubt_survives_a_kill_on_a_full_disk(disk: Path, tmp_path: Path) -> None:
    journal = await _kept(disk)
    await journal.keep(DOUBT, {"axes": []})
    fill(disk)
    await journal.keep(DOUBT, {"axes": ["x"]})
    again = await Journal.open(_as_a_kill_leaves_it(disk, tmp_path / "killed"))
    assert await again.kept(DOUBT) == {"axes": ["x"]}
    await again.close()
    await journal.close()


async def test_a_journal_that_could_never_be_opened_gives_no_number_and_says_why(tmp_path: Path) -> None:
    folder = tmp_path / "not-a-folder"
    folder.write_text("")
    journal = await Journal.open(folder / "j.sqlite")
    assert journal.trouble is not None
    assert journal.trouble.kind is FaultCode.JOURNAL_FAILED
    with pytest.raises(Fault):
        journal.take_seq()
    with pytest.raises(Fault):
        await journal.kept("x")
    folder.unlink()
    assert await journal.check() is None, "it goes on by itself"
    assert journal.take_seq() == 1
    await journal.close()


# --- deleted or replaced --------------------------------------------------------------------------------------


def _delete(path: Path) -> None:
    path.unlink()


def _delete_all(path: Path) -> None:
    for file in path.parent.glob("j.sqlite*"):
        file.unlink()


def _delete_folder(path: Path) -> None:
    shutil.rmtree(path.parent)


def _move_away(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))


def _replace(path: Path) -> None:
    other = path.with_name("other")
    db = sqlite3.connect(other)
    db.execute("CREATE TABLE recipes (name TEXT)")
    db.close()
    other.replace(path)


def _delete_wal(path: Path) -> None:
    path.with_name(f"{path.name}-wal").unlink()


@pytest.mark.parametrize("spoil", [_delete, _delete_all, _delete_folder, _move_away, _replace, _delete_wal])
async def test_a_journal_that_was_deleted_takes_no_job_and_a_reset_puts_it_back_whole(
    tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    folder = tmp_path / "data"
    journal = await _kept(folder)
    await journal.add_job("open", "home", "{}")
    spoil(folder / "j.sqlite")
    with pytest.raises(Fault) as refused:
        await journal.add_job("a", "home", "{}")
    assert refused.value.kind is FaultCode.JOURNAL_FAILED
    assert "reset" in refused.value.advice
    assert await journal.check() is not None, "it does not go on by itself"
    assert await journal.mend() is None
    await journal.add_job("a", "home", "{}")
    number = journal.take_seq()
    await journal.close()
    again = await Journal.open(folder / "j.sqlite")
    stored = await again.job("done")
    assert stored is not None
    assert stored.result is not None, "what was accepted moves no second time"
    assert sorted(await again.unfinished()) == [("a", "home"), ("open", "home")]
    assert again.upcoming_seq > number
    await again.close()


async def test_a_deletion_is_seen_without_anybody_writing(tmp_path: Path) -> None:
    journal = await _kept(tmp_path)
    assert await journal.check() is None
    _delete(tmp_path / "j.sqlite")
    trouble = await journal.check()
    assert trouble is not None
    assert "deleted or replaced" in trouble.message
    await journal.close()


@pytest.mark.parametrize("spoil", [_delete, _delete_all, _move_away])
@pytest.mark.parametrize("killed", [True, False])
async def test_a_deleted_journal_is_whole_again_for_the_next_start_even_without_a_reset(
    tmp_path: Path, spoil: Callable[[Path], None], killed: bool
) -> None:
    journal = await _kept(tmp_path)
    spoil(tmp_path / "j.sqlite")
    if killed:
        assert await journal.check() is not None
        left = _as_a_kill_leaves_it(tmp_path, tmp_path / "killed")
        assert await journal.check() is not None, "it stays a fault until a person has seen it"
    await journal.close()
    again = await Journal.open(left if killed else tmp_path / "j.sqlite")
    assert await again.job("done") is not None
    await again.close()


def _overwrite(path: Path) -> None:
    path.write_bytes(b"something else" * 1000)


def _truncate(path: Path) -> None:
    os.truncate(path, 0)


@pytest.mark.parametrize("spoil", [_overwrite, _truncate])
async def test_a_journal_that_was_overwritten_is_moved_aside_and_numbers_go_on(
    tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    journal = await _kept(tmp_path)
    number = journal.take_seq()
    spoil(tmp_path / "j.sqlite")
    assert await journal.check() is not None
    assert await journal.mend() is None
    assert journal.moved_to is not None
    assert journal.moved_to.exists()
    await journal.add_job("a", "home", "{}")
    assert journal.take_seq() > number
    await journal.close()


def _cut_log(path: Path) -> None:
    os.truncate(path.with_name(f"{path.name}-wal"), 0)


def _halve_log(path: Path) -> None:
    log = path.with_name(f"{path.name}-wal")
    os.truncate(log, log.stat().st_size // 2)


def _overwrite_log(path: Path) -> None:
    log = path.with_name(f"{path.name}-wal")
    log.write_bytes(b"x" * (log.stat().st_size + 4096))


@pytest.mark.parametrize("spoil", [_cut_log, _halve_log, _overwrite_log])
async def test_a_log_that_was_written_over_takes_no_job_and_what_comes_after_a_reset_is_kept(
    tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    folder = tmp_path / "data"
    old = await _kept(folder)
    await old.close()
    journal = await Journal.open(folder / "j.sqlite")
    await journal.add_job("last", "home", "{}")
    number = journal.take_seq()
    spoil(folder / "j.sqlite")
    with pytest.raises(Fault) as refused:
        await journal.add_job("a", "home", "{}")
    assert "reset" in refused.value.advice
    assert await journal.mend() is None
    assert journal.moved_to is not None, "what is lost is said"
    await journal.add_job("b", "home", "{}")
    await journal.finish_job(_result("b", journal.take_seq()))
    left = _as_a_kill_leaves_it(folder, tmp_path / "killed")
    await journal.close()
    for path in (folder / "j.sqlite", left):
        again = await Journal.open(path)
        assert await again.job("a") is None, "it was refused"
        stored = await again.job("b")
        assert stored is not None
        assert stored.result is not None
        assert await again.job("done") is not None, "what the log did not hold is there"
        assert again.upcoming_seq > number
        await again.close()


async def _with_jobs(folder: Path, names: str) -> Journal:
    """Open a journal whose log holds these jobs, and what was before in its file."""
    await (await _kept(folder)).close()
    journal = await Journal.open(folder / "j.sqlite")
    for name in names:
        await journal.add_job(name, "home", "{}")
    return journal


def _spoil_log_after(path: Path, name: str) -> None:
    """Change one byte of the log in the page that was written when this job was taken."""
    log = path.with_name(f"{path.name}-wal")
    data = bytearray(log.read_bytes())
    data[data.index(f"{name}home{{}}".encode())] ^= 1
    log.write_bytes(data)


async def test_a_byte_of_the_log_that_was_changed_is_noticed_and_what_came_before_it_is_kept(tmp_path: Path) -> None:
    journal = await _with_jobs(tmp_path, "abcdef")
    number = journal.take_seq()
    _spoil_log_after(tmp_path / "j.sqlite", "d")
    assert await journal.check() is not None
    with pytest.raises(Fault) as refused:
        await journal.add_job("g", "home", "{}")
    assert "reset" in refused.value.advice
    assert await journal.mend() is None
    assert journal.moved_to is not None, "what is lost is said"
    await journal.add_job("h", "home", "{}")
    assert await journal.check() is None
    await journal.close()
    again = await Journal.open(tmp_path / "j.sqlite")
    assert again.moved_to is None, "it is sound"
    assert [name for name in "abcdefgh" if await again.job(name)] == ["a", "b", "c", "h"]
    assert again.upcoming_seq > number
    await again.close()


async def test_a_log_that_only_grows_is_nobody_else_s(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It should be well after every kind of work: many writes, refused ones, a log that begins again."""
    monkeypatch.setattr("daemon.storage.journal_writer.VERIFY_LOG_EVERY_S", 0.0)
    journal = await _with_jobs(tmp_path, "ab")
    for n in range(40):
        await journal.add_step("a", "look", {"n": n, "much": "x" * 40_000})
        assert await journal.check() is None
        with pytest.raises(Fault, match="UNIQUE"):
            await journal.add_job("a", "home", "{}")
        assert await journal.check() is None
    await journal.close()


async def test_a_log_that_was_spoilt_before_a_start_is_told_of_and_kept(tmp_path: Path) -> None:
    journal = await _with_jobs(tmp_path / "data", "abcdef")
    number = journal.take_seq()
    left = _as_a_kill_leaves_it(tmp_path / "data", tmp_path / "killed")
    await journal.close()
    _spoil_log_after(left, "d")
    again = await Journal.open(left)
    assert again.moved_to is not None
    assert again.moved_to.exists()
    assert "3 writes are lost" in again.moved_because
    assert [name for name in "abcdef" if await again.job(name)] == ["a", "b", "c"]
    assert again.upcoming_seq > number
    await again.close()


@pytest.mark.parametrize("cut", [0, 100])
async def test_a_kill_or_a_last_write_cut_off_by_a_loss_of_power_is_no_damage(tmp_path: Path, cut: int) -> None:
    journal = await _with_jobs(tmp_path / "data", "abcdef")
    left = _as_a_kill_leaves_it(tmp_path / "data", tmp_path / "killed")
    await journal.close()
    log = left.with_name(f"{left.name}-wal")
    data = bytearray(log.read_bytes())
    data[-100:] = bytes(cut) or data[-100:]
    log.write_bytes(data)
    again = await Journal.open(left)
    assert again.moved_to is None
    assert await again.job("e") is not None
    await again.close()


async def test_a_journal_that_was_only_touched_loses_nothing(tmp_path: Path) -> None:
    journal = await _kept(tmp_path)
    os.utime(tmp_path / "j.sqlite", (1, 1))
    assert await journal.check() is not None
    assert await journal.mend() is None
    assert journal.moved_to is None
    assert await journal.job("done") is not None
    await journal.close()


@pytest.mark.parametrize(
    ("lay", "clear"),
    [
        (Path.mkdir, Path.rmdir),
        (os.mkfifo, Path.unlink),
        (lambda path: path.symlink_to(path.parent / "none" / "j"), Path.unlink),
    ],
    ids=["folder", "pipe", "dangling link"],
)
async def test_what_is_no_file_in_the_journal_s_place_is_said_and_work_goes_on_once_it_is_moved(
    tmp_path: Path, lay: Callable[[Path], None], clear: Callable[[Path], None]
) -> None:
    path = tmp_path / "j.sqlite"
    lay(path)
    journal = await Journal.open(path)
    assert journal.trouble is not None
    assert journal.trouble.kind is FaultCode.JOURNAL_FAILED
    assert str(path) in journal.trouble.message
    assert "move away" in journal.trouble.advice
    clear(path)
    assert await journal.check() is None
    await journal.add_job("a", "home", "{}")
    await journal.close()


async def test_a_pipe_in_the_place_of_the_pinned_facts_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "j.pinned")
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.add_job("a", "home", "{}")
    await journal.close()
