"""A harness whose wires touch, or a relay that sticks, passes no broken net and accuses no sound one."""

from __future__ import annotations

from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointVerdict
from daemon.procedures.judging import READINGS
from daemon.procedures.tare import what_was_read
from tests.daemon.procedures.fake_probing import (
    CONTACT_OHM,
    INF,
    KELVIN,
    LEAD_OHM,
    Line,
)


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
