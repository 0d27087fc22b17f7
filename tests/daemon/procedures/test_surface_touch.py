"""A surface is found from above wherever it lies, slowly, and the lift after each touch is seen, not only counted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures import surface_touch
from daemon.procedures.move_sequence import MoveSequence, shifted
from daemon.procedures.surface_touch import (
    CARD_PLACES_UM,
    LEAST_PUSH_UM,
    LIKELY,
    LOOKS,
    Push,
    SurfaceSearch,
    card_height_um,
    heights_um,
    tip_px,
)
from daemon.station.free_pin import FreePin
from daemon.station.needle import Needle
from drivers.errors import Stalled
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import World, a_board, begin
from tests.daemon.procedures.fake_station import pose_map as exact_map
from tests.daemon.tools.report.synthetic import map_record
from vision import NotFound, Reason
from vision.geometry.pose_map import PoseMap

PRESS_UM, TOUCH_Z_UM = 200.0, 5000.0
PLACE = Position(1000.0, 2000.0, 4800.0, 0.0)


@pytest.fixture(scope="module")
def pose_map() -> PoseMap:
    return PoseMap.from_json(json.dumps(map_record().pose_map))


def _push(pose_map: PoseMap, height_um: float, scale: float) -> Push:
    """Return what the camera sees of a surface so high, TEDA seeing `scale` times the push."""
    px_per_um = -np.array(pose_map.below_tip_px) / pose_map.hover_um * scale
    return Push(PLACE, (height_um + PRESS_UM / 2) * px_per_um, (height_um + PRESS_UM) * px_per_um)


@pytest.mark.parametrize("scale", [0.9, 1.0, 1.09, 1.3])
def test_heights_come_out_whatever_a_push_looks_like(pose_map: PoseMap, scale: float) -> None:
    true_um = [-60.0, 0.0, 45.0]
    found = heights_um([_push(pose_map, h, scale) for h in true_um], pose_map, PRESS_UM, TOUCH_Z_UM)
    assert found == pytest.approx(true_um, abs=0.01)


def test_each_touch_counts_from_where_z_stood(pose_map: PoseMap) -> None:
    pushes = [_push(pose_map, 0.0, 1.0), replace(_push(pose_map, 0.0, 1.0), place=shifted(PLACE, dz_um=310.0))]
    assert heights_um(pushes, pose_map, PRESS_UM, TOUCH_Z_UM) == pytest.approx([0.0, 310.0], abs=0.01)


@pytest.mark.parametrize(("scale", "good"), [(0.69, False), (0.71, True), (1.49, True), (1.51, False)])
def test_a_pin_that_sticks_or_tips_is_refused(pose_map: PoseMap, scale: float, good: bool) -> None:
    push = _push(pose_map, 0.0, scale)
    if good:
        assert heights_um([push], pose_map, PRESS_UM, TOUCH_Z_UM) == pytest.approx([0.0], abs=0.01)
        return
    with pytest.raises(Fault, match=rf"moved {scale:.2f} times as far"):
        heights_um([push], pose_map, PRESS_UM, TOUCH_Z_UM)


@pytest.mark.parametrize("end", [0, 1])
def test_the_likely_scales_include_their_ends(pose_map: PoseMap, monkeypatch: pytest.MonkeyPatch, end: int) -> None:
    push = _push(pose_map, 0.0, LIKELY[end])
    half, full = (pose_map.height_from_shift_um(px) for px in (push.half_px, push.full_px))
    exact = float((np.array([full]) - np.array([half])).mean()) / (PRESS_UM / 2)
    ends = (exact, LIKELY[1]) if end == 0 else (LIKELY[0], exact)
    monkeypatch.setattr(surface_touch, "LIKELY", ends)
    assert heights_um([push], pose_map, PRESS_UM, TOUCH_Z_UM) == pytest.approx([0.0], abs=0.01)


# --- one touch ----------------------------------------------------------------------------------------------------


@pytest.fixture
def world(tmp_path: Path) -> World:
    made = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {}).teach().with_map()
    made.put_beside("A", (0.0, 0.0))
    return made


def _sequence(world: World) -> MoveSequence:
    ran = begin({"op": "home"})
    ran.job.fire(Event.ACCEPTED)
    return MoveSequence(ran.job, world.context)


async def _press(world: World, sequence: MoveSequence | None = None, place: Position | None = None) -> Push:
    sequence = sequence or _sequence(world)
    try:
        return await SurfaceSearch(sequence, exact_map()).press(place or world.gantry.reported)
    finally:
        await sequence.job.settle()


def _depths(world: World) -> list[float]:
    return [to.z_um for to, _ in world.gantry.moves]


@pytest.mark.parametrize("height_um", [-499.0, -300.0, -80.0, 0.0, 30.0, 203.0, 300.0, 499.0])
async def test_a_surface_is_found_wherever_it_lies_within_the_range(world: World, height_um: float) -> None:
    world.height_um = lambda _x, _y: height_um
    push = await _press(world)
    assert heights_um([push], exact_map(), PRESS_UM, TOUCH_Z_UM) == pytest.approx([height_um], abs=0.01)
    deepest_um = 5_000.0 + height_um - min(_depths(world))
    assert PRESS_UM / 2 <= deepest_um <= PRESS_UM, "the pin is never pushed further than allowed"


async def test_a_touch_begins_free_goes_straight_down_slowly_and_ends_free(world: World) -> None:
    world.height_um = lambda _x, _y: 300.0
    place = world.gantry.reported
    await _press(world)
    depths = _depths(world)
    assert depths[0] == depths[-1] == 5_600.0
    assert depths[:-1] == sorted(set(depths), reverse=True)
    assert {(to.x_um, to.y_um) for to, _ in world.gantry.moves} == {(place.x_um, place.y_um)}
    assert set(world.gantry.slow_z_um[1:-1]) == {5_500.0}, "slowly wherever a surface may be"


async def test_the_next_place_is_searched_from_just_above_the_last_surface(world: World) -> None:
    sequence, place = _sequence(world), world.gantry.reported
    search = SurfaceSearch(sequence, exact_map())
    await search.press(place)
    first = len(world.gantry.moves)
    await search.press(shifted(place, dx_um=3_000.0))
    await sequence.job.settle()
    assert len(world.gantry.moves) - first == 6
    assert _depths(world)[first + 1] == pytest.approx(5_000.0 + surface_touch.NEXT_UM)


async def test_a_next_place_that_lies_much_higher_is_searched_from_the_top(world: World) -> None:
    sequence, place = _sequence(world), world.gantry.reported
    middle_x = float(world.tip_um()[0])
    world.height_um = lambda x, _y: 0.0 if abs(x - middle_x) < 1.0 else 380.0
    search = SurfaceSearch(sequence, exact_map())
    pushes = [await search.press(place), await search.press(shifted(place, dx_um=3_000.0))]
    await sequence.job.settle()
    assert heights_um(pushes, exact_map(), PRESS_UM, TOUCH_Z_UM) == pytest.approx([0.0, 380.0], abs=0.01)


async def test_where_no_surface_lies_within_the_range_the_place_is_told(world: World) -> None:
    world.height_um = lambda _x, _y: -701.0
    place = world.gantry.reported
    with pytest.raises(Fault, match=rf"no surface at X {place.x_um / 1e3:.2f} mm") as caught:
        await _press(world)
    assert caught.value.kind is FaultCode.CALIBRATION_FAILED
    assert min(_depths(world)) >= 4_300.0
    assert _depths(world)[-1] == world.context.gantry.safe_z_um


@pytest.mark.parametrize("height_um", [600.0, 650.0, 700.0])
async def test_a_surface_over_which_the_pin_was_never_free_gives_no_number(world: World, height_um: float) -> None:
    world.height_um = lambda _x, _y: height_um
    with pytest.raises(Fault, match="the pin was never free") as caught:
        await _press(world)
    assert caught.value.kind is FaultCode.CALIBRATION_FAILED
    assert min(_depths(world)) > 5_000.0 + height_um - 300.0, "within the overtravel"
    assert _depths(world)[-1] == world.config.gantry.safe_z_um, "where it was to be free it is not"


async def test_a_shift_that_noise_makes_up_is_no_touch(world: World) -> None:
    """One look of a free pin is off by more than the least push; lower down it is not."""
    off_px = 1.5 * LEAST_PUSH_UM / 200.0 * np.array((4.0, 7.5))
    world.station.script |= dict.fromkeys((5, 6), lambda seen: replace(seen, tip=_shifted_tip(seen.tip, -off_px)))
    push = await _press(world)
    assert heights_um([push], exact_map(), PRESS_UM, TOUCH_Z_UM) == pytest.approx([0.0], abs=0.01)


async def test_a_pin_that_does_not_follow_z_ends_the_search(world: World) -> None:
    world.push_scale = 0.3
    with pytest.raises(Fault, match=r"moved 0\.\d\d times as far"):
        await _press(world)
    assert min(_depths(world)) > 5_000.0 - 2 * PRESS_UM


def _shifted_tip(tip: Any, by_px: Any) -> Any:
    return replace(tip, x_px=tip.x_px + float(by_px[0]), y_px=tip.y_px + float(by_px[1]))


async def test_each_depth_is_the_mean_of_its_looks(world: World) -> None:
    world.station.script[1] = lambda seen: replace(seen, tip=_shifted_tip(seen.tip, np.array((0.2, 0.1))))
    world.station.script[2] = lambda seen: replace(seen, tip=_shifted_tip(seen.tip, np.array((-0.2, -0.1))))
    push = await _press(world)
    assert heights_um([push], exact_map(), PRESS_UM, TOUCH_Z_UM) == pytest.approx([0.0], abs=0.01)


async def test_nothing_is_left_standing_on_a_board_if_the_tip_is_lost(world: World) -> None:
    world.height_um = lambda _x, _y: 450.0
    world.station.script[5] = lambda seen: replace(seen, tip=NotFound(Reason.NO_NEEDLE, "none"))
    with pytest.raises(Fault) as caught:
        await _press(world)
    assert caught.value.kind is FaultCode.TIP_NOT_FOUND
    assert _depths(world)[-1] == world.context.gantry.safe_z_um


async def test_after_a_failed_move_nothing_moves_by_itself(world: World) -> None:
    world.gantry.failures[2] = Stalled("blocked", device="z")
    with pytest.raises(Stalled):
        await _press(world)
    assert len(world.gantry.moves) == 2


async def test_a_tip_lost_before_the_touch_presses_nothing(world: World) -> None:
    world.station.script[1] = lambda seen: replace(seen, tip=NotFound(Reason.TOO_DARK, "dark"))
    with pytest.raises(Fault):
        await _press(world)
    assert len(world.gantry.moves) == 1


@pytest.mark.parametrize(("press_um", "good"), [(59.9, False), (60.0, True)])
async def test_too_little_press_measures_nothing(tmp_path: Path, press_um: float, good: bool) -> None:
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {"gantry": {"press_um": press_um}}).teach().with_map()
    world.put_beside("A", (0.0, 0.0))
    if good:
        push = await _press(world)
        assert heights_um([push], exact_map(), press_um, TOUCH_Z_UM) == pytest.approx([0.0], abs=0.01)
        return
    with pytest.raises(Fault, match="no push can be measured"):
        await _press(world)
    assert world.gantry.moves == []


# --- the lift -----------------------------------------------------------------------------------------------------


async def _stuck(world: World, at_um: float) -> Fault:
    """Press while Z loses its steps on the way up."""
    going = world.gantry.move_to

    async def move_to(target: Position, *args: Any, **kinds: Any) -> Position:
        if min(_depths(world), default=9e9) < 5_000.0 - 50.0 and target.z_um > 5_000.0:
            world.gantry.sticks_at_um = at_um
        return await going(target, *args, **kinds)

    world.gantry.move_to = move_to  # type: ignore[method-assign]
    with pytest.raises(Fault) as caught:
        await _press(world)
    return caught.value


async def test_a_z_that_lost_its_steps_pressed_is_seen_and_nothing_moves_sideways(world: World) -> None:
    place = world.gantry.reported
    fault = await _stuck(world, 4_950.0)
    assert fault.kind is FaultCode.AXIS_STALLED
    assert "Z did not lift the needle" in fault.message
    assert {(to.x_um, to.y_um) for to, _ in world.gantry.moves} == {(place.x_um, place.y_um)}
    with pytest.raises(Fault, match="Z did not lift"):
        await world.station.go(shifted(place, dx_um=5_000.0), begin({"op": "home"}).job)
    assert {(to.x_um, to.y_um) for to, _ in world.gantry.moves} == {(place.x_um, place.y_um)}


async def test_after_a_touch_that_was_cut_short_the_lift_is_seen_before_the_next_move_sideways(world: World) -> None:
    place = world.gantry.reported
    world.gantry.failures[9] = Stalled("blocked", device="z")
    with pytest.raises(Stalled):
        await _press(world)
    looks, job = len(world.station.searches), begin({"op": "home"}).job
    await world.station.retract(job.deadline)  # as every end of a job does
    assert len(world.station.searches) == looks
    await world.station.go(shifted(place, dx_um=5_000.0), job)
    assert len(world.station.searches) == looks + 1
    await world.station.go(place, job)
    assert len(world.station.searches) == looks + 1, "once seen it is known"


async def test_a_lift_that_cannot_be_seen_keeps_the_head_where_it_is_until_homing(world: World) -> None:
    place = world.gantry.reported
    world.gantry.failures[9] = Stalled("blocked", device="z")
    with pytest.raises(Stalled):
        await _press(world)
    world.station.always = lambda seen: replace(seen, tip=NotFound(Reason.TOO_DARK, "dark"))
    job = begin({"op": "home"}).job
    await world.station.retract(job.deadline)
    with pytest.raises(Fault) as caught:
        await world.station.go(shifted(place, dx_um=5_000.0), job)
    assert caught.value.kind is FaultCode.TIP_NOT_FOUND
    assert "`home`" in caught.value.advice
    await world.station.home(job)
    await world.station.go(shifted(place, dx_um=5_000.0), job)


# --- the print's paper --------------------------------------------------------------------------------------------


async def test_the_papers_height_is_the_middle_one_of_three_touches_beside_the_lines(world: World) -> None:
    over = world.gantry.reported
    heights = {round(dx): h for (dx, _), h in zip(CARD_PLACES_UM, (55.0, 20.0, -10.0), strict=True)}
    middle_x = float(world.tip_um()[0])
    world.height_um = lambda x, _y: heights[min(heights, key=lambda dx: abs(x - middle_x - dx))]
    sequence = _sequence(world)
    assert await card_height_um(sequence, exact_map(), over) == pytest.approx(20.0, abs=0.01)
    await sequence.job.settle()
    seen = dict.fromkeys((to.x_um - over.x_um, to.y_um - over.y_um) for to, _ in world.gantry.moves)
    assert list(seen) == [pytest.approx(place) for place in CARD_PLACES_UM]


@pytest.mark.parametrize(("press_um", "touched"), [(0.0, False), (100.0, True)])
async def test_where_nothing_may_be_pressed_the_paper_counts_as_flat(
    tmp_path: Path, press_um: float, touched: bool
) -> None:
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {"gantry": {"press_um": press_um}}).teach().with_map()
    world.put_beside("A", (0.0, 0.0))
    sequence = _sequence(world)
    assert await card_height_um(sequence, exact_map(), world.gantry.reported) == pytest.approx(0.0, abs=0.01)
    await sequence.job.settle()
    assert bool(world.gantry.moves) is touched


@pytest.mark.parametrize("height_um", [-300.0, 0.0, 300.0])
async def test_each_touched_place_is_counted_once_wherever_the_surface_lies(world: World, height_um: float) -> None:
    touches: list[None] = []
    world.station.needle = Needle(on_touch=lambda: touches.append(None))
    world.station.needle.adopt(world.geometry.up_z_um, world.geometry.surface_z_um)
    world.height_um = lambda _x, _y: height_um
    sequence, place = _sequence(world), replace(world.gantry.reported, z_um=5_600.0)
    world.gantry.reported = world.gantry.actual = place
    world.station.needle.reported(place)
    search = SurfaceSearch(sequence, exact_map())
    for n in range(3):
        await search.press(shifted(place, dx_um=3_000.0 * n))
    await sequence.job.settle()
    assert len(touches) == 3


@pytest.mark.parametrize("carried", [set(), {1}, {2}, {1, 2}])
async def test_a_lift_is_judged_by_how_well_the_free_tip_was_known(world: World, carried: set[int]) -> None:
    """One of its looks by the marking alone is enough to know it less well."""
    sequence, kept = _sequence(world), list[FreePin]()
    world.station.script = {
        n: lambda look: replace(look, tip=replace(look.tip, by_marking=True))  # type: ignore[type-var]
        for n in carried
    }
    pressing = world.station.pressing
    world.station.pressing = lambda free: (kept.append(free), pressing(free))[1]  # type: ignore[method-assign]
    await _press(world, sequence)
    assert kept[0].by_marking is bool(carried)


@pytest.mark.parametrize("measured", [True, False])
async def test_the_tip_is_measured_where_a_calibration_asks_for_it(world: World, measured: bool) -> None:
    sequence = _sequence(world)
    await tip_px(sequence, world.gantry.actual, measured=measured)
    assert world.station.measured == [measured] * LOOKS
