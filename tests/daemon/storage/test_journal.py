"""What was written is found again, and numbers are never given twice."""

import os
import resource
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import get_args

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult, StepKind
from daemon.platform.clock import utc_now
from daemon.storage.journal import Journal
from daemon.storage.journal_reader import JournalReader
from daemon.storage.journal_schema import BASE_TABLES, SCHEMA_VERSION, UPGRADES
from daemon.storage.journal_writer import SEQ_BLOCK


def _result(journal: Journal, job_id: str) -> JobResult:
    return JobResult(
        id=job_id, op="home", ok=True, seq=journal.take_seq(), station="s", finished_at=utc_now(), outcome="homed"
    )


async def test_every_kind_of_step_is_kept(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.add_job("a", "home", "{}")
    for kind in get_args(StepKind):
        await journal.add_step("a", kind, {"of": kind})
    await journal.close()
    with JournalReader(tmp_path / "j.sqlite") as reader:
        assert [step.kind for step in reader.steps("a")] == list(get_args(StepKind))


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


def _as_a_kill_leaves_it(path: Path) -> Path:
    """Copy a journal that is open, with its write-ahead log; return the copy."""
    folder = path.parent / "killed"
    folder.mkdir()
    for file in (path, path.with_name(f"{path.name}-wal")):
        shutil.copy(file, folder)
    return folder / path.name


async def test_a_job_without_a_result_is_found_at_the_next_start(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.add_job("cut", "correct", "{}")
    left = _as_a_kill_leaves_it(tmp_path / "j.sqlite")
    await journal.close()
    journal = await Journal.open(left)
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
    left = _as_a_kill_leaves_it(tmp_path / "j.sqlite")
    await journal.close()
    journal = await Journal.open(left)
    assert first[-1] + 1 < journal.upcoming_seq <= first[-1] + 1 + SEQ_BLOCK
    await journal.close()


@contextmanager
def _files_up_to(size_bytes: int) -> Iterator[None]:
    """Let no file of this process grow beyond a size, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


async def test_a_disk_with_room_for_little_is_still_full(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.keep("a", {"n": 1})
    with _files_up_to((tmp_path / "j.sqlite-wal").stat().st_size + 100_000):
        with pytest.raises(Fault) as caught:
            await journal.keep("b", {"much": "x" * 200_000})
        assert caught.value.kind is FaultCode.JOURNAL_FAILED
        await journal.keep("a", {"n": 2})
        assert await journal.check() is not None, "a job would not find room"
    assert await journal.check() is None
    assert await journal.kept("room") is None, "it leaves nothing behind"
    await journal.close()


async def test_a_stop_on_a_full_disk_is_a_stop_and_no_number_repeats_after_it(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.reserve_seqs()
    used = [journal.take_seq() for _ in range(5)]
    with _files_up_to((tmp_path / "j.sqlite-wal").stat().st_size):
        await journal.close()
    again = await Journal.open(tmp_path / "j.sqlite")
    assert again.take_seq() > used[-1]
    await again.close()


async def test_reports_add_up(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.add_report(None, None, 20)
    await journal.add_report(None, "pass", 5)
    assert await journal.touches() == 25
    await journal.close()


def _written(path: Path, version: int, *, old: str = "cut") -> None:
    """Make a journal as an older version left it."""
    db = sqlite3.connect(path)
    upgrades = "".join(UPGRADES[old] for old in range(1, min(version, SCHEMA_VERSION)))
    db.executescript(BASE_TABLES + upgrades + f"PRAGMA user_version={version};")
    db.execute("INSERT INTO meta VALUES ('next_seq', 4711)")
    db.execute("INSERT INTO jobs(id, op, request, received_at) VALUES (?, 'home', '{}', '2026-01-01')", (old,))
    db.execute("INSERT INTO reports(at, touches) VALUES ('2026-01-01', 30)")
    db.execute('INSERT INTO alerts VALUES (7, \'2026-01-01\', \'{"name": "pictures_not_kept", "raised": true}\')')
    db.commit()
    db.close()


@pytest.mark.parametrize("version", [1, 2])
async def test_a_journal_of_an_older_version_is_brought_up_to_date_where_it_lies(tmp_path: Path, version: int) -> None:
    path = tmp_path / "j.sqlite"
    _written(path, version)
    journal = await Journal.open(path)
    assert journal.moved_to is None
    assert journal.upcoming_seq == 4711
    assert await journal.unfinished() == [("cut", "home")]
    assert await journal.touches() == 30
    assert (await journal.alerts(0, 10))[0]["name"] == "pictures_not_kept"
    assert await journal.begin_touch("t", None, "TP1") == 1
    assert await journal.add_measurement("2026-11-24T00:00:00", 30, "a", {"numbers": {"noise": [0.5]}}) == 1
    await journal.close()
    db = sqlite3.connect(path)
    assert db.execute("PRAGMA user_version").fetchone() == (SCHEMA_VERSION,)
    db.close()


async def test_a_spoilt_record_of_a_point_keeps_no_journal_from_being_brought_up_to_date(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    _written(path, 4)
    db = sqlite3.connect(path)
    sql = "INSERT INTO points(at, job, run, board_id, point, verdict, record) VALUES ('2026', 'j', 'r', 'b', ?, 'p', ?)"
    run = (
        "INSERT INTO runs(id, board_id, plan, plan_hash, state, begun_at, body, jobs, stopped_by)"
        " VALUES ('r', 'b', 'p', 'h4sh', 'done', '2026', '{}', '[]', '')"
    )
    db.execute(run)
    db.executemany(sql, [("TP1", '{"point": "TP1"}'), ("TP2", '{"point": "TP')])
    db.commit()
    db.close()
    journal = await Journal.open(path)
    assert journal.moved_to is None
    page = await journal.stream.read(None, 0, 100)
    await journal.close()
    points = [record.body for record in page.records if record.kind == "point"]
    assert [body and (body["point"], body["plan_hash"]) for body in points] == [("TP1", "h4sh"), None]


async def test_a_journal_of_a_newer_version_is_refused_untouched_and_says_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    _written(path, 99)
    before = path.read_bytes()
    with pytest.raises(Fault, match="newer version") as caught:
        await Journal.open(path)
    assert caught.value.kind is FaultCode.JOURNAL_FAILED
    assert "newer program" in caught.value.advice
    assert [file.name for file in tmp_path.iterdir()] == ["j.sqlite"]
    assert path.read_bytes() == before


def _garbage(path: Path) -> None:
    path.write_bytes(b"not a database at all" * 100)


def _torn_in_the_middle(path: Path) -> None:
    db = sqlite3.connect(path)
    db.executescript(BASE_TABLES + "PRAGMA user_version=1;")
    db.execute("INSERT INTO meta VALUES ('open', 1), ('next_seq', 5)")
    db.executemany("INSERT INTO reports(at, touches) VALUES (?, 1)", [("x" * 200,)] * 500)
    db.commit()
    db.close()
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2)
        file.write(b"\xa5" * 16384)


def _somebody_elses(path: Path) -> None:
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE recipes (name TEXT)")
    db.close()


def _somebody_elses_of_a_version(path: Path) -> None:
    _somebody_elses(path)
    db = sqlite3.connect(path)
    db.execute("PRAGMA user_version=2")
    db.close()


@pytest.mark.parametrize("spoil", [_garbage, _torn_in_the_middle, _somebody_elses, _somebody_elses_of_a_version])
async def test_an_unreadable_journal_is_moved_aside_whole_and_a_new_one_begun(
    tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    path = tmp_path / "journal.sqlite"
    spoil(path)
    before = path.read_bytes()
    journal = await Journal.open(path)
    assert journal.moved_to is not None
    assert journal.moved_to.name.startswith("journal-corrupt-")
    assert journal.moved_to.read_bytes()[100:] == before[100:], "all of it but SQLite's own header"
    assert journal.moved_because
    await journal.add_job("a", "home", "{}")
    assert journal.upcoming_seq >= int(time.time()) - 60, "numbers go on beyond any that were given"
    await journal.close()
    again = await Journal.open(path)
    assert again.moved_to is None
    assert await again.unfinished() == [("a", "home")]
    await again.close()


async def test_damage_found_at_work_is_looked_for_at_the_next_start_whatever_the_end_was(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    journal = await Journal.open(path)
    for k in range(300):
        await journal.add_measurement("t" * 400, k, "", {})
    await journal.close()
    journal = await Journal.open(path)
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2)
        file.write(b"\xa5" * 16384)
    with pytest.raises(Fault) as caught:
        await journal.measurements(0, 1000)
    assert caught.value.kind is FaultCode.JOURNAL_FAILED
    await journal.close()
    journal = await Journal.open(path)
    assert journal.moved_to is not None
    await journal.close()


async def test_alerts_stand_until_they_are_taken_away(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.set_standing("b", {"name": "b", "figure": 1.0})
    await journal.set_standing("b", {"name": "b", "figure": 2.0})
    await journal.set_standing("a", {"name": "a"})
    assert [alert["name"] for alert in await journal.standing()] == ["a", "b"]
    assert (await journal.standing())[1]["figure"] == 2.0
    await journal.set_standing("a", None)
    assert len(await journal.standing()) == 1
    await journal.keep("x", {"n": 1})
    await journal.keep("x", {"n": 2})
    assert await journal.kept("x") == {"n": 2}
    assert await journal.kept("y") is None
    await journal.close()


async def test_the_journal_keeps_to_its_bounds_and_forgets_no_touch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.storage.journal_bounds.REPORTS_KEPT", 10)
    monkeypatch.setattr("daemon.storage.journal_bounds.JOBS_KEPT", 5)
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.reserve_seqs()
    for k in range(20):
        await journal.add_report(None, None, 7)
        await journal.add_measurement("2026", k, "", {"numbers": {}})
        await journal.add_job(f"job-{k}", "home", "{}")
        await journal.add_step(f"job-{k}", "move", {})
        if k != 3:
            await journal.finish_job(_result(journal, f"job-{k}"))
    while await journal.trim(measurements_kept=8):
        pass
    assert await journal.touches() == 140
    assert [row[2] for row in await journal.measurements(0, 100)] == list(range(12, 20))
    assert [r.id for r in await journal.results(0, 100)] == [f"job-{k}" for k in range(15, 20)]
    assert await journal.unfinished() == [("job-3", "home")], "what has no result yet is never forgotten"
    await journal.close()


async def test_a_touch_counts_from_before_the_needle_goes_down_and_over_a_kill(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    killed = await Journal.open(path)
    await killed.begin_touch("job-1", "b17", "TP7")
    copied = tmp_path / "copied.sqlite"
    for tail in ("", "-wal"):
        (tmp_path / f"{copied.name}{tail}").write_bytes((tmp_path / f"{path.name}{tail}").read_bytes())
    await killed.close()
    journal = await Journal.open(copied)
    assert await journal.touches_of("b17", "TP7", "") == 1
    await journal.close()


async def test_touches_are_counted_by_board_point_and_time(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    for board_id, point in (("b17", "TP7"), ("b17", "TP7"), ("b18", "TP7"), ("b17", "TP8"), (None, "TP7")):
        await journal.begin_touch("job", board_id, point)
    later = "2999-01-01T00:00:00.000+00:00"
    assert await journal.touches_of("b17", "TP7", later) == 2, "of a board that has a name, in its life"
    assert await journal.touches_of("b19", "TP7", later) == await journal.touches_of(None, "TP7", later) == 0
    assert await journal.touches_of("b17", "TP7", "") == 4, "since it lies there, by whatever name it was touched"
    assert await journal.touches_of(None, "TP7", "") == 4
    await journal.close()


async def test_what_came_of_a_touch_is_kept_as_it_becomes_known(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    other, number = await journal.begin_touch("job-1", "b17", "TP7"), await journal.begin_touch("job-2", "b17", "TP8")
    await journal.tell_touch(number, {"z_end_um": 4700.0, "force_n": 0.48})
    await journal.tell_touch(number, {"ended_by": "lift", "verdict": "pass", "value": 0.4, "unit": "ohm"})
    with pytest.raises(ValueError, match="no colour"):
        await journal.tell_touch(number, {"colour": "red"})
    await journal.close()
    db = sqlite3.connect(tmp_path / "j.sqlite")
    sql = "SELECT job, z_end_um, force_n, ended_by, verdict, value, unit FROM touches WHERE n=?"
    assert db.execute(sql, (number,)).fetchone() == ("job-2", 4700.0, 0.48, "lift", "pass", 0.4, "ohm")
    assert db.execute(sql, (other,)).fetchone() == ("job-1", None, None, None, None, None, None)
    db.close()


async def test_the_oldest_touches_go_beyond_the_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.storage.journal_bounds.TOUCHES_KEPT", 3)
    journal = await Journal.open(tmp_path / "j.sqlite")
    for _ in range(5):
        await journal.begin_touch("job", "b17", "TP7")
    await journal.trim(measurements_kept=8)
    assert await journal.touches_of("b17", "TP7", "") == 3
    await journal.close()


async def test_journals_moved_aside_have_a_quota(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.storage.journal_schema.CORRUPT_KEPT", 2)
    path = tmp_path / "journal.sqlite"
    moved = []
    for n in range(4):
        _garbage(path)
        path.with_name("journal.sqlite-wal").write_bytes(b"not a log")
        journal = await Journal.open(path)
        assert journal.moved_to is not None
        os.utime(journal.moved_to, (n, n))
        moved.append(journal.moved_to)
        await journal.close()
    left = sorted(file for file in tmp_path.glob("journal-corrupt-*") if not file.name.endswith(("-wal", "-shm")))
    assert left == sorted(moved[-2:])
    assert all(Path(str(file).removesuffix("-wal")).exists() for file in tmp_path.glob("*-wal"))


async def test_the_write_ahead_log_is_worked_off_with_each_trim(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    for k in range(50):
        await journal.add_measurement("t" * 400, k, "", {})
    wal = tmp_path / "j.sqlite-wal"
    assert wal.stat().st_size > 0
    reader = sqlite3.connect(tmp_path / "j.sqlite", isolation_level=None)
    reader.execute("BEGIN")
    reader.execute("SELECT count(*) FROM measurements").fetchone()
    await journal.add_measurement("t", 50, "", {})
    await journal.trim(100)
    assert wal.stat().st_size > 0, "who reads is not waited for"
    reader.execute("COMMIT")
    reader.close()
    await journal.trim(100)
    assert wal.stat().st_size == 0
    assert await journal.check() is None
    await journal.close()
