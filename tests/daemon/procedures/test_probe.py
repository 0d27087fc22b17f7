"""A point is tested to the verdict that is true of it, and within its budget."""

from __future__ import annotations

import math
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_mark import PointMark
from daemon.domain.point_test import Cause, PointVerdict, Rung
from daemon.procedures import rungs
from daemon.procedures.point_under_test import PointUnderTest
from daemon.procedures.registry import PROCEDURES
from drivers.errors import MeterTimeout, MeterTrouble
from tests.daemon.procedures.fake_probing import (
    INF,
    RADIUS_UM,
    Line,
)
from tests.daemon.procedures.fake_station import run


async def test_a_sound_point_passes_at_the_first_touch(line: Line) -> None:
    record = await line.probe("A")
    assert (record.verdict, record.net, record.touches, record.presses) == (PointVerdict.PASS_FIRST, "NA", 1, 1)
    assert record.readings[0].value == pytest.approx(0.18)
    assert (record.recovered_by, record.cause, record.reason) == (None, None, "")
    assert line.descents_onto("A") == 1


async def test_a_net_is_probed_at_its_best_point(line: Line) -> None:
    assert (await line.probe(net="NB")).point == "B"


async def test_a_misplaced_touch_is_recovered_by_the_eye(line: Line) -> None:
    line.misses_um = [(RADIUS_UM + 100.0, 0.0)]
    record = await line.probe("B")
    assert (record.verdict, record.recovered_by, record.cause) == (
        PointVerdict.PASS_RECOVERED, Rung.LOOK, Cause.MISPLACED,
    )  # fmt: skip
    assert record.error_um == pytest.approx(RADIUS_UM + 100.0, abs=5.0)
    assert [reading.seen for reading in record.readings] == [False, True]
    assert line.descents_onto("B") == 2


async def test_a_correction_that_goes_astray_once_is_begun_again(line: Line) -> None:
    line.misses_um = [(300.0, 0.0), (0.0, 500.0)]
    line.films["B"] = (2, INF)
    record = await line.probe("B")
    assert record.verdict is PointVerdict.PASS_RECOVERED


async def test_a_film_is_recovered_by_pumping(line: Line) -> None:
    line.films["A"] = (4, 300.0)
    record = await line.probe("A")
    assert (record.verdict, record.recovered_by, record.cause) == (
        PointVerdict.PASS_RECOVERED, Rung.PUMP, Cause.FILM,
    )  # fmt: skip
    assert (record.touches, record.presses) == (2, 4)
    assert line.presses_on("A") == 4
    assert line.book.touches[-1]["presses"] == 3


async def test_each_touch_of_a_test_is_told_as_ended_so_that_its_record_carries_what_was_read(line: Line) -> None:
    line.films["A"] = (4, 300.0)
    await line.probe("A")
    told = [(row["rung"], row.get("ended_by")) for row in line.book.touches]
    assert told == [("touch", "lifted"), ("pump", "lifted")]


async def test_a_stubborn_film_is_recovered_at_a_second_site_pressed_harder(line: Line) -> None:
    line.films["A"] = (99, INF)
    line.film_at_middle.add("A")
    record = await line.probe("A")
    assert (record.verdict, record.recovered_by) == (PointVerdict.PASS_RECOVERED, Rung.SECOND_SITE)
    assert math.hypot(*record.readings[-1].site_um) == pytest.approx(RADIUS_UM - 25.0 - 40.0 - 20.0, abs=1.0)
    assert record.readings[-1].pressed_um == pytest.approx(450.0, abs=1.0)
    assert record.touches == 3


async def test_a_film_that_bears_a_push_at_the_second_site_too_is_pumped_there(line: Line) -> None:
    line.films["A"] = (7, 250.0)
    record = await line.probe("A")
    assert (record.verdict, record.touches, record.presses) == (PointVerdict.PASS_RECOVERED, 3, 7)
    assert (record.recovered_by, record.cause) == (Rung.PUMP, Cause.FILM)
    assert all(reading.site_um != (0.0, 0.0) for reading in record.readings[-2:])
    assert record.readings[-1].pressed_um == pytest.approx(450.0, abs=1.0)


async def test_a_pad_whose_film_nothing_breaks_is_pressed_no_more_often_than_it_may_be(line: Line) -> None:
    line.films["A"] = (99, INF)
    record = await line.probe("A")
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert record.presses == line.presses_on("A") == line.world.context.config.touch.presses_per_pad


async def test_a_second_site_is_not_touched_where_the_plan_or_the_pad_has_no_room_for_it(line: Line) -> None:
    line.films["A"] = (99, INF)
    servo = line.world.context.servo.model_copy(update={"tip_radius_um": 260.0})
    line.without(servo=servo)
    record = await line.probe("A")
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert all(reading.site_um == (0.0, 0.0) for reading in record.readings)


async def test_debris_on_the_needle_is_found_on_the_reference_pad_and_brushed_off(line: Line) -> None:
    line.debris_ohm = 5_000.0
    record = await line.probe("A")
    assert (record.verdict, record.recovered_by, record.cause) == (
        PointVerdict.PASS_RECOVERED, Rung.REFERENCE, Cause.NEEDLE,
    )  # fmt: skip
    assert line.world.station.needle.health.brushings == 1


async def test_a_needle_that_one_brushing_leaves_bad_is_brushed_once_more(line: Line) -> None:
    line.debris_ohm, line.brush_helps_from = 5_000.0, 2
    record = await line.probe("A")
    assert (record.verdict, record.recovered_by) == (PointVerdict.PASS_RECOVERED, Rung.REFERENCE)
    assert line.world.station.needle.health.brushings == 2


async def test_without_a_reference_pad_a_broken_net_is_not_accused(line: Line) -> None:
    line.without(reference=None, brush=None)
    line.open_nets.add("NA")
    assert (await line.probe("A")).verdict is PointVerdict.CONTACT_NOT_MADE


async def test_a_value_outside_the_limits_fails_with_contact_proved_twice(line: Line) -> None:
    line.pad_ohm["A"] = 47.0
    record = await line.probe("A", method="resistance", limits={"high": 20.0, "unit": "ohm"})
    assert (record.verdict, record.elsewhere) == (PointVerdict.FAIL, 1)
    assert sum(bool(reading.proof) for reading in record.readings) == 2


async def test_a_film_that_makes_a_value_too_high_is_no_fail(line: Line) -> None:
    line.films["A"] = (99, 4.0)
    record = await line.probe("A", method="resistance", limits={"high": 2.0, "unit": "ohm"})
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE


async def test_a_look_vouches_for_the_presses_where_it_was_taken_and_for_no_earlier_ones(line: Line) -> None:
    """After the reference pad the head came anew: what it stood on before, nobody has seen."""
    line.without(ladder=line.world.context.config.ladder.model_copy(update={"touches_per_visit": 4}))
    line.films["A"] = (99, INF)
    await line.probe("A", job_id="one")
    line.debris_ohm = 5_000.0
    line.open_nets.add("NB")
    ran = line.begin("B", "two")
    vouched: list[list[bool]] = []
    take = rungs.take

    async def watched(rung: Rung, at: PointUnderTest) -> None:
        await take(rung, at)
        vouched.append([one.seen for one in at.attempts])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daemon.procedures.probe_point.take", watched)
        await run(line.world, PROCEDURES["probe"], {}, ran)
    assert line.told[-1].verdict is PointVerdict.OPEN_CONFIRMED
    assert vouched[-1][0] is False
    assert all(vouched[-1][1:])


async def test_a_proof_that_is_closed_while_the_needle_is_up_lowers_nothing(line: Line) -> None:
    line.meter.wires_short = True
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.CONTACT_BEFORE_DESCENT
    assert line.descents_onto("A") == 0
    assert line.book.touches == []


async def test_a_meter_that_says_the_same_whatever_is_there_lowers_nothing(line: Line) -> None:
    line.meter.stuck_ohm = 0.2
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.CONTACT_BEFORE_DESCENT
    assert line.descents_onto("A") == 0


async def test_a_meter_that_fails_while_the_needle_stands_ends_the_job_with_its_cause(line: Line) -> None:
    line.meter.failure = MeterTimeout("does not answer", MeterTrouble.SILENT)
    with pytest.raises(MeterTimeout):
        await line.probe("A")
    assert line.told == []


async def test_a_station_without_a_meter_says_how_to_measure_all_the_same(line: Line) -> None:
    line.without(meter=None, reference=None, brush=None)
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.METER_FAILED
    assert "tester" in caught.value.advice
    assert line.world.gantry.moves == []


@pytest.mark.parametrize(
    ("point", "fields", "why"),
    [
        ("N", {}, "no net"),
        ("A", {"method": "voltage"}, "ground_net"),
        ("A", {"theta_deg": 120.0}, "120"),
    ],
)
async def test_what_cannot_be_tested_is_said_so_and_nothing_is_lowered(
    line: Line, point: str, fields: dict[str, Any], why: str
) -> None:
    record = await line.probe(point, **fields)
    assert record.verdict is PointVerdict.NOT_TESTED
    assert why in record.reason
    assert line.book.touches == []


async def test_a_point_that_a_person_forbade_is_not_tested_and_says_who_and_why(line: Line) -> None:
    line.book.marks["A"] = PointMark(point="A", mark="forbidden", reason="its trace lifts", by="Kim", at="2026-01-01")
    record = await line.probe("A")
    assert record.verdict is PointVerdict.NOT_TESTED
    assert record.reason == "A was forbidden by Kim: its trace lifts"
    assert (line.book.touches, line.world.gantry.moves) == ([], [])
    assert (await line.probe("B")).verdict is PointVerdict.PASS_FIRST


async def test_a_pad_that_was_pressed_before_is_seen_before_it_is_pressed_again(line: Line) -> None:
    await line.probe("A", job_id="one")
    record = await line.probe("A", job_id="two")
    assert record.verdict is PointVerdict.PASS_FIRST
    assert [reading.seen for reading in record.readings] == [True]


@pytest.mark.parametrize("section", ["touches_per_pad", "presses_per_pad"])
async def test_a_pad_is_never_touched_or_pressed_beyond_its_life(line: Line, section: str) -> None:
    touch = line.world.context.config.touch.model_copy(update={section: 4})
    line.without(touch=touch)
    line.lay_in("b17")
    line.films["A"] = (99, INF)
    verdicts = [(await line.probe("A", job_id=f"job-{n}", board_id="b17")).verdict for n in range(4)]
    assert verdicts[0] is PointVerdict.CONTACT_NOT_MADE
    assert verdicts[-1] is PointVerdict.NOT_TESTED
    assert "as often as it may be" in line.told[-1].reason
    count = line.descents_onto("A") if section == "touches_per_pad" else line.presses_on("A")
    assert count <= 4


async def test_the_board_that_was_aligned_is_meant_where_none_is_named(line: Line) -> None:
    line.lay_in("b17")
    assert (await line.probe("A")).board_id == "b17"
    assert line.book.touches[0]["board_id"] == "b17"


async def test_a_board_laid_in_after_the_surface_was_measured_is_refused_and_nothing_moves(line: Line) -> None:
    of_before = line.world.calibrations.in_force.records["surface"]
    line.world.calibrations.store(of_before.model_copy(update={"made_at": "2026-03-01T10:00:00.000+00:00"}))
    line.world.with_alignment(line.world.true_pose, board_id="b18")
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.SURFACE_UNKNOWN
    assert "before this board was aligned" in caught.value.message
    assert (line.world.gantry.moves, line.book.touches, line.book.points) == ([], [], [])


async def test_touches_of_one_visit_are_counted_together_over_restarts(line: Line) -> None:
    line.films["A"] = (99, INF)
    for n in range(3):
        line.book.touches.append(
            {"job": f"before-{n}", "board_id": None, "point": "A", "visit": "job-1", "rung": "touch", "presses": 1}
        )
    record = await line.probe("A")
    assert record.verdict is PointVerdict.NOT_TESTED
    assert "touches_per_visit" in record.reason
