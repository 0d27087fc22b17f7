"""How high a surface lies follows from how far the pin was pushed, whatever the image's scale of a push is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures import surface_touch
from daemon.procedures.move_sequence import MoveSequence
from daemon.procedures.surface_touch import CARD_PLACES_UM, LIKELY, Push, card_height_um, heights_um, press
from drivers.errors import Stalled
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import BELOW_PX, World, a_board, begin
from tests.daemon.procedures.fake_station import pose_map as exact_map
from tests.daemon.tools.report.synthetic import map_record
from vision import NotFound, Reason
from vision.geometry.pose_map import PoseMap

PRESS_UM = 200.0
PLACE = Position(1000.0, 2000.0, 5200.0, 0.0)


@pytest.fixture(scope="module")
def pose_map() -> PoseMap:
    return PoseMap.from_json(json.dumps(map_record().pose_map))


def _push(pose_map: PoseMap, height_um: float, scale: float, half_free: bool = False) -> Push:
    """Return what the camera sees of a surface so high, TEDA seeing `scale` times the push."""
    px_per_um = -np.array(pose_map.below_tip_px) / pose_map.hover_um * scale
    half_um = 0.0 if half_free else height_um + PRESS_UM / 2
    return Push(PLACE, half_um * px_per_um, (height_um + PRESS_UM) * px_per_um)


@pytest.mark.parametrize("scale", [0.9, 1.0, 1.09, 1.3])
def test_heights_come_out_whatever_a_push_looks_like(pose_map: PoseMap, scale: float) -> None:
    true_um = [-60.0, 0.0, 45.0]
    found = heights_um([_push(pose_map, h, scale) for h in true_um], pose_map, PRESS_UM)
    assert found == pytest.approx(true_um, abs=0.01)


def test_a_touch_that_met_nothing_is_refused_with_its_place(pose_map: PoseMap) -> None:
    pushes = [_push(pose_map, 0.0, 1.0), _push(pose_map, -150.0, 1.0, half_free=True)]
    with pytest.raises(Fault, match=r"no surface at X 1\.00 mm, Y 2\.00 mm") as caught:
        heights_um(pushes, pose_map, PRESS_UM)
    assert caught.value.kind is FaultCode.CALIBRATION_FAILED
    assert caught.value.detail["pushed_um"] == 0.0


def test_the_least_push_is_15_um_and_no_less(pose_map: PoseMap, monkeypatch: pytest.MonkeyPatch) -> None:
    assert surface_touch.LEAST_PUSH_UM == 15.0
    just = _push(pose_map, -84.9, 1.0)
    assert heights_um([just], pose_map, PRESS_UM) == pytest.approx([-84.9], abs=0.01)
    with pytest.raises(Fault, match="met no surface"):
        heights_um([_push(pose_map, -85.1, 1.0)], pose_map, PRESS_UM)
    monkeypatch.setattr(surface_touch, "LEAST_PUSH_UM", pose_map.height_from_shift_um(just.half_px))
    heights_um([just], pose_map, PRESS_UM)


@pytest.mark.parametrize(("scale", "good"), [(0.69, False), (0.71, True), (1.49, True), (1.51, False)])
def test_a_pin_that_sticks_or_tips_is_refused(pose_map: PoseMap, scale: float, good: bool) -> None:
    push = _push(pose_map, 0.0, scale)
    if good:
        assert heights_um([push], pose_map, PRESS_UM) == pytest.approx([0.0], abs=0.01)
        return
    with pytest.raises(Fault, match=rf"moved {scale:.2f} times as far"):
        heights_um([push], pose_map, PRESS_UM)


@pytest.mark.parametrize("end", [0, 1])
def test_the_likely_scales_include_their_ends(pose_map: PoseMap, monkeypatch: pytest.MonkeyPatch, end: int) -> None:
    push = _push(pose_map, 0.0, LIKELY[end])
    half, full = (pose_map.height_from_shift_um(px) for px in (push.half_px, push.full_px))
    exact = float((np.array([full]) - np.array([half])).mean()) / (PRESS_UM / 2)
    ends = (exact, LIKELY[1]) if end == 0 else (LIKELY[0], exact)
    monkeypatch.setattr(surface_touch, "LIKELY", ends)
    assert heights_um([push], pose_map, PRESS_UM) == pytest.approx([0.0], abs=0.01)


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


async def test_a_touch_goes_down_by_halves_and_comes_back_up(world: World) -> None:
    world.height_um = lambda _x, _y: 30.0
    sequence, place = _sequence(world), world.gantry.reported
    push = await press(sequence, place)
    await sequence.job.settle()
    assert [to.z_um for to, _ in world.gantry.moves] == [5_200.0, 4_900.0, 4_800.0, 5_200.0]
    assert {(to.x_um, to.y_um) for to, _ in world.gantry.moves} == {(place.x_um, place.y_um)}
    assert push.place == place
    assert push.half_px == pytest.approx(-130.0 / 200.0 * np.array(BELOW_PX))
    assert push.full_px == pytest.approx(-230.0 / 200.0 * np.array(BELOW_PX))
    assert sequence.job.looks == 6
    assert heights_um([push], exact_map(), PRESS_UM) == pytest.approx([30.0])


async def test_each_depth_is_the_mean_of_its_looks(world: World) -> None:
    flexes = iter([(0.0, 0.0), (1.0, 2.0), (0.0, 0.0), (3.0, 0.0), (0.0, 0.0), (0.0, 5.0)])
    world.flex_px = lambda: next(flexes)
    sequence = _sequence(world)
    push = await press(sequence, world.gantry.reported)
    await sequence.job.settle()
    assert push.half_px == pytest.approx(-0.5 * np.array(BELOW_PX) + (1.5 - 0.5, 0.0 - 1.0))
    assert push.full_px == pytest.approx(-1.0 * np.array(BELOW_PX) + (0.0 - 0.5, 2.5 - 1.0))


@pytest.mark.parametrize("look", [3, 5])
async def test_nothing_is_left_standing_on_a_board_if_the_tip_is_lost(world: World, look: int) -> None:
    world.station.script[look] = lambda seen: replace(seen, tip=NotFound(Reason.NO_NEEDLE, "none"))
    sequence, place = _sequence(world), world.gantry.reported
    with pytest.raises(Fault) as caught:
        await press(sequence, place)
    await sequence.job.settle()
    assert caught.value.kind is FaultCode.TIP_NOT_FOUND
    assert world.gantry.moves[-1][0] == place
    assert len(world.gantry.moves) == (3 if look == 3 else 4)


async def test_after_a_failed_move_nothing_moves_by_itself(world: World) -> None:
    world.gantry.failures[2] = Stalled("blocked", device="z")
    sequence = _sequence(world)
    with pytest.raises(Stalled):
        await press(sequence, world.gantry.reported)
    await sequence.job.settle()
    assert len(world.gantry.moves) == 2


async def test_a_tip_lost_before_the_touch_presses_nothing(world: World) -> None:
    world.station.script[1] = lambda seen: replace(seen, tip=NotFound(Reason.TOO_DARK, "dark"))
    sequence = _sequence(world)
    with pytest.raises(Fault):
        await press(sequence, world.gantry.reported)
    await sequence.job.settle()
    assert len(world.gantry.moves) == 1


# --- the print's paper --------------------------------------------------------------------------------------------


async def test_the_papers_height_is_the_middle_one_of_three_touches_beside_the_lines(world: World) -> None:
    over = world.gantry.reported
    heights = {round(dx): h for (dx, _), h in zip(CARD_PLACES_UM, (55.0, 20.0, -10.0), strict=True)}
    middle_x = float(world.tip_um()[0])
    world.height_um = lambda x, _y: heights[min(heights, key=lambda dx: abs(x - middle_x - dx))]
    sequence = _sequence(world)
    assert await card_height_um(sequence, exact_map(), over) == pytest.approx(20.0, abs=0.01)
    await sequence.job.settle()
    stops = [(to.x_um - over.x_um, to.y_um - over.y_um) for to, _ in world.gantry.moves[::4]]
    assert stops == [pytest.approx(place) for place in CARD_PLACES_UM]


@pytest.mark.parametrize(("press_um", "moves"), [(0.0, 0), (100.0, 12)])
async def test_where_nothing_may_be_pressed_the_paper_counts_as_flat(
    tmp_path: Path, press_um: float, moves: int
) -> None:
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {"gantry": {"press_um": press_um}}).teach().with_map()
    world.put_beside("A", (0.0, 0.0))
    sequence = _sequence(world)
    assert await card_height_um(sequence, exact_map(), world.gantry.reported) == pytest.approx(0.0, abs=0.01)
    await sequence.job.settle()
    assert len(world.gantry.moves) == moves
