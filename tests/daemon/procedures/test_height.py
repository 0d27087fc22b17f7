"""Height is respected: no needle touches a board by hovering over it, and an answer says what is not known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.free_needle import STEP_UM
from daemon.procedures.height import NO_FLEX_UM, PUSHED_UM, SUSPECT_UM
from daemon.procedures.registry import PROCEDURES
from tests.daemon.procedures.fake_station import (
    BELOW_PX,
    HOVER_UM,
    SENSE_INPUT,
    WORK_Z_UM,
    Ran,
    World,
    a_board,
    begin,
    run,
)
from vision import NotFound, Reason

SAFE_Z_UM = 12_000.0

GRID = [(f"P{i}{k}", 5_000.0 + 7_000.0 * i, 4_000.0 + 6_500.0 * k) for i in range(4) for k in range(3)]
PLACE = {"op": "place", "test_point": "P11"}
CORRECT = {"op": "correct", "test_point": "P11"}
LOOK = {"op": "look", "test_point": "P11"}
SURFACE = {"op": "calibrate", "what": "surface", "places": 6}


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path, a_board(*GRID), {}).teach().with_map()


def _raised(height_um: float) -> Callable[[float, float], float]:
    return lambda _x, _y: height_um


def _pushed_um(world: World) -> float:
    """Return how far the pin really is pushed in."""
    x_um, y_um = world.tip_um()
    return float(max(0.0, 5_000.0 + world.height_um(float(x_um), float(y_um)) - world.gantry.actual.z_um))


async def _run(world: World, request: dict[str, Any], ran: Ran | None = None) -> Ran:
    return await run(world, PROCEDURES[request["op"]], request, ran)


async def _fault(world: World, request: dict[str, Any], ran: Ran | None = None) -> Fault:
    with pytest.raises(Fault) as caught:
        await _run(world, request, ran)
    return caught.value


# --- a board whose height nobody measured -------------------------------------------------------------------------


@pytest.mark.parametrize("height_um", [-300.0, 0.0, 300.0, 490.0])
async def test_place_touches_no_board_within_the_range(world: World, height_um: float) -> None:
    world.height_um = _raised(height_um)
    ran = await _run(world, PLACE)
    assert _pushed_um(world) == 0.0
    detail = ran.got.detail
    assert (detail["height"], detail["height_within_um"], detail["confirmed_by"]) == ("unknown", 500.0, "drives")
    assert detail["parallax_um"] > 0.0


async def test_what_an_unknown_height_may_cost_is_the_parallax_of_the_range(world: World) -> None:
    told = (await _run(world, PLACE)).got.detail["parallax_um"]
    aside = world.true_map.from_tip_um(
        np.add(world.calibrations.require_probe().tip_px, world.true_map.below_px(500.0)),
        world.calibrations.require_probe().tip_px, 0.0,
    )  # fmt: skip
    assert told == pytest.approx(float(np.hypot(*aside)), rel=0.02)


async def test_without_a_map_an_answer_cannot_say_what_it_costs(tmp_path: Path) -> None:
    detail = (await _run(World(tmp_path, a_board(*GRID), {}), PLACE)).got.detail
    assert detail["height"] == "unknown"
    assert "parallax_um" not in detail


async def test_a_correction_stays_at_the_free_height_and_says_so(world: World) -> None:
    world.height_um = _raised(300.0)
    await _run(world, PLACE)
    world.put_tip(world.pad_um("P11") - (150.0, 80.0), z_um=5_600.0)
    ran = await _run(world, CORRECT)
    assert _pushed_um(world) == 0.0
    assert min(to.z_um for to, _ in world.gantry.moves) == 5_600.0
    assert ran.got.detail["height"] == "unknown"


async def test_a_look_says_what_is_known_of_the_height(world: World) -> None:
    world.put_beside("P11", (30.0, 0.0))
    assert (await _run(world, LOOK)).got.detail["height"] == "unknown"
    world.with_flat_surface(0.0)
    assert (await _run(world, LOOK)).got.detail["height"] == "measured"


def _lift(world: World) -> None:
    """Begin from the safe height: over a raised surface the needle would be down at nominal working height."""
    at = replace(world.gantry.actual, z_um=SAFE_Z_UM)
    world.gantry.reported = world.gantry.actual = at


# --- a measured surface -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height_um", [-480.0, -80.0, 300.0])
async def test_place_and_correct_follow_the_measured_surface(world: World, height_um: float) -> None:
    world.height_um = _raised(height_um)
    world.put_beside("P00", (0.0, 0.0))
    world.gantry.reported = world.gantry.actual = replace(world.gantry.actual, z_um=5_600.0)
    world.with_flat_surface(height_um)
    _lift(world)
    placed = await _run(world, PLACE)
    assert world.gantry.actual.z_um == pytest.approx(WORK_Z_UM + height_um)
    assert (placed.got.detail["height"], placed.got.detail["height_um"]) == ("measured", height_um)
    here = world.gantry.actual
    world.put_tip(world.pad_um("P11") - (150.0, 80.0), z_um=here.z_um)
    corrected = await _run(world, CORRECT)
    assert world.miss_um("P11") == pytest.approx((0.0, 0.0), abs=1.0)
    assert world.gantry.moves[-1][0].z_um == pytest.approx(WORK_Z_UM + height_um)
    assert corrected.got.detail["height"] == "measured"
    assert world.gantry.slow_z_um[-1] == pytest.approx(5_100.0 + height_um), "no slow stretch above what is known"


async def test_what_is_measured_is_followed_at_once(world: World) -> None:
    world.height_um = _raised(300.0)
    await _run(world, SURFACE)
    await _run(world, PLACE)
    assert world.gantry.actual.z_um == pytest.approx(WORK_Z_UM + 300.0, abs=1.0)
    assert _pushed_um(world) == 0.0


# --- another board than was measured ------------------------------------------------------------------------------


@pytest.mark.parametrize("request_", [PLACE, CORRECT])
async def test_a_pin_that_is_pushed_in_where_it_should_hover_is_a_fault_and_is_lifted(
    world: World, request_: dict[str, Any]
) -> None:
    world.with_flat_surface(0.0)
    world.height_um = _raised(300.0)
    world.put_beside("P11", (40.0, 0.0))
    ran = begin(request_)
    fault = await _fault(world, request_, ran)
    assert fault.kind is FaultCode.WRONG_HEIGHT
    assert fault.detail["pushed_um"] == pytest.approx(100.0, abs=1.0)
    assert "`calibrate surface`" in fault.advice
    assert _pushed_um(world) == 0.0
    assert not FaultCode.WRONG_HEIGHT.latched


async def test_a_look_that_moves_nothing_names_a_pushed_pin_too(world: World) -> None:
    world.height_um = _raised(200.0 + PUSHED_UM + 5.0)
    world.put_beside("P11", (40.0, 0.0))
    for request in (LOOK, {"op": "look"}):
        assert (await _fault(world, request)).kind is FaultCode.WRONG_HEIGHT
    assert world.gantry.moves == []


@pytest.mark.parametrize(("up_um", "lifted"), [(SUSPECT_UM - 1.0, False), (SUSPECT_UM + 1.0, True)])
async def test_a_flex_that_looks_like_a_push_is_looked_at_from_above_and_costs_nothing_else(
    world: World, up_um: float, lifted: bool
) -> None:
    """The tip stands higher at this stop, pressed or not: it is the mount."""
    world.with_flat_surface(0.0)
    flex = tuple(-up_um / HOVER_UM * np.array(BELOW_PX))
    world.flex_px = lambda: flex
    world.put_beside("P11", (4.0, 0.0))
    ran = await _run(world, CORRECT)
    assert ran.got.outcome == "already_on_target", "a lift corrects nothing"
    assert ran.got.error_after_um == pytest.approx(4.0, abs=0.1)
    assert [to.z_um for to, _ in world.gantry.moves] == ([5_700.0, WORK_Z_UM] if lifted else [])
    assert ran.events[0] is Event.ACCEPTED


async def test_a_tip_that_stands_too_high_lifted_or_not_was_taught_elsewhere_or_z_is_stuck(world: World) -> None:
    world.with_flat_surface(0.0)
    flex = tuple(-(NO_FLEX_UM + 5.0) / HOVER_UM * np.array(BELOW_PX))
    world.flex_px = lambda: flex
    world.put_beside("P11", (4.0, 0.0))
    fault = await _fault(world, CORRECT)
    assert fault.kind is FaultCode.WRONG_HEIGHT
    assert "lifted or not" in fault.message


async def test_above_any_possible_board_a_flex_is_a_flex(world: World) -> None:
    flex = tuple(-(NO_FLEX_UM + 5.0) / HOVER_UM * np.array(BELOW_PX))
    world.flex_px = lambda: flex
    world.put_tip(world.pad_um("P11") - (4.0, 0.0), z_um=5_600.0)
    assert (await _run(world, CORRECT)).got.outcome == "already_on_target"


async def test_a_tip_that_is_lost_when_a_suspect_is_lifted_is_said(world: World) -> None:
    world.with_flat_surface(0.0)
    world.height_um = _raised(300.0)
    world.put_beside("P11", (40.0, 0.0))
    world.station.script[2] = lambda seen: replace(seen, tip=NotFound(Reason.TOO_DARK, "dark"))
    assert (await _fault(world, CORRECT)).kind is FaultCode.TIP_NOT_FOUND
    assert _pushed_um(world) == 0.0


async def test_the_first_way_down_over_a_measured_surface_is_slow_and_the_next_ones_are_not(world: World) -> None:
    """Nobody tells when another board was put in: it would be met at full speed."""
    world.with_flat_surface(0.0)
    for slow_um in (5_500.0, 5_100.0, 5_100.0):
        _lift(world)
        await _run(world, PLACE)
        assert world.gantry.slow_z_um[-1] == pytest.approx(slow_um)
    world.station.needle.forget()
    world.station.needle.reported(world.gantry.actual)
    await _run(world, PLACE)
    assert world.gantry.slow_z_um[-1] == 5_500.0, "after a doubt it begins anew"


async def test_another_board_than_was_measured_is_met_slowly(world: World) -> None:
    world.with_flat_surface(0.0)
    world.height_um = _raised(300.0)
    _lift(world)
    fault = await _fault(world, PLACE)
    assert fault.kind is FaultCode.WRONG_HEIGHT
    assert set(world.gantry.slow_z_um) == {5_500.0}


async def test_a_board_that_was_trusted_and_is_touched_is_trusted_no_more(world: World) -> None:
    world.with_flat_surface(0.0)
    _lift(world)
    await _run(world, PLACE)
    assert world.station.needle.board.holds
    world.height_um = _raised(300.0)
    _lift(world)
    await _fault(world, PLACE)
    assert not world.station.needle.board.holds


@pytest.mark.parametrize("measured", [False, True])
async def test_every_place_looks_once_at_the_pin(world: World, measured: bool) -> None:
    if measured:
        world.with_flat_surface(0.0)
    assert (await _run(world, PLACE)).job.looks == 1


async def test_a_look_that_confirmed_the_place_has_seen_the_pin_too(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def confirmed(job: Any, context: Any, position: Any, _point: Any) -> dict[str, Any]:
        job.saw(await context.station.look_white(position, context.calibrations.require_probe(), None, job))
        return {"confirmed_by": "picture"}

    monkeypatch.setattr("daemon.procedures.basic.confirm_place", confirmed)
    assert (await _run(world, PLACE)).job.looks == 1


# --- a Z that lost steps without its drive telling ----------------------------------------------------------------


@pytest.mark.parametrize("lost_um", [700.0, 1_500.0, 3_000.0])
async def test_a_place_where_no_board_can_be_sees_a_z_that_stands_lower_than_it_counts(
    world: World, lost_um: float
) -> None:
    """No drive tells, and nothing else would before the next press: the needle must not rest on the board."""
    _lift(world)
    world.gantry.lost_z_um = lost_um
    fault = await _fault(world, PLACE)
    assert fault.kind is FaultCode.AXIS_STALLED
    assert fault.detail["axis"] == "z"
    assert _pushed_um(world) == 0.0
    placed, lifted = (to for to, _ in world.gantry.moves)
    assert lifted == replace(placed, z_um=SAFE_Z_UM)


async def test_a_pin_that_stands_so_deep_that_no_tip_is_seen_is_let_down_gently_from_above_and_seen_pushed(
    world: World,
) -> None:
    """A crash is no picture of a needle; a free tip that the ground hides is told from it by its way down."""
    _lift(world)
    world.gantry.lost_z_um = 4_700.0
    world.deepest_seen_um = 1_000.0
    fault = await _fault(world, PLACE)
    assert fault.kind is FaultCode.AXIS_STALLED
    assert _pushed_um(world) == 0.0
    met_um = [to.z_um - 4_700.0 - 5_000.0 for to, _ in world.gantry.moves[2:]]
    assert min(met_um) > -STEP_UM, "the second time it meets the board gently"


@pytest.mark.parametrize("hidden_to_um", [5_700.0, 7_000.0, 20_000.0])
async def test_a_tip_that_the_ground_hides_is_raised_to_where_it_is_seen_and_that_is_no_fault(
    world: World, hidden_to_um: float
) -> None:
    _lift(world)
    world.hidden_below_um = hidden_to_um
    ran = await _run(world, PLACE)
    assert ran.got.outcome == "placed"
    at_um = world.gantry.actual.z_um
    assert at_um == SAFE_Z_UM if hidden_to_um > SAFE_Z_UM else hidden_to_um <= at_um < hidden_to_um + STEP_UM
    assert ran.got.detail["position"]["z_um"] == at_um


async def test_a_correction_that_must_let_the_needle_down_sees_that_it_is_free(world: World) -> None:
    world.put_tip(world.pad_um("P11") - (30.0, 0.0), z_um=SAFE_Z_UM)
    world.gantry.lost_z_um = 4_700.0
    world.deepest_seen_um = 1_000.0
    assert (await _fault(world, CORRECT)).kind is FaultCode.AXIS_STALLED
    assert _pushed_um(world) == 0.0


async def test_a_z_that_is_stuck_where_no_board_can_be_leaves_a_reference_in_doubt(world: World) -> None:
    _lift(world)
    world.gantry.sticks_at_um = 4_500.0
    assert (await _fault(world, PLACE)).kind is FaultCode.AXIS_STALLED


async def test_a_look_where_no_board_can_be_says_that_z_may_stand_lower(world: World) -> None:
    world.put_tip(world.pad_um("P11") - (30.0, 0.0), z_um=5_600.0)
    world.gantry.actual = replace(world.gantry.actual, z_um=4_500.0)
    fault = await _fault(world, LOOK)
    assert fault.kind is FaultCode.AXIS_STALLED
    assert world.gantry.moves == []


# --- calibrations -------------------------------------------------------------------------------------------------


async def test_a_map_is_not_walked_over_a_board_that_is_touched_at_working_height(world: World) -> None:
    world.height_um = _raised(300.0)
    fault = await _fault(world, {"op": "calibrate", "what": "map", "test_point": "P11"})
    assert fault.kind is FaultCode.WRONG_HEIGHT
    assert "gantry.touch_z_um" in fault.advice
    assert [to.z_um for to, _ in world.gantry.moves] == [5_600.0, WORK_Z_UM, 5_600.0]
    assert world.gantry.slow_z_um[1] == 5_500.0


@pytest.mark.parametrize("height_um", [-400.0, 150.0])
async def test_a_map_is_walked_where_the_needle_hovers(world: World, height_um: float) -> None:
    world.height_um = _raised(height_um)
    await _run(world, {"op": "calibrate", "what": "map", "test_point": "P11"})
    assert _pushed_um(world) == 0.0


async def test_a_map_over_a_measured_surface_is_walked_at_the_same_distance_from_it(world: World) -> None:
    world.height_um = _raised(300.0)
    world.gantry.reported = world.gantry.actual = replace(world.gantry.actual, z_um=5_600.0)
    world.with_flat_surface(300.0)
    _lift(world)
    await _run(world, {"op": "calibrate", "what": "map", "test_point": "P11"})
    assert world.gantry.moves[0][0].z_um == WORK_Z_UM + 300.0
    assert world.context.require_map().below_tip_px == pytest.approx(BELOW_PX, abs=0.02)


@pytest.mark.parametrize("height_um", [-300.0, 300.0])
async def test_an_alignment_touches_no_board_whatever_was_measured_before(world: World, height_um: float) -> None:
    world.with_flat_surface(0.0)
    world.height_um = _raised(height_um)
    names = ["P00", "P02", "P30", "P32"]
    await _run(world, {"op": "align", "fiducials": names})
    assert {to.z_um for to, _ in world.gantry.moves} == {5_600.0}
    assert world.geometry.measured_um((80_000.0, 55_000.0)) is None, "another board may have been laid in"


async def test_once_the_needle_hovered_free_over_its_mark_the_walk_is_not_slow(world: World) -> None:
    await _run(world, {"op": "calibrate", "what": "map", "test_point": "P11"})
    _first, down, *walk = world.gantry.slow_z_um
    assert down == 5_500.0
    assert set(walk) == {WORK_Z_UM}


@pytest.mark.parametrize("look", [1, 3])
async def test_a_map_that_sees_no_tip_is_refused_as_ever_and_the_needle_left_free(world: World, look: int) -> None:
    world.station.script[look] = lambda seen: replace(seen, tip=NotFound(Reason.NO_NEEDLE, "none"))
    fault = await _fault(world, {"op": "calibrate", "what": "map", "test_point": "P11"})
    assert fault.kind is FaultCode.TEST_POINT_NOT_FOUND
    assert world.gantry.actual.z_um == 5_600.0


# --- what one look cannot tell ------------------------------------------------------------------------------------

HIDDEN_UM = 30.0


def _with_sense(folder: Path) -> World:
    world = World(folder, a_board(*GRID), {"sense": {"kind": "drive_input"}}).teach().with_map()
    world.with_flat_surface(0.0)
    world.put_beside("P11", (1.0, 0.0))
    return world


@pytest.mark.parametrize("request_", [PLACE, CORRECT])
async def test_a_push_that_flex_may_hide_is_felt_by_a_touch_sense_where_no_board_is_known(
    tmp_path: Path, request_: dict[str, Any]
) -> None:
    """A tip that looks free is no proof of it: the stops differ by more than the push."""
    world = _with_sense(tmp_path)
    world.height_um, world.gantry.metal_z_um = _raised(HOVER_UM + HIDDEN_UM), WORK_Z_UM + HIDDEN_UM
    assert (await _fault(world, request_)).kind is FaultCode.WRONG_HEIGHT
    assert world.gantry.actual.z_um == SAFE_Z_UM
    assert not world.station.needle.board.holds


async def test_a_sense_that_is_closed_for_good_says_nothing_of_a_board_and_the_head_comes_back(tmp_path: Path) -> None:
    world = _with_sense(tmp_path)
    world.gantry.inputs = {SENSE_INPUT}
    await _run(world, CORRECT)
    assert [move.z_um for move, _ in world.gantry.moves] == [SAFE_Z_UM, WORK_Z_UM]


async def test_a_sense_is_not_asked_again_while_the_board_is_known(tmp_path: Path) -> None:
    world = _with_sense(tmp_path)
    await _run(world, CORRECT)
    world.gantry.inputs = {SENSE_INPUT}
    await _run(world, CORRECT)
    assert world.gantry.moves == []


async def test_a_place_that_is_refused_for_what_lies_there_leaves_no_needle_pressed(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should look whether the pin is free also where the picture shows another board: that one may be higher."""
    world.with_flat_surface(0.0)
    world.height_um = _raised(300.0)
    _lift(world)

    async def another(*_anything: object) -> dict[str, Any]:
        raise Fault(FaultCode.NOT_THIS_BOARD, "another board lies there")

    monkeypatch.setattr("daemon.procedures.basic.confirm_place", another)
    assert (await _fault(world, PLACE)).kind is FaultCode.WRONG_HEIGHT
    assert _pushed_um(world) == 0.0


@pytest.mark.parametrize(("blind", "seen"), [(1, True), (3, False)])
async def test_a_place_where_the_tip_is_not_seen_at_once_is_looked_at_again_and_left_where_no_board_can_be(
    world: World, blind: int, seen: bool
) -> None:
    """What was not seen free is not free: the needle is raised to where it is for certain."""
    world.with_flat_surface(0.0)
    _lift(world)
    for number in range(1, blind + 1):
        world.station.script[number] = lambda look: replace(look, tip=NotFound(Reason.TOO_DARK, "a glint"))
    ran = await _run(world, PLACE)
    assert ran.got.outcome == "placed"
    free_um = world.config.gantry.free_z_um
    assert world.gantry.actual.z_um == pytest.approx(WORK_Z_UM if seen else free_um)
    assert ran.got.detail["position"]["z_um"] == pytest.approx(world.gantry.reported.z_um)
    assert world.station.needle.board.holds is seen
