"""A station's journal that begins anew, is put back, trimmed or damaged: each is said, and nothing is lost or mixed."""

from __future__ import annotations

import asyncio
import shutil
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from tests.bench.fleet import STATIONS, Plant, ask, plant
from tests.fleet.journal_server import fill

pytestmark = pytest.mark.timeout(240)
ONE = STATIONS[0]
ROWS = f"""
    SELECT count(*), count(DISTINCT r.job), count(DISTINCT r.journal), (SELECT count(*) FROM refused)
    FROM records r JOIN stations s ON s.id = r.station WHERE s.name = '{ONE}' AND r.kind = 'result'
"""  # noqa: S608  # our own name
LOST = "SELECT station, from_seq, to_seq FROM lost_records ORDER BY received_at, from_seq"


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Plant]:
    with plant(tmp_path, dict.fromkeys(STATIONS, 300)) as found:
        _wait_for(found, ROWS, (300, 300, 1, 0))
        found.stations[0].stop()
        yield found


def _wait_for(running: Plant, sql: str, *expected: tuple[object, ...]) -> None:
    while ask(running.database, sql) != list(expected):  # the test's own timeout ends it
        time.sleep(0.2)


def _files(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"{ONE}.sqlite*"))


def _write(folder: Path, prefix: str, count: int) -> None:
    asyncio.run(fill(folder / f"{ONE}.sqlite", prefix, count))


def _change(folder: Path, sql: str) -> None:
    with closing(sqlite3.connect(folder / f"{ONE}.sqlite", isolation_level=None)) as db:
        assert db.execute(sql).rowcount > 0


def test_a_journal_that_begins_anew_is_stored_beside_the_old_one(running: Plant, tmp_path: Path) -> None:
    for file in _files(tmp_path):
        file.unlink()
    _write(tmp_path, "fresh", 120)
    running.stations[0].start()
    _wait_for(running, ROWS, (420, 420, 2, 0))
    assert ask(running.database, LOST) == []


def test_a_journal_put_back_from_a_backup_goes_on_and_what_was_stored_of_the_other_stays(
    running: Plant, tmp_path: Path
) -> None:
    backup = tmp_path / "backup"
    backup.mkdir()
    for file in _files(tmp_path):
        shutil.copy(file, backup)
    _write(tmp_path, "more", 100)
    running.stations[0].start()
    _wait_for(running, ROWS, (400, 400, 2, 0))
    running.stations[0].stop()
    for file in _files(tmp_path):
        file.unlink()
    for file in _files(backup):
        shutil.copy(file, tmp_path)
    _write(tmp_path, "again", 50)  # counts over numbers of `more`
    running.stations[0].start()
    _wait_for(running, ROWS, (450, 450, 3, 0))
    assert ask(running.database, LOST) == []


def test_what_was_trimmed_before_it_was_sent_is_told_as_lost_whether_numbers_or_rows_went(
    running: Plant, tmp_path: Path
) -> None:
    _write(tmp_path, "more", 100)
    _change(tmp_path, "DELETE FROM records WHERE seq BETWEEN 1 AND 320")
    _change(tmp_path, "DELETE FROM jobs WHERE id IN ('more-40', 'more-41')")
    running.stations[0].start()
    _wait_for(running, ROWS, (378, 378, 2, 0))
    _wait_for(running, LOST, (ONE, 301, 320), (ONE, 341, 342))


def test_a_row_nobody_can_read_is_told_as_lost_and_the_others_go_on(running: Plant, tmp_path: Path) -> None:
    _write(tmp_path, "more", 100)
    _change(tmp_path, "UPDATE jobs SET result = '7' WHERE id = 'more-7'")
    running.stations[0].start()
    _wait_for(running, ROWS, (399, 399, 2, 0))
    _wait_for(running, LOST, (ONE, 308, 308))


def test_a_clock_an_hour_off_changes_neither_order_nor_place(running: Plant, tmp_path: Path) -> None:
    _write(tmp_path, "slow", 100)
    _change(
        tmp_path, "UPDATE jobs SET result = replace(result, '2026-03-04T09', '2026-03-04T08') WHERE id LIKE 'slow%'"
    )
    _change(tmp_path, "UPDATE jobs SET finished_at = '2026-03-04T08:30:12+00:00' WHERE id LIKE 'slow%'")
    running.stations[0].start()
    _wait_for(running, ROWS, (400, 400, 2, 0))
    sql = f"""
        SELECT r.job FROM records r JOIN stations s ON s.id = r.station WHERE s.name = '{ONE}' ORDER BY r.journal, r.seq
    """  # noqa: S608  # our own name
    names = [name for (name,) in ask(running.database, sql)]
    assert names == [*(f"{ONE}-{n}" for n in range(300)), *(f"slow-{n}" for n in range(100))]
    received = "SELECT count(*) FROM records WHERE received_at < now() - interval '30 minutes' OR received_at > now()"
    assert ask(running.database, received) == [(0,)]
