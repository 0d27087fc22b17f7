"""PostgreSQL keeps each row once with how far it is stored, refuses what nobody can read, and answers what is asked."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import asyncpg
import pytest
import structlog

from daemon.fleet.batch import Batch, Row, Stored, lost_row
from daemon.fleet.counts import Counts
from daemon.fleet.database import Arrived, Connection, Database, State, Taken
from daemon.fleet.rollups import bad_pads, keep_rolling, roll_up
from daemon.fleet.topics import StationPath

ONE, TWO, THREE = (StationPath("north", "L1", f"station-{n}") for n in (1, 2, 3))
NOW = datetime(2026, 3, 4, 9, 30, tzinfo=UTC)
AROUND = {"program": "1.0", "configuration": "c0", "board": "demo", "board_side": "top", "needle": "N-1", "tip": "t1"}


def _row(seq: int, kind: str = "report", around: dict[str, Any] | None = None, /, **body: Any) -> Row:
    return {
        "seq": seq,
        "kind": kind,
        "at": NOW.isoformat(),
        "body": {"n": seq, **body},
        "circumstances": around or AROUND,
    }


def _batch(rows: Sequence[Row], journal: str = "J") -> Batch:
    return Batch(journal, 1, None, rows[0]["seq"] - 1, list(rows))


async def _take(database: Database, path: StationPath, rows: Sequence[Row], now: datetime = NOW) -> Taken:
    return await database.take([Arrived(path, _batch(rows))], now)


async def _asked(connection: Connection, sql: str) -> list[tuple[Any, ...]]:
    return [tuple(row) for row in await connection.fetch(sql)]


async def test_a_batch_that_comes_again_is_stored_once_and_answered_again(
    database: Database, connection: Connection
) -> None:
    rows = [_row(seq) for seq in range(1, 6)]
    first = await _take(database, ONE, rows)
    again = await _take(database, ONE, rows)
    assert (first.rows, again.rows) == (5, 0)
    assert [answer.stored for answer in (*first.answers, *again.answers)] == [Stored("J", 5), Stored("J", 5)]
    assert await _asked(connection, "SELECT count(*) FROM records") == [(5,)]
    assert [(answer.path, answer.stored) for answer in await database.stored()] == [(ONE, Stored("J", 5, resume=True))]


async def test_many_stations_and_journals_of_a_group_are_each_stored_under_their_own(
    database: Database, connection: Connection
) -> None:
    group = [
        Arrived(path, Batch(f"{name} of {path.station}", 1, None, 0, [_row(1), _row(2)]))
        for path in (TWO, ONE) for name in ("old", "new")
    ]  # fmt: skip
    taken = await database.take([*group, Arrived(ONE, Batch("new of station-1", 1, None, 2, [_row(3)]))], NOW)
    assert taken.rows == 9
    assert {(answer.path, answer.stored) for answer in await database.stored()} == {
        (ONE, Stored("new of station-1", 3, resume=True)), (TWO, Stored("new of station-2", 2, resume=True)),
    }  # fmt: skip
    sql = (
        "SELECT s.name, j.journal, count(*) FROM records r JOIN journals j ON j.id = r.journal"
        " JOIN stations s ON s.id = r.station AND s.id = j.station GROUP BY 1, 2 ORDER BY 1, 2"
    )
    assert await _asked(connection, sql) == [
        ("station-1", "new of station-1", 3), ("station-1", "old of station-1", 2),
        ("station-2", "new of station-2", 2), ("station-2", "old of station-2", 2),
    ]  # fmt: skip


async def test_rows_and_cursor_move_together_or_not_at_all(database: Database, connection: Connection) -> None:
    await _take(database, ONE, [_row(1)])
    await connection.execute("ALTER TABLE recent ADD CONSTRAINT no_more CHECK (seq < 2)")
    with pytest.raises(asyncpg.CheckViolationError):
        await _take(database, ONE, [_row(2)])
    assert await _asked(connection, "SELECT stored_seq FROM journals") == [(1,)]
    assert await _asked(connection, "SELECT count(*) FROM records") == [(1,)]


@pytest.mark.parametrize(
    "bad",
    [
        {"seq": 2, "kind": None}, {"seq": 2, "kind": "report", "body": []}, {"seq": 2, "kind": "x" * 33, "body": {}},
        {"seq": 2, "kind": "report", "body": {"a": "\0"}}, {"seq": 2, "kind": "report", "body": {"a": "\ud800"}},
        {"seq": 2, "kind": "report", "body": {"a": float("nan")}},
    ],
)  # fmt: skip
async def test_a_row_nobody_can_read_is_kept_apart_with_its_reason_and_the_others_go_on(
    database: Database, connection: Connection, bad: Row
) -> None:
    taken = await _take(database, ONE, [_row(1), bad, _row(3)])
    assert taken.answers[0].stored == Stored("J", 3)
    assert await _asked(connection, "SELECT seq FROM records ORDER BY seq") == [(1,), (3,)]
    ((topic, seq, reason),) = await _asked(connection, "SELECT topic, seq, reason FROM refused")
    assert (topic, seq) == (ONE.topic("records"), 2)
    assert reason


async def test_a_row_the_database_itself_does_not_take_is_kept_apart(
    database: Database, connection: Connection
) -> None:
    await connection.execute(
        "CREATE FUNCTION refuse() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN IF NEW.point = 'poison' THEN"
        " RAISE EXCEPTION 'not this one' USING ERRCODE = 'data_exception'; END IF; RETURN NEW; END $$"
    )
    await connection.execute("CREATE TRIGGER t BEFORE INSERT ON records FOR EACH ROW EXECUTE FUNCTION refuse()")
    rows = [_row(1), _row(2, "touch", point="poison"), _row(3)]
    with pytest.raises(asyncpg.DataError):
        await _take(database, ONE, rows)
    taken = await database.take([Arrived(ONE, _batch(rows))], NOW, singly=True)
    assert taken.answers[0].stored == Stored("J", 3)
    assert await _asked(connection, "SELECT seq FROM records ORDER BY seq") == [(1,), (3,)]
    assert await _asked(connection, "SELECT reason, times FROM refused") == [("not this one", 1)]


async def test_a_hole_is_a_record(database: Database, connection: Connection) -> None:
    batch = Batch("J", 1, None, 0, [lost_row(1, 40), _row(41)])
    taken = await database.take([Arrived(ONE, batch)], NOW)
    assert taken.lost == [(ONE, 40)]
    assert await _asked(connection, "SELECT station, from_seq, to_seq FROM lost_records") == [("station-1", 1, 40)]


async def test_two_stations_of_one_name_are_told_once_and_counted(database: Database, connection: Connection) -> None:
    await database.take([Arrived(ONE, _batch([_row(1)], "A"))], NOW)
    await database.take([Arrived(ONE, _batch([_row(1)], "B"))], NOW)
    for _ in range(2):
        taken = await database.take([Arrived(ONE, _batch([_row(2)], "A"))], NOW)
        assert taken.answers == []
    ((reason, times),) = await _asked(connection, "SELECT reason, times FROM refused")
    assert "two stations report under this name" in reason
    assert times == 2
    assert await _asked(connection, "SELECT count(*) FROM records") == [(2,)]


async def test_a_second_collector_waits_until_the_first_one_is_gone(
    database: Database, connection: Connection, database_url: str
) -> None:
    other = await asyncpg.connect(database_url)
    waiting = asyncio.create_task(Database(other).lock())
    done, _ = await asyncio.wait([waiting], timeout=1.2)
    assert not done
    await connection.close()
    await asyncio.wait_for(waiting, 20.0)
    await other.close()


async def test_the_schema_is_made_once(database: Database) -> None:
    assert await database.migrate() == []


async def test_what_is_kept_no_longer_goes_and_names_of_persons_become_pseudonyms(
    database: Database, connection: Connection
) -> None:
    old = NOW - timedelta(days=100)
    await _take(
        database, ONE, [_row(1, "order", by="M. Weber", op="home", outcome="homed"), _row(2, "order", by=None)], old
    )
    await _take(database, ONE, [_row(3, "order", by="K. Young", op="home", outcome="homed")], NOW)
    gone = await database.keep_house(7, None, NOW)
    assert set(gone) == {f"recent_{day:%Y_%m_%d}" for day in (old, old + timedelta(days=1))}
    names = [name for (name,) in await _asked(connection, "SELECT body ->> 'by' FROM records ORDER BY seq")]
    assert names[0].startswith("person-")
    assert names[1:] == [None, "K. Young"]
    assert await database.keep_house(7, None, NOW) == []
    await _take(database, ONE, [_row(4)], NOW)
    assert "records_2025_11" in await database.keep_house(7, 2, NOW)
    assert await _asked(connection, "SELECT seq FROM records ORDER BY seq") == [(3,), (4,)]


async def test_the_station_clock_decides_about_nothing(database: Database, connection: Connection) -> None:
    times = [
        "2026-03-04T10:30:00+00:00",
        "2026-03-04T09:30:00",
        "1970-01-01T00:00:00Z",
        "no time",
        None,
        "9999-12-31T23:59:59-14:00",
    ]
    rows = [_row(seq) | {"at": at} for seq, at in enumerate(times, start=1)]
    await _take(database, ONE, rows)
    assert len(await _asked(connection, "SELECT 1 FROM records WHERE received_at = '2026-03-04 09:30+00'")) == len(
        times
    )
    assert len(await _asked(connection, "SELECT 1 FROM records WHERE at IS NULL")) == 3


# --- questions ----------------------------------------------------------------------------------------------------


def _points(first: int, bad: frozenset[str], around: dict[str, Any]) -> list[Row]:
    """Ten boards of five points; those in `bad` pass only after a look, which finds 300 um."""
    rows: list[Row] = []
    for board in range(10):
        for point in ("TP1", "TP2", "TP3", "TP4", "TP5"):
            missed = point in bad
            facts = {
                "verdict": "pass_recovered" if missed else "pass_first",
                "recovered_by": "look" if missed else None,
            }
            rows.append(
                _row(
                    first + len(rows),
                    "point",
                    around,
                    point=point,
                    board_id=f"B-{board}",
                    error_um=300.0 if missed else 20.0,
                    job=f"j{board}",
                    **facts,
                )
            )
    return rows


@pytest.fixture
async def planted(database: Database, connection: Connection) -> Database:
    """Three stations, one pad of the design bad on all of them; station 3 has a bent needle, and drifts."""
    for path in (ONE, TWO):
        await _take(database, path, _points(1, frozenset({"TP4"}), AROUND))
    bent = AROUND | {"needle": "N-3"}
    everywhere = frozenset({"TP1", "TP2", "TP3", "TP4", "TP5"})
    await _take(database, THREE, _points(1, everywhere, bent))
    touches = [_row(51 + n, "touch", bent, point="TP1", verdict="pass", ended_by="lifted", value=0.2) for n in range(3)]
    await _take(database, THREE, [*touches, touches[-1] | {"seq": 54}])  # told again as it ended
    await roll_up(connection)
    return database


async def test_the_station_that_stands_apart_is_found(planted: Database, connection: Connection) -> None:
    assert planted
    found = await _asked(
        connection, "SELECT station, median_um, sisters_um, apart_um FROM station_drift ORDER BY apart_um DESC"
    )
    assert found[0] == ("station-3", 300.0, 20.0, 280.0)
    assert [row[3] for row in found[1:]] == [0.0, 0.0]


async def test_the_worst_pad_of_a_design_is_found_and_one_miss_of_three_does_not_lead(
    planted: Database, connection: Connection
) -> None:
    rare = [
        _row(51 + n, "point", AROUND, point="TP9", verdict="pass_first" if n else "open_confirmed") for n in range(3)
    ]
    await _take(planted, ONE, rare)
    await roll_up(connection)
    found = await _asked(
        connection, "SELECT point, misses, stations_missing FROM worst_pads ORDER BY miss_rate_at_least DESC"
    )
    assert found[0] == ("TP4", 30, 3)
    assert found.index(("TP9", 1, 1)) > 0


async def test_false_opens_are_told_by_needle_with_what_cured_them(planted: Database, connection: Connection) -> None:
    assert planted
    sql = "SELECT needle, points, false_opens, by_look, by_pump FROM false_opens ORDER BY needle"
    assert await _asked(connection, sql) == [("N-1", 100, 20, 20, 0), ("N-3", 50, 50, 50, 0)]


async def test_touches_of_a_needle_are_counted_once_each(planted: Database, connection: Connection) -> None:
    assert planted
    assert await _asked(connection, "SELECT station, needle, touches FROM needle_life") == [("station-3", "N-3", 3)]


async def test_a_board_is_followed_over_all_stations(planted: Database, connection: Connection) -> None:
    assert planted
    sql = "SELECT station, count(*), count(body) FROM board_history WHERE board_id = 'B-7' GROUP BY 1 ORDER BY 1"
    assert await _asked(connection, sql) == [(f"station-{n}", 5, 5) for n in (1, 2, 3)]


async def test_board_needle_or_station_is_to_blame(planted: Database, connection: Connection) -> None:
    assert planted
    rows = await _asked(connection, "SELECT station, point, suspect FROM who_is_to_blame")
    found = {(station, point): suspect for station, point, suspect in rows}
    assert found["station-1", "TP4"] == found["station-3", "TP4"] == "board"
    assert found["station-3", "TP1"] == "needle or station"
    assert found["station-1", "TP1"] == "nobody"


async def test_a_pad_that_misses_at_three_stations_is_told_by_the_collector(
    database: Database, connection: Connection
) -> None:
    for path in (ONE, TWO, THREE):
        await _take(database, path, _points(1, frozenset({"TP4"}), AROUND), datetime.now(UTC))
    await _take(database, ONE, _points(51, frozenset({"TP1"}), AROUND | {"board": "other"}), datetime.now(UTC))
    await roll_up(connection)
    assert await _asked(connection, "SELECT board, point, misses, stations_missing FROM bad_pads") == [
        ("demo", "TP4", 30, 3)
    ]
    counts = Counts()
    counts.bad_pads(await bad_pads(connection))
    assert counts.registry.get_sample_value("reprobe_collect_bad_pads", {"board": "demo"}) == 1
    assert counts.registry.get_sample_value("reprobe_collect_bad_pads", {"board": "other"}) == 0


async def test_software_and_state_of_each_station_are_told(planted: Database, connection: Connection) -> None:
    state = {"online": True, "state": "fault", "fault": "not_homed", "alerts": ["light_white"], "program": "1.0"}
    await planted.set_states([State(TWO, state, "{}")])
    assert await _asked(connection, "SELECT station, program, needle FROM software ORDER BY 1") == [
        ("station-1", "1.0", "N-1"), ("station-2", "1.0", "N-1"), ("station-3", "1.0", "N-3"),
    ]  # fmt: skip
    found = await _asked(connection, "SELECT station, online, fault, alerts FROM stations_now ORDER BY 1")
    assert found[1] == ("station-2", True, "not_homed", ["light_white"])
    assert found[0][1] is False


# --- rollups ------------------------------------------------------------------------------------------------------


async def test_what_is_counted_bit_by_bit_is_what_is_counted_at_once(
    database: Database, connection: Connection
) -> None:
    """A touch that ends in the hour after it began counts there, and once."""
    for hour in range(3):
        first = 1 + 20 * hour
        begun = [_row(first + n, "touch", point="TP1") for n in range(10)]
        ended = [_row(first + 10 + n, "touch", n=first - 20 + n, point="TP1", value=0.2) for n in range(10)]
        points = [_row(first + 10 + n, "point", point="TP1", verdict="pass_first", error_um=5.0) for n in range(10)]
        await _take(database, ONE, [*begun, *(ended if hour else points)], NOW + timedelta(hours=hour))
        assert await roll_up(connection) > 0
    assert await roll_up(connection) == 0
    assert await _asked(connection, _COUNTED) == [(1, 10), (2, 20)]
    await connection.execute("TRUNCATE rolled, points_by_hour, looks_by_hour, touches_by_hour")
    await roll_up(connection)
    assert await _asked(connection, _COUNTED) == [(1, 10), (2, 20)]


_COUNTED = "SELECT extract(hour FROM hour - '2026-03-04 09:00+00')::int, touches FROM touches_by_hour ORDER BY 1"


async def test_counting_goes_well_while_what_is_counted_is_stored_on(
    database: Database, connection: Connection, database_url: str
) -> None:
    await _take(database, ONE, [_row(1, "touch", point="TP1")])
    other = await asyncpg.connect(database_url)
    async with other.transaction(isolation="repeatable_read"):
        assert await other.fetchval("SELECT count(*) FROM journals") == 1  # from here on it sees one state of all
        await _take(database, ONE, [_row(2, "touch", point="TP1")])
        await other.fetchval("SELECT roll_up()")
    await other.close()
    assert await _asked(connection, "SELECT touches FROM needle_life") == [(1,)]
    await roll_up(connection)
    assert await _asked(connection, "SELECT touches FROM needle_life") == [(2,)]


async def test_a_journal_that_begins_anew_hides_nothing_of_the_one_before(
    database: Database, connection: Connection
) -> None:
    rows = [_row(n, "point", point="TP1", verdict="pass_first", error_um=20.0) for n in range(1, 4)]
    for journal in ("A", "B"):  # the file was lost: numbers are given again
        await database.take([Arrived(ONE, _batch(rows, journal))], NOW)
    await roll_up(connection)
    assert await _asked(connection, "SELECT tests FROM worst_pads") == [(6,)]
    assert await _asked(connection, "SELECT count(*) FROM newest") == [(6,)]


async def test_counts_stay_when_the_records_of_old_months_are_deleted(
    database: Database, connection: Connection
) -> None:
    rows = [_row(n, "point", point="TP1", verdict="pass_first") for n in range(1, 4)]
    await _take(database, ONE, rows, NOW - timedelta(days=100))
    await roll_up(connection)
    assert await database.keep_house(7, 2, NOW)
    await _take(database, ONE, [_row(4, "point", point="TP1", verdict="pass_first")], NOW)
    await roll_up(connection)
    assert await _asked(connection, "SELECT tests FROM worst_pads") == [(4,)]


async def test_a_head_that_misses_at_some_angles_is_told_by_angle(database: Database, connection: Connection) -> None:
    rows = [
        _row(n + 1, "result", id=f"c{n}", op="correct", ok=True, error_before_um=200.0 if n % 8 == 6 else 20.0,
             detail={"theta_deg": 45.0 * (n % 8) - 360.0 * (n % 2)}) for n in range(16)
    ]  # fmt: skip
    await _take(database, ONE, rows)
    await roll_up(connection)
    found = await _asked(connection, "SELECT from_deg, looks, median_um FROM drift_by_angle ORDER BY median_um DESC")
    assert found[0] == (270, 2, 200.0)
    assert sorted(row[0] for row in found) == [45 * n for n in range(8)]


async def test_an_hour_that_cannot_be_counted_ends_no_storing(
    database: Database, connection: Connection, database_url: str
) -> None:
    await connection.execute("DROP TABLE touches_by_hour CASCADE")
    await _take(database, ONE, [_row(1, "touch", point="TP1")])
    rolling = asyncio.create_task(keep_rolling(database_url, lambda _pads: None))
    with structlog.testing.capture_logs() as logs:
        while not logs and not rolling.done():  # noqa: ASYNC110  # another task's
            await asyncio.sleep(0.05)
    assert logs[0]["event"] == "not_rolled_up"
    assert not rolling.done()
    rolling.cancel()
    with pytest.raises(asyncio.CancelledError):
        await rolling
