"""A needle that is not known to be up, free or clean is not lowered, and nothing goes sideways."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointVerdict, Rung
from daemon.domain.states import Event
from daemon.procedures.meter_readings import MeterReadings
from daemon.procedures.pad_touch import PadTouch
from daemon.procedures.point_under_test import PointUnderTest
from daemon.procedures.probe_point import admit_probing
from daemon.procedures.reference_pad import check_needle
from daemon.procedures.registry import PROCEDURES
from daemon.station.free_pin import FreePin
from daemon.station.kinematics import Geometry
from daemon.station.needle import Needle, NeedlePlace
from daemon.station.needle_health import NeedleHealth
from daemon.station.station import LOOKS_FOR_FREE, LookResult
from drivers.deadline import Deadline
from tests.daemon.procedures.fake_probing import (
    INF,
    TOUCH_Z_UM,
    Line,
)
from tests.daemon.procedures.fake_station import SENSE_INPUT, begin, run
from vision import NotFound, Reason


async def test_a_needle_that_stays_bad_ends_it_all_and_nobody_is_accused(line: Line) -> None:
    line.debris_ohm, line.brush_helps = 5_000.0, False
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.PROBE_BAD
    assert caught.value.kind.latched
    assert line.told == []
    line.see_rules_kept()


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


async def test_a_tip_that_is_hidden_before_the_way_to_the_reference_pad_is_a_verdict(line: Line) -> None:
    """The head has not begun to move then; a job that ends as one that moves is a defect."""
    hidden = [0]

    def glint(look: LookResult) -> LookResult:
        lifted = line.presses_on("A") > 1 and not line.is_down and look.red is None
        if not lifted or hidden[0] >= LOOKS_FOR_FREE:
            return look
        hidden[0] += 1
        return replace(look, tip=NotFound(Reason.NO_NEEDLE, "a glint"))

    line.world.station.always = glint
    line.films["A"] = (99, INF)
    ladder = line.world.context.config.ladder.model_copy(update={"order": (Rung.LOOK, Rung.REFERENCE)})
    line.without(ladder=ladder)
    record = await line.probe("A")
    assert hidden[0] == LOOKS_FOR_FREE
    assert (record.verdict, record.fault) == (PointVerdict.CONTACT_NOT_MADE, "tip_not_found")
