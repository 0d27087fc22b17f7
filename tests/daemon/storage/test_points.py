"""Records of points, and what their touches wore, are found again."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from daemon.domain.point_test import PadWear, PointReading, PointRecord, PointVerdict, Rung
from daemon.platform.clock import utc_now
from daemon.storage.journal import Journal
from daemon.storage.journal_schema import BASE_TABLES, SCHEMA_VERSION, UPGRADES


def _record(point: str, run: str | None = None) -> PointRecord:
    reading = PointReading(
        rung=Rung.TOUCH, site_um=(0.0, 0.0), pressed_um=300.0, force_n=0.48, proof=True, contact_ohm=0.2, value=None,
        overload=True, unit="ohm",
    )  # fmt: skip
    return PointRecord(
        point=point, net="CLK", board_id="b17", run=run, method="continuity", limits=None,
        verdict=PointVerdict.OPEN_CONFIRMED, readings=(reading,), touches=1, presses=1, seconds=1.2, at=utc_now(),
    )  # fmt: skip


async def test_points_of_a_run_are_found_in_the_order_of_their_tests(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    first = await journal.add_point("job", _record("A", "run-1"))
    await journal.add_point("job", _record("X", "run-2"))
    await journal.add_point("job", _record("Y"))
    second = await journal.add_point("later", _record("B", "run-1"))
    assert [(n, one.point) for n, _, one in await journal.points_of("run-1", 0, 10)] == [(first, "A"), (second, "B")]
    assert [one.point for *_, one in await journal.points_of("run-1", second, 10)] == ["B"]
    assert [one.point for *_, one in await journal.points_of("run-1", 0, 1)] == ["A"]
    ((*_, found),) = await journal.points_of("run-2", 0, 10)
    assert (found.verdict, found.readings[0].proof) == (PointVerdict.OPEN_CONFIRMED, True)
    await journal.close()


async def test_touches_and_presses_of_a_pad_are_counted_over_visits_and_restarts(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    number = await journal.begin_touch("a", "b17", "TP7", visit="one", rung="touch")
    await journal.tell_touch(number, {"presses": 4, "proof": 1, "reading": "overload"})
    await journal.begin_touch("b", "b17", "TP7", visit="two", rung="touch")
    await journal.begin_touch("c", "b18", "TP7", visit="two")
    await journal.begin_touch("d", None, "TP7")
    await journal.close()
    journal = await Journal.open(tmp_path / "j.sqlite")
    late = "9999"
    assert await journal.wear_of("b17", "TP7", late, "one") == PadWear(2, 5, touches_in_visit=1, presses_in_visit=4)
    assert await journal.wear_of("b17", "TP7", late, "three") == PadWear(2, 5, 0, 0)
    assert await journal.wear_of("b17", "TP8", late, "one") == PadWear(0, 0, 0, 0)
    assert await journal.wear_of(None, "TP7", late, "one") == PadWear(0, 0, 0, 0)
    assert await journal.wear_of(None, "TP7", "", "two") == PadWear(4, 7, 2, 2), "laid in before all of them"
    await journal.close()


async def test_touches_of_a_journal_of_before_count_as_one_press_each(tmp_path: Path) -> None:
    db = sqlite3.connect(tmp_path / "j.sqlite")
    db.executescript(BASE_TABLES + UPGRADES[1] + UPGRADES[2] + "PRAGMA user_version=3;")
    db.execute("INSERT INTO touches(at, job, board_id, point) VALUES (?, 'a', 'b17', 'TP7')", (utc_now(),))
    db.commit()
    db.close()
    journal = await Journal.open(tmp_path / "j.sqlite")
    assert SCHEMA_VERSION >= 4
    assert await journal.wear_of("b17", "TP7", "", "x") == PadWear(1, 1, 0, 0)
    await journal.close()
