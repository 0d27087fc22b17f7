"""Everything that is kept stands in one stream, each row once, in the order in which it was written."""

import json
import shutil
import sqlite3
from collections.abc import AsyncIterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.board_run import BoardRun
from daemon.domain.point_test import PointRecord
from daemon.domain.results import JobResult
from daemon.platform.clock import utc_now
from daemon.storage import record_stream
from daemon.storage.journal import Journal
from daemon.storage.journal_schema import BASE_TABLES, UPGRADES
from daemon.storage.record_stream import RecordPage
from daemon.wire.example_parts import RECORD
from daemon.wire.example_runs import RUN


@pytest.fixture
async def journal(tmp_path: Path) -> AsyncIterator[Journal]:
    journal = await Journal.open(tmp_path / "j.sqlite")
    yield journal
    await journal.close()


async def _alerts(journal: Journal, *names: str) -> None:
    for name in names:
        await journal.add_alert(journal.take_seq(), {"name": name})


async def _all(journal: Journal, since: int = 0) -> RecordPage:
    return await journal.stream.read(None, since, 1000)


def _told(page: RecordPage) -> list[tuple[int, str]]:
    return [(record.seq, record.kind) for record in page.records]


async def test_each_kind_of_row_is_told_in_the_order_in_which_it_was_written(journal: Journal) -> None:
    await journal.add_job("j", "correct", json.dumps({"board_id": "B-17"}))
    order = await journal.begin_order("page", "operate", "M. Weber", "correct", '{"id": "j"}')
    touch = await journal.begin_touch("j", "B-17", "TP7")
    await journal.tell_touch(touch, {"presses": 3})
    await journal.tell_touch(touch, {"ended_by": "lifted", "verdict": "pass", "value": 0.2, "unit": "ohm"})
    await journal.add_point("j", PointRecord.model_validate(RECORD))
    await journal.add_measurement(utc_now(), 1, "j", {"light": 148.0})
    result = JobResult(
        id="j", op="correct", ok=True, seq=journal.take_seq(), station="s", finished_at=utc_now(), outcome="corrected"
    )
    await journal.finish_job(result)
    await journal.end_order(order, "corrected")
    await journal.add_report("j", "pass", 2)
    await _alerts(journal, "light")
    page = await _all(journal)
    kinds = ["order", "touch", "touch", "point", "measurement", "result", "order", "report", "alert"]
    assert _told(page) == list(enumerate(kinds, start=1)), "a job without a result is none yet, nor is a mere press"
    bodies: list[dict[str, Any]] = [record.body or {} for record in page.records]
    assert bodies[2] | {"point": "TP7", "verdict": "pass", "presses": 3, "board_id": "B-17"} == bodies[2]
    assert bodies[3]["verdict"] == "pass_recovered"
    assert bodies[4]["measured"] == {"light": 148.0}
    assert JobResult.model_validate(bodies[5]) == result
    assert bodies[5]["board_id"] == "B-17"
    assert bodies[6]["outcome"] == "corrected"
    assert "fields" not in bodies[6], "what an order asked is for who may maintain"
    assert all(record.at for record in page.records)


async def test_a_page_ends_at_its_limit_and_the_next_one_goes_on(journal: Journal) -> None:
    await _alerts(journal, *"abcde")
    first = await journal.stream.read(None, 0, 2)
    second = await journal.stream.read(first.journal, 3, 9)
    assert [seq for seq, _ in _told(first) + _told(second)] == [1, 2, 3, 4, 5]
    assert (first.oldest_seq, first.next_seq) == (1, 6)
    assert _told(await journal.stream.read(first.journal, 6, 9)) == []


async def test_a_page_is_cut_when_it_grows_large_and_has_one_record_at_least(
    journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    await _alerts(journal, "x" * 600, "y" * 600, "z")
    monkeypatch.setattr(record_stream, "PAGE_BYTES", 1000)
    assert _told(await _all(journal)) == [(1, "alert")]
    assert _told(await _all(journal, 2)) == [(2, "alert"), (3, "alert")]


async def _pages(journal: Journal, limit: int, *kinds: str) -> list[tuple[list[tuple[int, str]], int]]:
    """Return all pages of some kinds, each with the number it looked through to."""
    found: list[tuple[list[tuple[int, str]], int]] = []
    since = 0
    while True:
        page = await journal.stream.read(None, since, limit, kinds)
        found.append((_told(page), page.through_seq))
        if page.through_seq + 1 >= page.next_seq:
            return found
        since = page.through_seq + 1


async def test_a_page_of_some_kinds_says_how_far_it_looked(journal: Journal) -> None:
    for touches in range(3):
        await _alerts(journal, "a")
        await journal.add_report(None, None, touches)
    assert await _pages(journal, 2, "report") == [([(2, "report"), (4, "report")], 4), ([(6, "report")], 6)]
    assert await _pages(journal, 9, "report", "alert") == [(_told(await _all(journal)), 6)]
    assert await _pages(journal, 9, "run") == [([], 6)]
    assert (await journal.stream.read(None, 7, 9, ["run"])).through_seq == 6


async def test_a_page_of_a_rare_kind_looks_through_some_numbers_only(
    journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    await _alerts(journal, *"abcd")
    await journal.add_report(None, None, 1)
    monkeypatch.setattr(record_stream, "PAGE_SCAN", 2)
    assert await _pages(journal, 9, "report") == [([], 2), ([], 4), ([(5, "report")], 5)]
    assert _told(await _all(journal))[-1] == (5, "report"), "of all kinds a page is whole"


async def test_a_page_of_some_kinds_ends_with_its_journal(tmp_path: Path) -> None:
    first = await Journal.open(tmp_path / "j.sqlite")
    await _alerts(first, "a")
    second = await _reopened(first, tmp_path / "j.sqlite")
    await second.add_report(None, None, 1)
    assert await _pages(second, 9, "report") == [([], 1), ([(2, "report")], 2)]
    await second.close()


async def test_records_carry_the_circumstances_they_were_written_in(journal: Journal) -> None:
    await _alerts(journal, "before")
    journal.stream.set_circumstances({"needle": "N-1"})
    await _alerts(journal, "one")
    journal.stream.set_circumstances({"needle": "N-2"})
    await _alerts(journal, "two")
    assert [record.circumstances for record in (await _all(journal)).records] == [
        {},
        {"needle": "N-1"},
        {"needle": "N-2"},
    ]


async def _reopened(journal: Journal, path: Path) -> Journal:
    await journal.close()
    return await Journal.open(path)


async def test_each_opening_is_a_journal_of_its_own_and_the_count_goes_on(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await _alerts(journal, "a", "b")
    first = await journal.stream.journal()
    journal = await _reopened(journal, tmp_path / "j.sqlite")
    journal = await _reopened(journal, tmp_path / "j.sqlite")  # nothing was written in the one between
    await _alerts(journal, "c")
    one, two = await journal.stream.read(first, 1, 9), await journal.stream.read(first, 3, 9)
    assert (one.journal, one.first_seq, _told(one)) == (first, 1, [(1, "alert"), (2, "alert")])
    assert (two.journal, two.first_seq, _told(two)) == (await journal.stream.journal(), 3, [(3, "alert")])
    assert (one.previous, two.previous) == (None, (first, 2)), "the empty one between is none's predecessor"
    await journal.close()


async def test_the_first_page_is_not_empty_where_the_first_opening_wrote_nothing(tmp_path: Path) -> None:
    journal = await _reopened(await Journal.open(tmp_path / "j.sqlite"), tmp_path / "j.sqlite")
    await _alerts(journal, "a")
    page = await _all(journal)
    assert _told(page) == [(1, "alert")]
    assert (page.journal, page.previous) == (await journal.stream.journal(), None)
    await journal.close()


async def test_a_journal_put_back_from_a_backup_goes_on_where_that_ended_under_a_new_id(tmp_path: Path) -> None:
    path, backup = tmp_path / "j.sqlite", tmp_path / "backup.sqlite"
    journal = await Journal.open(path)
    before = await journal.stream.journal()
    await _alerts(journal, "a", "b")
    await journal.close()
    shutil.copy(path, backup)
    journal = await Journal.open(path)  # numbers 3 and 4 were used before it was put back
    lost = await journal.stream.journal()
    await _alerts(journal, "lost", "lost")
    await journal.close()
    shutil.copy(backup, path)
    journal = await Journal.open(path)
    await _alerts(journal, "after")
    page = await journal.stream.read(before, 4, 9)
    assert page.journal not in {before, lost}
    assert _told(page) == [(3, "alert")], "number 3 of another journal: none is passed over"
    await journal.close()


async def test_a_number_of_an_unknown_journal_counts_for_nothing(journal: Journal) -> None:
    await _alerts(journal, "a")
    assert _told(await journal.stream.read("another", 900, 9)) == [(1, "alert")]


async def test_what_was_trimmed_unfetched_is_told_as_lost_journal_by_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_stream, "RECORDS_KEPT", 2)
    path = tmp_path / "j.sqlite"
    journal = await Journal.open(path)
    first = await journal.stream.journal()
    await _alerts(journal, "a", "b", "c")
    journal = await _reopened(journal, path)
    await _alerts(journal, "d", "e", "f")
    await journal.trim(10)
    page = await journal.stream.read(first, 2, 9)
    assert (page.journal, page.lost, page.records) == (first, (2, 3), [])
    page = await journal.stream.read(first, 4, 9)
    assert (page.lost, _told(page), page.oldest_seq) == ((4, 4), [(5, "alert"), (6, "alert")], 5)
    await journal.close()


async def test_a_record_whose_row_is_gone_or_unreadable_is_told_without_it(tmp_path: Path, journal: Journal) -> None:
    await _alerts(journal, "a")
    await journal.add_measurement(utc_now(), 1, "j", {})
    await _alerts(journal, "c")
    with closing(sqlite3.connect(tmp_path / "j.sqlite", isolation_level=None)) as db:
        db.execute("DELETE FROM alerts WHERE seq=(SELECT min(seq) FROM alerts)")
        db.execute("UPDATE measurements SET body='{'")
    page = await _all(journal)
    assert [(record.seq, record.body) for record in page.records] == [(1, None), (2, None), (3, {"name": "c"})]


async def test_a_row_that_could_not_be_written_takes_no_number(tmp_path: Path, journal: Journal) -> None:
    await _alerts(journal, "a")
    with closing(sqlite3.connect(tmp_path / "j.sqlite", isolation_level=None)) as db:
        db.execute("BEGIN")
        db.execute("INSERT INTO alerts VALUES (99, 'x', '{}')")
        db.execute("ROLLBACK")
    await _alerts(journal, "b")
    assert _told(await _all(journal)) == [(1, "alert"), (2, "alert")]


async def test_what_an_older_journal_kept_comes_first_in_the_order_of_time(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    db = sqlite3.connect(path, isolation_level=None)
    db.executescript(BASE_TABLES + UPGRADES[1] + UPGRADES[2] + UPGRADES[3] + "PRAGMA user_version=4;")
    db.execute("INSERT INTO jobs VALUES ('j', 'home', '{}', '2026-01-01', 7, '2026-01-03', 1, '{\"id\": \"j\"}')")
    db.execute("INSERT INTO alerts VALUES (3, '2026-01-02', '{}')")
    db.close()
    journal = await Journal.open(path)
    await _alerts(journal, "new")
    assert _told(await _all(journal)) == [(1, "alert"), (2, "result"), (3, "alert")]
    await journal.close()


def _kept(path: Path) -> list[str]:
    with closing(sqlite3.connect(path)) as db:
        return [body for (body,) in db.execute("SELECT body FROM circumstances ORDER BY n")]


async def test_circumstances_of_which_no_record_is_left_are_trimmed_with_the_records(
    journal: Journal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They change with each board that is aligned, so that they need a bound as the records do."""
    for board in ("A", "B", "A", "C"):
        journal.stream.set_circumstances({"board_id": board})
        await _alerts(journal, f"on {board}")
    monkeypatch.setattr(record_stream, "RECORDS_KEPT", 2)
    await journal.trim(10)
    page = await _all(journal)
    assert [record.circumstances for record in page.records] == [{"board_id": "A"}, {"board_id": "C"}]
    assert _kept(tmp_path / "j.sqlite") == ['{"board_id": "A"}', '{"board_id": "C"}']
    monkeypatch.setattr(record_stream, "RECORDS_KEPT", 0)
    await journal.trim(10)
    await _alerts(journal, "still on C")
    assert [record.circumstances for record in (await _all(journal)).records] == [{"board_id": "C"}]


async def test_circumstances_that_are_set_again_as_they_are_take_no_room(journal: Journal, tmp_path: Path) -> None:
    for _ in range(3):
        journal.stream.set_circumstances({"board_id": "A"})
        await _alerts(journal, "a")
    assert _kept(tmp_path / "j.sqlite") == ['{"board_id": "A"}']


async def test_what_ended_a_runs_job_is_told_though_the_run_stays_unfinished(journal: Journal) -> None:
    """It should be known in the fleet why a run lies there half done."""
    run = BoardRun.model_validate(RUN | {"state": "unfinished", "stopped_by": ""})
    await journal.runs.begin(run)
    await journal.runs.tell(run.id, "unfinished", None, stopped_by="paused by a person")
    await journal.runs.go_on(run, "j2")
    await journal.runs.tell(run.id, "done", None)
    bodies: list[dict[str, Any]] = [record.body or {} for record in (await _all(journal)).records]
    assert [body["state"] for body in bodies] == ["done"] * 3, "the row as it is now stands under each number"
    assert len(bodies) == 3
