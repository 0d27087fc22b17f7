"""A point is tested to the verdict that is true of it, within its budget, and whoever is accused was proved guilty."""

from __future__ import annotations

import asyncio
import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_mark import PointMark
from daemon.domain.point_test import Cause, PointVerdict, Rung
from daemon.domain.states import Event
from daemon.jobs.context import Touching
from daemon.platform.clock import utc_now
from daemon.procedures import rungs
from daemon.procedures.judging import READINGS
from daemon.procedures.meter_readings import MeterReadings
from daemon.procedures.pad_touch import PadTouch
from daemon.procedures.point_under_test import PointUnderTest
from daemon.procedures.probe_point import admit_probing
from daemon.procedures.reference_pad import check_needle
from daemon.procedures.registry import PROCEDURES
from daemon.procedures.tare import tare_of, what_was_read
from daemon.station.free_pin import FreePin
from daemon.station.kinematics import Geometry
from daemon.station.needle import Needle, NeedlePlace
from daemon.station.needle_health import NeedleHealth
from daemon.station.station import LOOKS_FOR_FREE, LookResult
from daemon.storage.calibration_records import Seat
from drivers.deadline import Deadline
from drivers.errors import MeterTimeout, MeterTrouble
from drivers.gantry import Position
from tests.daemon.clock import Clock
from tests.daemon.procedures.fake_probing import (
    CONTACT_OHM,
    INF,
    KELVIN,
    LEAD_OHM,
    RADIUS_UM,
    TOUCH_Z_UM,
    FakeMeter,
    Line,
)
from tests.daemon.procedures.fake_station import SENSE_INPUT, begin, registered, run
from vision import NotFound, Reason
from vision.registration import NotRegistered, Refusal, Registration


@pytest.fixture
def line(tmp_path: Path) -> Line:
    """A station that probes."""
    return Line(tmp_path)


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


async def test_a_needle_that_stays_bad_ends_it_all_and_nobody_is_accused(line: Line) -> None:
    line.debris_ohm, line.brush_helps = 5_000.0, False
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.PROBE_BAD
    assert caught.value.kind.latched
    assert line.told == []
    line.see_rules_kept()


async def test_a_broken_net_is_confirmed_open_by_two_proofs_and_a_good_needle(line: Line) -> None:
    line.open_nets.add("NA")
    record = await line.probe("A")
    assert record.verdict is PointVerdict.OPEN_CONFIRMED
    assert [reading.proof for reading in record.readings] == [True, True]
    assert record.touches == 2
    assert line.world.station.needle.health.good_within(60.0)


async def test_a_net_that_is_broken_and_was_missed_at_first_takes_two_presses_on_the_pad(line: Line) -> None:
    line.open_nets.add("NB")
    line.misses_um = [(RADIUS_UM + 100.0, 0.0)]
    record = await line.probe("B")
    assert record.verdict is PointVerdict.OPEN_CONFIRMED
    assert [(reading.proof, reading.seen) for reading in record.readings] == [
        (False, False),
        (True, True),
        (True, True),
    ]


def _first_press_lands_on_b(line: Line) -> None:
    """Have the first press miss by the whole way from A to B."""
    line.misses_um = [(6_000.0, 0.0)]
    servo = line.world.context.servo.model_copy(update={"max_placement_um": 7_000.0})
    line.without(servo=servo)
    line.world.put_tip(line.world.pad_um("C"), z_um=6_000.0)
    line.world.station.needle.reported(line.world.gantry.reported)


async def test_a_neighbour_that_was_stood_on_proves_nothing(line: Line) -> None:
    """The first press lands on B while A is asked for; that A's net is not there accuses nobody."""
    _first_press_lands_on_b(line)
    record = await line.probe("A")
    assert record.verdict in (PointVerdict.PASS_RECOVERED, PointVerdict.CONTACT_NOT_MADE)


async def test_a_pad_that_gives_no_contact_is_called_that_and_not_open(line: Line) -> None:
    line.films["A"] = (99, INF)
    record = await line.probe("A")
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert "nobody knows" in record.reason
    assert not any(reading.proof for reading in record.readings)
    assert record.touches <= 3


async def test_without_a_second_wire_a_broken_net_is_not_accused(line: Line) -> None:
    config = line.world.context.config
    line.without(meter=config.meter.model_copy(update={"contact_channel": None}))
    line.open_nets.add("NA")
    record = await line.probe("A")
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert "contact_channel" in record.reason


@pytest.mark.parametrize("broken", ["wire", "net at its joint"])
async def test_a_channel_that_reads_nowhere_accuses_no_net(line: Line, broken: str) -> None:
    """A wire of the harness that is broken looks at each point of its net as the net itself would."""
    if broken == "wire":
        line.harness_open.add(101)
    else:
        line.open_nets.add("NA")
        line.whole.clear()
    record = await line.probe("A")
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert "net or harness, nobody knows" in record.reason
    assert [reading.proof for reading in record.readings] == [True, True]
    assert (record.touches, record.elsewhere) == (2, 1)
    assert (line.descents_onto("A"), line.descents_onto("A2")) == (2, 1)


async def test_an_open_is_confirmed_where_another_point_of_the_net_reads_through_the_same_channel(line: Line) -> None:
    line.open_nets.add("NA")
    record = await line.probe("A")
    assert record.verdict is PointVerdict.OPEN_CONFIRMED
    assert (record.touches, record.elsewhere, line.descents_onto("A2")) == (2, 1, 1)
    assert [row["rung"] for row in line.book.touches if row["point"] == "A2"] == ["path"]


async def test_the_proof_costs_no_more_descents_than_a_test_may(line: Line) -> None:
    line.open_nets.add("NA")
    ladder = line.world.context.config.ladder.model_copy(update={"touches_per_visit": 2})
    line.without(ladder=ladder)
    record = await line.probe("A")
    assert (record.verdict, record.touches, record.elsewhere) == (PointVerdict.CONTACT_NOT_MADE, 2, 0)


async def test_another_point_is_seen_before_it_is_touched_for_the_proof(line: Line) -> None:
    line.open_nets.add("NA")
    line.misses_um = [(0.0, 0.0), (300.0, 0.0)]
    record = await line.probe("A")
    assert (record.verdict, record.elsewhere) == (PointVerdict.OPEN_CONFIRMED, 1)
    presses = [n for n, (target, _) in enumerate(line.world.gantry.moves) if target.z_um < TOUCH_Z_UM - 100.0]
    assert line.looks_at_move[presses[-1]] > line.looks_at_move[presses[-2]]


async def test_of_a_net_with_many_points_no_more_than_a_few_are_looked_for(line: Line) -> None:
    """Whatever keeps the eye from them; a plane's net has hundreds."""
    gone: list[str] = []

    async def unseen(at: PointUnderTest, *_args: Any) -> Any:
        gone.append(at.test.point)
        raise Fault(FaultCode.AMBIGUOUS)

    points = tuple(
        p.model_copy(update={"net": "NA"}) if p.name in ("B2", "C", "N", "B") else p for p in line.world.board.points
    )
    line.world.context.board = line.world.board.model_copy(update={"points": points})
    line.open_nets.add("NA")
    see = PointUnderTest.see
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PointUnderTest, "see", lambda at, *args: (see if at.test.point == "A" else unseen)(at, *args))
        record = await line.probe("A")
    assert (record.verdict, record.elsewhere) == (PointVerdict.CONTACT_NOT_MADE, 0)
    assert len(gone) == 3


async def test_a_net_of_one_point_is_not_accused(line: Line) -> None:
    line.open_nets.add("NC")
    record = await line.probe("C")
    assert (record.verdict, record.elsewhere) == (PointVerdict.CONTACT_NOT_MADE, 0)
    assert "harness" in record.reason


async def test_a_channel_that_breaks_after_another_point_was_read_through_it_accuses_no_net(line: Line) -> None:
    health = NeedleHealth()
    assert (await line.probe_in_run("A2", health)).verdict is PointVerdict.PASS_FIRST
    line.harness_open.add(101)
    record = await line.probe_in_run("A", health)
    assert (record.verdict, record.elsewhere, record.plan_hash) == (PointVerdict.CONTACT_NOT_MADE, 0, "5d41")
    assert "net or harness, nobody knows" in record.reason
    assert line.descents_onto("A2") == 1, "it has its verdict in this run"


async def test_what_a_channel_read_in_an_earlier_test_proves_nothing_now(line: Line) -> None:
    assert (await line.probe("A2", job_id="one")).verdict is PointVerdict.PASS_FIRST
    line.harness_open.add(101)
    assert (await line.probe("A", job_id="two")).verdict is PointVerdict.CONTACT_NOT_MADE


@pytest.mark.parametrize("method", ["continuity", "resistance", "fres"])
async def test_a_harness_that_adds_ohms_fails_no_net(line: Line, method: str) -> None:
    """What is too high at every point of a net may be the harness' own."""
    line.net_ohm["NA"] = 47.0
    record = await line.probe("A", method=method, limits={"high": 10.0, "unit": "ohm"})
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert "harness" in record.reason
    assert record.elsewhere == 1


@pytest.mark.parametrize(
    ("method", "limits", "says"),
    [
        ("voltage", {"low": 3.0, "high": 3.6, "unit": "V"}, 0.0),
        ("capacitance", {"low": 1e-9, "unit": "F"}, 3e-12),
        ("voltage", {"low": -1.0, "high": 3.6, "unit": "V"}, INF),
        ("voltage", {"low": -1.0, "high": 3.6, "unit": "V"}, -INF),
        ("capacitance", {"low": 1e-12, "unit": "F"}, INF),
        ("diode", {"high": 0.7, "unit": "V"}, INF),
        ("diode", {"high": 0.7, "unit": "V"}, 1.1),
    ],
)
@pytest.mark.parametrize("whole", [True, False])
async def test_what_is_measured_against_ground_accuses_only_where_the_wire_of_ground_reads(
    line: Line, method: str, limits: dict[str, Any], says: float, whole: bool
) -> None:
    line.without(meter=line.world.context.config.meter.model_copy(update={"ground_net": "NB"}))
    if not whole and math.isinf(says):
        line.harness_open.add(102)
    elif not whole:
        line.net_ohm["NB"] = 400.0
    meter = line.meter
    meter.says = lambda: (says if line.is_down else INF) if meter.asked[-1] == method else meter.true_ohm()
    record = await line.probe("A", method=method, limits=limits)
    assert record.verdict is (PointVerdict.FAIL if whole else PointVerdict.CONTACT_NOT_MADE), "and never an open net"
    assert line.descents_onto("B") + line.descents_onto("B2") == record.elsewhere > 0


async def test_a_value_that_is_too_low_by_its_tare_alone_fails_no_net(line: Line) -> None:
    """The reference pad may have been read through a bad contact."""
    line.world.station.needle.health.read(LEAD_OHM + CONTACT_OHM + 0.6, good=True, of=what_was_read(line.world.context))
    line.net_ohm["NA"] = 1.0
    record = await line.probe("A", method="resistance", limits={"low": 0.9, "high": 2.0, "unit": "ohm"})
    assert record.readings[0].value == pytest.approx(0.4)
    assert record.verdict is PointVerdict.PASS_RECOVERED, "the reference pad was read again"


async def test_values_that_contradict_each_other_fail_no_net(line: Line) -> None:
    limits, meter = {"low": 50.0, "high": 60.0, "unit": "ohm"}, line.meter

    def says() -> float:
        ohm = meter.true_ohm()
        return ohm if math.isinf(ohm) or KELVIN in meter.channels else (40.0, 80.0)[line.presses_on("A") % 2]

    meter.says = says
    record = await line.probe("A", method="resistance", limits=limits, touches=2)
    assert record.verdict is not PointVerdict.PASS_FIRST
    assert len(record.readings) > 2, "one of each is no pair"


async def test_a_point_that_has_its_verdict_in_this_run_is_not_touched_for_the_proof_of_another(line: Line) -> None:
    """It may have been called not_tested before anything touched it."""
    line.open_nets.add("NA")
    record = await line.probe_in_run("A", NeedleHealth(), done=frozenset({"A2"}))
    assert (record.verdict, record.elsewhere) == (PointVerdict.CONTACT_NOT_MADE, 0)
    assert line.descents_onto("A2") == 0


async def test_a_wire_of_the_harness_that_touches_the_needles_passes_no_net(line: Line) -> None:
    line.open_nets.add("NA")
    line.joined.add(101)
    record = await line.probe("A")
    assert (record.verdict, record.touches) == (PointVerdict.NOT_TESTED, 0)
    assert "101" in record.reason
    assert (await line.probe("B", job_id="two")).verdict is PointVerdict.PASS_FIRST


async def test_without_a_second_wire_such_a_harness_may_be_a_board_that_came_up(line: Line) -> None:
    config = line.world.context.config
    line.without(meter=config.meter.model_copy(update={"contact_channel": None}))
    line.joined.add(101)
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.CONTACT_BEFORE_DESCENT
    assert line.world.gantry.reported.z_um >= config.gantry.free_z_um


@pytest.mark.parametrize(("stuck", "broken"), [(KELVIN, True), (KELVIN, False), (101, False)])
async def test_a_relay_that_sticks_passes_no_net(line: Line, stuck: int, broken: bool) -> None:
    """By the needle's second wire each net passes that the needle stands on, and a broken one too."""
    line.meter.stuck_channels = (stuck,)
    if broken:
        line.open_nets.add("NA")
    record = await line.probe("A")
    assert (record.verdict, record.presses) == (PointVerdict.CONTACT_NOT_MADE, 2)
    assert "with no channel closed" in record.reason


async def test_a_relay_that_sticks_fails_no_net_either(line: Line) -> None:
    line.meter.stuck_channels = (KELVIN,)
    line.net_ohm["NA"] = 55.0
    record = await line.probe("A", method="resistance", limits={"low": 50.0, "high": 60.0, "unit": "ohm"})
    assert (record.verdict, record.presses) == (PointVerdict.CONTACT_NOT_MADE, 2)
    assert "with no channel closed" in record.reason


@pytest.mark.parametrize("welded", [KELVIN, 104])
async def test_a_relay_that_welds_right_after_another_point_passed_passes_no_net(line: Line, welded: int) -> None:
    """Of the needle's second wire, or of a neighbour on whose pad the needle stands instead."""
    assert (await line.probe("C", job_id="before")).verdict is PointVerdict.PASS_FIRST
    line.meter.stuck_channels = (welded,)
    line.open_nets.add("NB")
    if welded != KELVIN:
        line.misses_um = [(0.0, 700.0)]
    record = await line.probe("B")
    assert record.readings[0].value == pytest.approx(CONTACT_OHM + LEAD_OHM, abs=0.05), "it read like a pass"
    assert record.verdict is (PointVerdict.CONTACT_NOT_MADE if welded == KELVIN else PointVerdict.OPEN_CONFIRMED)


async def test_each_pass_is_read_once_more_with_no_channel_closed_and_what_was_so_before_counts_for_none(
    line: Line,
) -> None:
    for job_id in ("one", "two"):
        line.meter.asked.clear()
        assert (await line.probe("B", job_id=job_id)).verdict is PointVerdict.PASS_FIRST
        before_and_after = 2
        assert line.meter.asked.count("continuity") == READINGS + before_and_after


@pytest.mark.parametrize("joined", [True, False])
async def test_what_leads_add_hides_neither_a_welded_relay_nor_joined_wires(line: Line, joined: bool) -> None:
    """A limit below the leads' own ohms is held after they are taken off."""
    health = line.world.station.needle.health
    health.read(LEAD_OHM + CONTACT_OHM, good=True, of=what_was_read(line.world.context))
    line.open_nets.add("NB")
    if joined:
        line.joined_wires.append({102, 104})
        line.misses_um = [(0.0, 700.0)]
    else:
        line.meter.stuck_channels = (KELVIN,)
    record = await line.probe("B", method="resistance", limits={"high": 0.1, "unit": "ohm"})
    assert record.readings[0].value == pytest.approx(0.0, abs=0.05), "it read like a pass"
    assert record.verdict is (PointVerdict.OPEN_CONFIRMED if joined else PointVerdict.CONTACT_NOT_MADE)


@pytest.mark.parametrize("broken", [True, False])
async def test_a_neighbour_whose_wire_of_the_harness_is_joined_passes_no_net_and_both_are_named(
    line: Line, broken: bool
) -> None:
    line.joined_wires.append({102, 104})
    line.misses_um = [(0.0, 700.0)]
    if broken:
        line.open_nets.add("NB")
    record = await line.probe("B")
    assert record.readings[0].value == pytest.approx(CONTACT_OHM + LEAD_OHM, abs=0.05), "it read like a pass"
    assert record.verdict is (PointVerdict.OPEN_CONFIRMED if broken else PointVerdict.PASS_RECOVERED)
    assert [reading.seen for reading in record.readings] == ([False, True, True] if broken else [False, True])
    assert broken or all(name in record.reason for name in ("NB", "NS", "102", "104"))


async def test_where_wires_are_joined_a_look_vouches_for_the_first_touch_and_none_is_added(line: Line) -> None:
    line.joined_wires.append({102, 104})
    record = await line.probe("B")
    assert (record.verdict, record.touches, record.presses) == (PointVerdict.PASS_FIRST, 1, 1)
    assert record.looks > 1
    assert all(name in record.reason for name in ("NB", "NS", "102", "104"))


async def test_a_look_vouches_for_the_last_touch_that_a_pad_may_have_and_spends_none(line: Line) -> None:
    line.joined_wires.append({102, 104})
    record = await line.probe("B", touches=1)
    assert (record.verdict, record.touches, record.presses) == (PointVerdict.PASS_FIRST, 1, 1)


async def test_a_last_touch_beside_its_pad_passes_nothing_and_is_followed_by_none(line: Line) -> None:
    line.joined_wires.append({102, 104})
    line.misses_um = [(0.0, 700.0)]
    record = await line.probe("B", touches=1)
    assert (record.verdict, record.touches, record.presses) == (PointVerdict.CONTACT_NOT_MADE, 1, 1)
    assert all(name in record.reason for name in ("NB", "NS", "102", "104"))


async def test_where_nobody_may_look_joined_wires_are_named_as_what_kept_a_point_from_its_pass(line: Line) -> None:
    ladder = line.world.context.config.ladder.model_copy(update={"order": ()})
    line.without(ladder=ladder)
    line.joined_wires.append({102, 104})
    record = await line.probe("B")
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert all(name in record.reason for name in ("NB", "NS", "102", "104"))


@pytest.mark.parametrize(
    ("method", "limits", "says"),
    [
        ("diode", {"low": 0.4, "high": 0.8, "unit": "V"}, 0.0),
        ("capacitance", {"low": 1e-12, "high": 1e-9, "unit": "F"}, INF),
    ],
)
@pytest.mark.parametrize("joined", [True, False])
async def test_a_net_whose_wire_is_joined_to_grounds_is_not_accused_of_a_short(
    line: Line, method: str, limits: dict[str, Any], says: float, joined: bool
) -> None:
    line.without(meter=line.world.context.config.meter.model_copy(update={"ground_net": "NB"}))
    if joined:
        line.joined_wires.append({101, 102})
    meter = line.meter
    meter.says = lambda: (says if line.is_down else INF) if meter.asked[-1] == method else meter.true_ohm()
    record = await line.probe("A", method=method, limits=limits)
    assert record.verdict is (PointVerdict.CONTACT_NOT_MADE if joined else PointVerdict.FAIL)
    assert not joined or all(name in record.reason for name in ("NA", "NB", "101", "102"))


async def test_the_other_points_pad_keeps_its_budget(line: Line) -> None:
    line.open_nets.add("NA")
    line.lay_in("b1")
    for n in range(line.world.context.config.touch.touches_per_pad):
        line.book.touches.append(
            {"job": f"j{n}", "board_id": "b1", "point": "A2", "visit": "-", "rung": "touch", "presses": 1}
        )
    record = await line.probe("A", board_id="b1")
    assert (record.verdict, record.elsewhere) == (PointVerdict.CONTACT_NOT_MADE, 0)
    assert line.descents_onto("A2") == 0


async def test_another_point_that_a_person_has_forbidden_is_not_touched_for_the_proof(line: Line) -> None:
    line.open_nets.add("NA")
    line.book.marks["A2"] = PointMark(point="A2", mark="forbidden", reason="it lifts", by="ada", at=utc_now())
    record = await line.probe("A")
    assert (record.verdict, record.elsewhere) == (PointVerdict.CONTACT_NOT_MADE, 0)
    assert line.descents_onto("A2") == 0


async def test_a_meter_that_fails_while_the_needle_stands_on_the_other_point_ends_the_job(line: Line) -> None:
    line.open_nets.add("NA")
    line.meter.failure_on["A2"] = MeterTimeout("does not answer", MeterTrouble.SILENT)
    with pytest.raises(MeterTimeout):
        await line.probe("A")
    assert line.told == []


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


async def test_the_second_of_two_points_without_a_pass_asks_the_reference_pad_before_its_pad_is_touched_again(
    line: Line,
) -> None:
    line.films["A"] = line.films["B"] = (99, INF)
    await line.probe("A", job_id="one")
    checks = line.world.station.needle.health.checks
    line.debris_ohm = 5_000.0
    line.films.clear()
    record = await line.probe("B", job_id="two")
    assert (record.verdict, record.recovered_by) == (PointVerdict.PASS_RECOVERED, Rung.REFERENCE)
    assert record.touches == 2, "nothing but the needle was tried"
    assert line.world.station.needle.health.checks == checks + 2


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


async def test_that_no_board_is_seen_is_one_points_verdict_and_at_two_in_a_row_the_end(line: Line) -> None:
    def unseen(look: LookResult) -> LookResult:
        board = look.board
        gone = NotRegistered(Refusal.NO_BOARD, "the red picture is one dark plane", None)
        return look if board is None else replace(look, board=replace(board, found=gone))

    line.world.station.always = unseen
    line.films["A"] = line.films["B"] = (99, INF)
    record = await line.probe("A", job_id="one")
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert "one dark plane" in record.reason
    with pytest.raises(Fault) as caught:
        await line.probe("B", job_id="two")
    assert caught.value.kind is FaultCode.NO_BOARD
    assert line.descents_onto("B") == 1


async def test_what_cannot_be_seen_from_one_side_is_looked_at_from_another(line: Line) -> None:
    def poor(look: LookResult) -> LookResult:
        board = look.board
        poorly = NotRegistered(Refusal.NOT_THIS_BOARD, "0.41 of it agrees at best", None)
        from_here = abs(look.position.theta_deg) < 1.0
        return look if board is None or not from_here else replace(look, board=replace(board, found=poorly))

    line.world.station.always = poor
    line.films["A"] = (2, INF)
    record = await line.probe("A")
    assert record.verdict is PointVerdict.PASS_RECOVERED
    turned = line.world.gantry.reported.theta_deg % 360.0
    assert turned == pytest.approx(180.0)
    line.world.station.always = lambda look: look


async def test_a_picture_that_mostly_agrees_is_looked_at_from_a_step_aside(line: Line) -> None:
    refused: list[Position] = []

    def hidden(look: LookResult) -> LookResult:
        board = look.board
        if board is None or (refused and look.position != refused[0]):
            return look
        refused.append(look.position)
        best = registered((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), agreement=0.8)
        found = NotRegistered(Refusal.NOT_THIS_BOARD, "0.88 of its metal is seen (0.91 needed)", best)
        return replace(look, board=replace(board, found=found))

    line.world.station.always = hidden
    line.misses_um = [(RADIUS_UM + 100.0, 0.0)]
    record = await line.probe("A", theta_deg=0.0)
    assert record.verdict is PointVerdict.PASS_RECOVERED
    assert refused


@pytest.mark.parametrize(("agreement", "believed"), [(0.8, True), (0.7, False)])
async def test_a_poor_view_of_a_way_astray_counts_at_a_verified_seat_where_enough_of_the_board_is_seen(
    line: Line, agreement: float, believed: bool
) -> None:
    """Where not enough is seen, a look from a step aside says where the pad is."""

    def poor(look: LookResult) -> LookResult:
        board = look.board
        if board is None or not isinstance(board.found, Registration):
            return look
        best = replace(board.found, agreement=agreement, metal_seen=0.88)
        found = NotRegistered(Refusal.NOT_THIS_BOARD, "0.88 of its metal is seen (0.91 needed)", best)
        return replace(look, board=replace(board, found=found))

    line.world.with_head(line.world.true_head)
    line.lay_in("SN-1", Seat(verified=True, places=4, agreement=0.9))
    line.world.station.always = poor
    line.misses_um = [(RADIUS_UM + 100.0, 0.0)]
    record = await line.probe("A", theta_deg=0.0)
    assert record.verdict is PointVerdict.PASS_RECOVERED
    assert record.error_um == pytest.approx(RADIUS_UM + 100.0 if believed else 0.0, abs=20.0)


async def test_what_names_no_net_is_touched_only_after_a_look(line: Line) -> None:
    line.misses_um = [(RADIUS_UM + 100.0, 0.0)]
    record = await line.probe("A", method="contact")
    assert record.verdict is PointVerdict.PASS_FIRST
    assert record.looks
    assert record.error_um == pytest.approx(RADIUS_UM + 100.0, abs=20.0)


async def test_an_angle_that_the_test_wants_is_kept_whatever_is_seen_from_it(line: Line) -> None:
    def poor(look: LookResult) -> LookResult:
        poorly = NotRegistered(Refusal.NOT_THIS_BOARD, "0.41 of it agrees at best", None)
        return look if look.board is None else replace(look, board=replace(look.board, found=poorly))

    line.world.station.always = poor
    line.films["A"] = (2, INF)
    record = await line.probe("A", theta_deg=0.0)
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert all(target.theta_deg == 0.0 for target, _ in line.world.gantry.moves)


async def test_a_point_that_was_recovered_has_the_pictures_of_the_miss_and_of_the_end(line: Line) -> None:
    line.misses_um = [(RADIUS_UM + 100.0, 0.0)]
    await line.probe("B")
    ((first, last),) = line.looks
    assert first is not None
    assert last is not None
    assert first.board is not None, "it shows the board, and so where the tip was"
    assert first.position.x_um != last.position.x_um


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


async def test_the_values_are_less_what_the_leads_add_once_the_reference_pad_was_read(line: Line) -> None:
    line.open_nets.add("NA")
    await line.probe("A", job_id="one")
    record = await line.probe("B", job_id="two")
    assert record.readings[-1].value == pytest.approx(0.0, abs=1e-6)


TARED, UNTARED = pytest.approx(0.0, abs=1e-6), pytest.approx(LEAD_OHM + CONTACT_OHM)


async def _tared(line: Line) -> Clock:
    """Have the reference pad read; return the clock by which that ages."""
    line.world.station.needle.health.now_s = clock = Clock()
    line.debris_ohm = 5_000.0
    await line.probe("C", job_id="one")
    return clock


async def test_the_record_says_which_tare_was_taken_off_and_how_old_it_is(line: Line) -> None:
    clock = await _tared(line)
    clock.now_s += 100.0
    reading = (await line.probe("B", job_id="two")).readings[-1]
    assert (reading.value, reading.tare_ohm, reading.tare_age_s) == (TARED, UNTARED, 100.0)


async def test_a_tare_that_has_aged_is_taken_off_no_more(line: Line) -> None:
    clock = await _tared(line)
    clock.now_s += line.world.context.config.reference.tare_s + 1.0
    reading = (await line.probe("B", job_id="two")).readings[-1]
    assert (reading.value, reading.tare_ohm, reading.tare_age_s) == (UNTARED, None, None)


@pytest.mark.parametrize("changed", ["reference", "meter section", "meter", "needle"])
async def test_a_tare_of_another_needle_meter_or_pad_is_taken_off_no_value(line: Line, changed: str) -> None:
    await _tared(line)
    config = line.world.context.config
    if changed == "reference":
        line.without(reference=config.reference.model_copy(update={"max_ohm": 2.0}))
    elif changed == "meter section":
        line.without(meter=config.meter.model_copy(update={"channels": {**config.meter.channels, "NX": 199}}))
    elif changed == "meter":
        line.world.station.fit(FakeMeter(line))
    else:
        line.world.teach(tip_px=(500.0, 500.0))
    assert tare_of(line.world.context, line.world.station.needle.health) is None
    line.open_nets.clear()
    if changed != "needle":  # who teaches it anew calibrates the map, too
        reading = (await line.probe("B", job_id="two")).readings[-1]
        assert (reading.value, reading.tare_ohm) == (UNTARED, None)


async def _measured(line: Line, *words: dict[str, Any]) -> Any:
    """Probe with a tester that says these words, press after press."""
    ran = line.begin("A", measure="tester", lease_ms=20_000.0)
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    for said in words:
        await line.stands.wait()
        line.stands.clear()
        assert line.is_down
        assert line.held is not None
        line.held.lift("", said)
    await job
    line.see_rules_kept()
    return line.told[-1]


async def test_a_tester_that_measures_is_asked_again_after_each_rung(line: Line) -> None:
    line.films["A"] = (99, INF)
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"}, {"verdict": "pass"})
    assert (record.verdict, record.recovered_by) == (PointVerdict.PASS_RECOVERED, Rung.PUMP)
    assert [reading.said for reading in record.readings] == ["open", "open", "pass"]


async def test_the_stations_second_wire_proves_what_the_tester_calls_open(line: Line) -> None:
    line.open_nets.add("NA")
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert (record.verdict, record.elsewhere) == (PointVerdict.OPEN_CONFIRMED, 1)


async def test_in_a_testers_press_the_stations_instrument_is_connected_to_nothing(line: Line) -> None:
    line.open_nets.add("NA")
    connected, made = [], line.touching

    def touching(key: str = "") -> Touching:
        told = made(key)

        def stands(contact: ContactFacts) -> None:
            connected.append(line.meter.channels)
            told.made(contact)

        return replace(told, made=stands)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(line, "touching", touching)
        await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert connected == [(), ()]


async def test_what_the_tester_calls_open_and_the_stations_instrument_reads_well_is_the_testers_wiring(
    line: Line,
) -> None:
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert (record.verdict, record.presses) == (PointVerdict.CONTACT_NOT_MADE, 2)
    assert "0.18 ohm in the same press" in record.reason


async def test_a_relay_that_sticks_is_no_witness_against_the_testers_wiring(line: Line) -> None:
    line.meter.stuck_channels = (101,)
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert (record.verdict, record.presses) == (PointVerdict.CONTACT_NOT_MADE, 2)
    assert "a relay of the scanner sticks" in record.reason
    assert "tester's wiring" not in record.reason


async def test_a_broken_harness_accuses_no_net_by_the_testers_word_either(line: Line) -> None:
    """The station's channel is broken, too, so that nothing contradicts the tester."""
    line.harness_open.add(101)
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert (record.verdict, record.elsewhere) == (PointVerdict.CONTACT_NOT_MADE, 1)
    assert "net or harness, nobody knows" in record.reason


async def test_a_tester_that_calls_a_net_a_fail_has_measured_something_else(line: Line) -> None:
    record = await _measured(line, {"verdict": "fail"}, {"verdict": "fail"})
    assert (record.verdict, record.elsewhere) == (PointVerdict.FAIL, 0)


async def test_a_net_that_has_to_be_open_is_not_passed_on_another_pad(line: Line) -> None:
    """Any pad would: so it is seen before it is touched."""
    _first_press_lands_on_b(line)
    record = await line.probe("A", method="resistance", limits={"low": 1e6, "unit": "ohm"})
    assert record.verdict is not PointVerdict.PASS_FIRST
    assert line.descents_onto("B") == 0


async def test_where_the_stations_harness_does_not_reach_the_net_the_testers_word_counts(line: Line) -> None:
    line.without(meter=line.world.context.config.meter.model_copy(update={"channels": {"NB": 102}}))
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert (record.verdict, record.elsewhere) == (PointVerdict.OPEN_CONFIRMED, 0)


async def test_without_a_meter_the_tester_alone_accuses_nobody(line: Line) -> None:
    line.without(meter=None, reference=None, brush=None)
    record = await _measured(line, *[{"verdict": "open"}] * 8)
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE


async def test_a_word_that_comes_after_the_next_press_has_begun_is_not_taken_for_it(line: Line) -> None:
    ran = line.begin("A", measure="tester", lease_ms=20_000.0)
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    held = line.held
    assert held is not None
    told = []
    for said in ("open", "pass"):
        await line.stands.wait()
        line.stands.clear()
        told.append(line.stood[-1].press)
        if said == "pass":
            with pytest.raises(Fault) as late:
                held.lift("", {"verdict": "fail"}, told[0])
            assert late.value.kind is FaultCode.ANOTHER_PRESS
        held.lift("", {"verdict": said}, told[-1])
    await job
    assert told == [1, 2]
    assert [reading.said for reading in line.told[-1].readings] == ["open", "pass"]
    assert ran.got.detail["press"] == 2


async def test_a_testers_value_is_judged_by_the_limits(line: Line) -> None:
    ran = line.begin("A", measure="tester", method="resistance", limits={"low": 90.0, "high": 110.0, "unit": "ohm"})
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    await line.stands.wait()
    assert line.held is not None
    line.held.lift("", {"value": 100.0, "unit": "ohm"})
    await job
    assert line.told[-1].verdict is PointVerdict.PASS_FIRST
    assert line.contacts == ["made", "lifted"]


async def test_a_fault_is_inserted_while_the_needle_stands(line: Line) -> None:
    ran = line.begin("A", measure="tester", method="insert")
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    await line.stands.wait()
    assert line.held is not None
    line.held.lift("", {})
    await job
    assert line.told[-1].verdict is PointVerdict.PASS_FIRST


async def test_a_tester_whose_lease_runs_out_ends_the_job(line: Line) -> None:
    with pytest.raises(Fault) as caught:
        await run(line.world, PROCEDURES["probe"], {}, line.begin("A", measure="tester", lease_ms=200.0))
    assert caught.value.kind is FaultCode.LEASE_EXPIRED


async def test_a_tester_that_says_nothing_to_the_end_has_not_tested(line: Line) -> None:
    ran = line.begin("A", measure="tester", hold_ms=200.0)
    await run(line.world, PROCEDURES["probe"], {}, ran)
    line.see_rules_kept()
    assert line.told[-1].verdict is PointVerdict.NOT_TESTED


async def test_a_lift_without_a_word_is_no_pass(line: Line) -> None:
    """Whoever wants the needle up, for whatever reason, has measured nothing."""
    record = await _measured(line, {})
    assert record.verdict is PointVerdict.NOT_TESTED


async def test_a_value_within_limits_that_the_tester_calls_a_fail_is_no_pass(line: Line) -> None:
    limits = {"low": 90.0, "high": 110.0, "unit": "ohm"}
    ran = line.begin("A", measure="tester", method="resistance", limits=limits, touches=1)
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    await line.stands.wait()
    assert line.held is not None
    line.held.lift("", {"verdict": "fail", "value": 100.0, "unit": "ohm"})
    await job
    assert line.told[-1].verdict is PointVerdict.CONTACT_NOT_MADE


async def test_what_is_said_again_of_the_press_before_is_not_taken_for_the_next(line: Line) -> None:
    ran = line.begin("A", measure="tester", lease_ms=20_000.0)
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    await line.stands.wait()
    line.stands.clear()
    assert line.held is not None
    line.held.lift("", {"verdict": "open"})
    while line.is_down:  # noqa: ASYNC110  # each turn lets the job go on
        await asyncio.sleep(0)
    line.held.lift("", {"verdict": "open"})  # its answer was lost, and it was sent again
    await line.stands.wait()
    await asyncio.sleep(0)
    line.held.lift("", {"verdict": "pass"})
    await job
    assert [reading.said for reading in line.told[-1].readings] == ["open", "pass"]


async def test_a_correction_that_was_begun_again_vouches_for_no_press_before_it(line: Line) -> None:
    """It begins where the first one gave up, near the pad: that says nothing of where the needle was pressed."""
    line.open_nets.add("NB")
    line.misses_um = [(RADIUS_UM + 100.0, 0.0), (RADIUS_UM - 50.0, 0.0), (RADIUS_UM - 50.0, 0.0)]
    line.without(servo=line.world.context.servo.model_copy(update={"max_moves": 1}))
    seen: list[bool] = []

    async def watched(rung: Rung, at: PointUnderTest) -> None:
        await take(rung, at)
        seen.append(at.attempts[0].seen)

    take = rungs.take
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daemon.procedures.probe_point.take", watched)
        await run(line.world, PROCEDURES["probe"], {}, line.begin("B"))
    assert seen
    assert not any(seen)
    assert line.told[-1].error_um is None


async def test_a_proof_that_comes_and_goes_while_the_needle_is_up_lowers_nothing(line: Line) -> None:
    """Wires that touch each other now and then would prove what they are asked to."""
    readings = itertools.cycle([INF, 0.2])
    line.meter.says = lambda: next(readings)
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.CONTACT_BEFORE_DESCENT
    assert line.descents_onto("A") == 0


async def test_a_needle_whose_lift_failed_still_stands(line: Line) -> None:
    """Whatever kept it from going up, nobody may take it for one that is up."""
    stands: list[bool] = []
    lift = PointUnderTest.lift

    async def watched(at: PointUnderTest) -> Any:
        try:
            return await lift(at)
        finally:
            stands.append(at.is_down)

    async def fails(_touch: PadTouch) -> None:
        raise Fault(FaultCode.OUTSIDE_ENVELOPE, "no way up")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PointUnderTest, "lift", watched)
        patch.setattr(PadTouch, "up", fails)
        with pytest.raises(Fault, match="no way up"):
            await run(line.world, PROCEDURES["probe"], {}, line.begin("A"))
    assert stands == [True]
    assert line.told == []


async def test_a_pin_that_was_not_seen_free_is_not_pressed_again(line: Line) -> None:
    """Where it stands in the picture now is no place of a free pin, until it was seen to have come up."""
    line.films["A"] = (99, INF)
    asked: list[bool] = []
    station = line.world.station
    pressing = station.pressing

    def watched(free: FreePin) -> None:
        asked.append(station.needle.free_pin is None)
        pressing(free)

    async def unseen(*_anything: object) -> None:
        pass

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(station, "pressing", watched)
        patch.setattr(station, "seen_at", unseen)
        await run(line.world, PROCEDURES["probe"], {}, line.begin("A"))
    assert len(asked) > 1
    assert all(asked)


@pytest.mark.parametrize("pushed_um", [100.0, 300.0])
async def test_a_needle_on_a_raised_reference_pad_is_down_and_counted(line: Line, pushed_um: float) -> None:
    """A pad that lies higher than the board does not let a pressed needle be taken for one that hovers."""
    config = line.world.context.config
    raised = config.reference.model_copy(update={"z_um": config.gantry.touch_z_um + 490.0})
    touch = config.touch.model_copy(update={"overtravel_um": pushed_um})
    line.without(reference=raised, touch=touch)
    touches: list[None] = []
    needle = line.world.station.needle = Needle(on_touch=lambda: touches.append(None))
    geometry = Geometry(line.world.context.config, line.world.context.board, line.world.calibrations, needle.board)
    line.world.context.geometry = geometry
    needle.adopt(geometry.up_z_um, geometry.surface_z_um)
    needle.reported(line.world.gantry.reported)
    places: list[NeedlePlace] = []
    meter = MeterReadings.ohms_to_return

    async def read(readings: MeterReadings, deadline: Deadline) -> float:
        places.append(needle.place)
        return await meter(readings, deadline)

    job, context = begin({"op": "probe", "id": "j", "test_point": "A"}, line.touching()).job, line.world.context
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MeterReadings, "ohms_to_return", read)
        patch.setattr(job, "fire", lambda _event: None)
        patch.setattr(line, "stands_on", lambda: "coin")
        await check_needle(job, context, MeterReadings(job, context), NeedleHealth())
    assert places == [NeedlePlace.DOWN]
    assert needle.place is NeedlePlace.UP
    assert len(touches) == 1


# --- metal where the needle should hover -----------------------------------------------------------------------------


def _felt_at_once(line: Line, above_um: float = 50.0) -> float:
    """Let a board come up below the needle that hovers; return the height of its surface."""
    here = line.world.gantry.reported
    line.world.gantry.metal_z_um = here.z_um + above_um
    return here.z_um + above_um


@pytest.mark.parametrize("what", ["probe", "run"])
async def test_a_needle_that_a_board_came_up_against_is_lifted_off_before_anything_goes_sideways(
    tmp_path: Path, what: str
) -> None:
    line = Line(tmp_path, {"sense": {"kind": "drive_input"}})
    felt_um, here = _felt_at_once(line), line.world.gantry.reported
    ran = line.begin("B")
    admitted = admit_probing(ran.job, line.world.context, None, tester=False)
    with pytest.raises(Fault) as caught:
        await (run(line.world, PROCEDURES["probe"], {}, ran) if what == "probe" else admitted)
    admitted.close()
    assert caught.value.kind is FaultCode.WRONG_HEIGHT
    (up, _), *more = line.world.gantry.moves
    assert more == []
    assert (up.x_um, up.y_um, up.theta_deg) == (here.x_um, here.y_um, here.theta_deg)
    assert up.z_um >= felt_um + 100.0
    assert line.book.touches == []


@pytest.mark.parametrize("what", ["probe", "reference pad"])
async def test_a_sense_that_stays_closed_high_above_every_board_is_broken_and_lowers_nothing(
    tmp_path: Path, what: str
) -> None:
    line = Line(tmp_path, {"sense": {"kind": "drive_input"}})
    line.world.gantry.inputs = {SENSE_INPUT}
    ran, context = line.begin("B"), line.world.context
    if what == "probe":
        asked: Any = run(line.world, PROCEDURES["probe"], {}, ran)
    else:
        ran.job.fire(Event.ACCEPTED)
        asked = check_needle(ran.job, context, MeterReadings(ran.job, context), context.station.needle.health)
    with pytest.raises(Fault) as caught:
        await asked
    assert caught.value.kind is FaultCode.CONTACT_BEFORE_DESCENT
    assert all(target.z_um > TOUCH_Z_UM + 100.0 for target, _ in line.world.gantry.moves)
    assert line.world.gantry.reported.z_um >= context.gantry.free_z_um


async def test_a_reference_pad_that_is_met_too_early_is_not_pressed(tmp_path: Path) -> None:
    line = Line(tmp_path, {"sense": {"kind": "drive_input"}})
    ran, context = line.begin("B"), line.world.context
    ran.job.fire(Event.ACCEPTED)
    line.world.gantry.metal_z_um = TOUCH_Z_UM + 130.0
    with pytest.raises(Fault) as caught:
        await check_needle(ran.job, context, MeterReadings(ran.job, context), context.station.needle.health)
    assert caught.value.kind is FaultCode.WRONG_HEIGHT
    assert min(target.z_um for target, _ in line.world.gantry.moves) == pytest.approx(TOUCH_Z_UM + 100.0)


async def test_a_needle_whose_wires_a_board_joined_is_lifted_off_before_anything_goes_sideways(line: Line) -> None:
    felt_um = line.world.gantry.reported.z_um + 50.0
    line.meter.says = lambda: 0.2 if line.world.gantry.actual.z_um <= felt_um else INF
    here = line.world.gantry.reported
    with pytest.raises(Fault) as caught:
        await line.probe("B")
    assert caught.value.kind is FaultCode.WRONG_HEIGHT
    assert [(target.x_um, target.y_um) for target, _ in line.world.gantry.moves] == [(here.x_um, here.y_um)]
    assert line.world.gantry.reported.z_um >= felt_um + 100.0


async def test_a_needle_whose_wires_touch_ends_high_above_every_board(line: Line) -> None:
    line.meter.wires_short = True
    with pytest.raises(Fault):
        await line.probe("A")
    assert line.world.gantry.reported.z_um >= line.world.context.gantry.free_z_um


@pytest.mark.parametrize("unseen", [1, 2, 99])
async def test_a_needle_that_one_picture_hides_after_a_press_is_looked_at_again(line: Line, unseen: int) -> None:
    left = [unseen]

    def glint(look: LookResult) -> LookResult:
        lifted = line.presses_on("A") > 0 and not line.is_down and look.red is None
        if not lifted or left[0] <= 0:
            return look
        left[0] -= 1
        return replace(look, tip=NotFound(Reason.NO_NEEDLE, "a glint"))

    line.world.station.always = glint
    if unseen < LOOKS_FOR_FREE:
        assert (await line.probe("A")).verdict is PointVerdict.PASS_FIRST
        assert line.world.station.needle.free_pin is None
        return
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.TIP_NOT_FOUND
    assert line.world.station.needle.free_pin is not None, "nothing goes sideways before it was seen, or homed"
