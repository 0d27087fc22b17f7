"""A net is accused only with proof: by its other points, and by channels that read."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_mark import PointMark
from daemon.domain.point_test import PointTest, PointVerdict
from daemon.platform.clock import utc_now
from daemon.procedures.point_under_test import PointUnderTest
from daemon.procedures.sibling_point import siblings
from daemon.procedures.tare import what_was_read
from daemon.station.needle_health import NeedleHealth
from daemon.station.station import LookResult
from daemon.storage.calibration_records import Seat
from drivers.errors import MeterTimeout, MeterTrouble
from tests.daemon.procedures.fake_probing import (
    CONTACT_OHM,
    INF,
    KELVIN,
    LEAD_OHM,
    RADIUS_UM,
    TOUCH_Z_UM,
    Line,
)
from vision.registration import NotRegistered, Refusal


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


async def test_a_neighbour_that_was_stood_on_proves_nothing(line: Line) -> None:
    """The first press lands on B while A is asked for; that A's net is not there accuses nobody."""
    line.first_press_lands_on_b()
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


async def test_that_the_board_lies_otherwise_two_sides_of_another_point_say_too(line: Line) -> None:
    line.lay_in("SN-1", Seat(verified=True, places=4, agreement=0.9))
    line.open_nets.add("NA")
    over = NotRegistered(Refusal.WRONG_SIDE, "the board lies with its other side up", None)

    def seen(look: LookResult) -> LookResult:
        elsewhere = math.hypot(*line.world.miss_um("A2")) < 2_000.0
        return replace(look, board=replace(look.board, found=over)) if look.board is not None and elsewhere else look

    line.world.station.always = seen
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.WRONG_SIDE
    assert line.descents_onto("A2") == 0
    assert line.world.calibrations.alignment(line.world.context.board) is None, "it is aligned before it goes on"


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
    record = await line.probe_in_run("A", NeedleHealth(), done={"A2": PointVerdict.PASS_FIRST})
    assert (record.verdict, record.elsewhere) == (PointVerdict.CONTACT_NOT_MADE, 0)
    assert line.descents_onto("A2") == 0


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


@pytest.mark.parametrize(("passed", "first"), [(PointVerdict.PASS_FIRST, "B2"), (PointVerdict.OPEN_CONFIRMED, "C")])
async def test_another_point_is_touched_near_to_one_that_passed(
    line: Line, passed: PointVerdict, first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A break lies between what is open and what passed; far from the accused one may be beyond it as well."""
    board = line.world.context.board
    wired = [p.model_copy(update={"net": "NA"}) if p.name in ("B", "B2", "C") else p for p in board.points]
    monkeypatch.setattr(line.world.context, "board", board.model_copy(update={"points": tuple(wired)}))
    at: Any = SimpleNamespace(
        context=line.world.context, test=PointTest(point="A"), point=board.point("A"), done={"A2": passed}
    )
    assert siblings(at)[0].name == first
