"""A Z that stands lower than its drive counts: every job that goes somewhere sees it, and leaves no needle pressed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.registry import PROCEDURES
from daemon.station.free_pin import FreePin
from daemon.station.station import LookResult
from tests.daemon.procedures import fake_station as fake
from tests.daemon.procedures.fake_station import Ran, World, a_board, run
from tests.daemon.procedures.test_align import WHOLE
from vision import NotFound, Reason

GRID = [(f"P{i}{k}", 5_000.0 + 7_000.0 * i, 4_000.0 + 6_500.0 * k) for i in range(4) for k in range(3)]
SAFE_Z_UM = 12_000.0
NO_NEEDLE = NotFound(Reason.NO_NEEDLE, "a busy ground")


def _world(folder: Path, board: Any = None) -> World:
    world = World(folder, board or a_board(*GRID), {}).teach().with_map()

    def free() -> FreePin | None:
        kept = world.calibrations
        if kept.probe is None or kept.pose_map is None:
            return None
        return FreePin.where_no_board_is(kept.probe, kept.pose_map, world.config.gantry.safe_z_um)

    world.station.needle.taught_free = free
    return world


@pytest.fixture
def world(tmp_path: Path) -> World:
    return _world(tmp_path)


def _pushed_um(world: World) -> float:
    x_um, y_um = world.tip_um()
    return float(max(0.0, 5_000.0 + world.height_um(float(x_um), float(y_um)) - world.gantry.actual.z_um))


async def _do(world: World, **request: Any) -> Ran:
    return await run(world, PROCEDURES[request["op"]], request)


def _hidden_over(world: World, place_um: tuple[float, float]) -> None:
    aside = [world.geometry.position_over(place_um, deg) for deg in (0.0, 90.0, 180.0, 270.0)]

    def busy(look: LookResult) -> LookResult:
        at = look.position
        here = any(abs(at.x_um - o.x_um) < 1.0 and abs(at.y_um - o.y_um) < 1.0 for o in aside)
        return replace(look, tip=NO_NEEDLE) if here else look

    world.station.always = busy


# --- safety ---------------------------------------------------------------------------------------------------------


async def test_align_leaves_no_needle_pressed_by_a_z_that_lost_steps(tmp_path: Path) -> None:
    world = _world(tmp_path, WHOLE)
    world.put_tip(world.pad_um("A"), z_um=SAFE_Z_UM)
    world.gantry.lost_z_um = 700.0
    with pytest.raises(Fault) as caught:
        await _do(world, op="align")
    assert caught.value.kind is FaultCode.AXIS_STALLED
    assert _pushed_um(world) == 0.0


async def test_a_crashed_needle_over_a_measured_surface_is_lifted_and_z_doubted(world: World) -> None:
    """A pin at the end of its travel does not come out on a lift of some 0.1 mm: `lifted or not` is no proof."""
    world.with_flat_surface()
    world.put_tip(world.pad_um("P00"), z_um=SAFE_Z_UM)
    world.pin_travel_um = 1_000.0
    world.gantry.lost_z_um = 4_466.0
    with pytest.raises(Fault) as caught:
        await _do(world, op="place", test_point="P11")
    assert caught.value.kind is FaultCode.AXIS_STALLED
    assert _pushed_um(world) == 0.0


async def test_a_surface_that_is_not_met_because_the_needle_stands_in_it_leaves_it_raised(world: World) -> None:
    """At the end of its travel the pin moves no more in the picture, however much deeper it is sent."""
    world.put_tip(world.pad_um("P00"), z_um=SAFE_Z_UM)
    world.pin_travel_um = 1_000.0
    world.gantry.lost_z_um = 3_677.0
    with pytest.raises(Fault) as caught:
        await _do(world, op="calibrate", what="surface", places=4)
    assert caught.value.kind is FaultCode.AXIS_STALLED
    assert _pushed_um(world) == 0.0


async def test_the_way_back_down_from_a_suspect_is_seen_too(world: World) -> None:
    """Flex (60 um of a push) makes a free pin suspect; Z loses steps on that lift, which nobody looks at afterwards."""
    world.put_tip(world.pad_um("P11"), z_um=SAFE_Z_UM)
    flex = -60.0 / fake.HOVER_UM * world.push_scale * fake.np.array(fake.BELOW_PX)
    world.flex_px = lambda: (float(flex[0]), float(flex[1]))
    move_to = world.gantry.move_to

    async def loses(target: Any, *a: Any, **k: Any) -> Any:
        if len(world.gantry.moves) == 1:
            world.gantry.lost_z_um = 1_000.0
        return await move_to(target, *a, **k)

    world.gantry.move_to = loses  # type: ignore[method-assign]
    with pytest.raises(Fault) as caught:
        await _do(world, op="place", test_point="P11")
    assert caught.value.kind is FaultCode.AXIS_STALLED
    assert _pushed_um(world) == 0.0


@pytest.mark.parametrize("reason", [Reason.SATURATED, Reason.BLURRED, Reason.TOO_DARK])
async def test_a_stuck_pressed_needle_in_pictures_that_are_no_good_is_not_dragged(world: World, reason: Reason) -> None:
    world.put_tip(world.pad_um("P11"), z_um=SAFE_Z_UM)
    world.gantry.sticks_at_um = 4_500.0
    world.station.always = lambda look: replace(look, tip=NotFound(reason, "no good"))
    await _do(world, op="place", test_point="P11")
    assert _pushed_um(world) > 0.0
    before = len(world.gantry.moves)
    with pytest.raises(Fault):
        await _do(world, op="place", test_point="P00")
    x, y = world.gantry.moves[before - 1][0].x_um, world.gantry.moves[before - 1][0].y_um
    assert all((m.x_um, m.y_um) == (x, y) for m, _ in world.gantry.moves[before:]), "dragged over the board"


# --- availability ---------------------------------------------------------------------------------------------------


async def test_a_ground_that_hides_the_tip_at_any_height_keeps_the_needle_from_going_aside(world: World) -> None:
    """Nobody knows whether it is free: the job ends by that, and by no state that does not allow a move."""
    _hidden_over(world, (5_000.0, 4_000.0))
    with pytest.raises(Fault) as caught:
        await _do(world, op="calibrate", what="surface", places=12)
    assert caught.value.kind is FaultCode.TIP_NOT_FOUND


async def test_a_free_tip_beside_its_taught_place_after_one_hidden_look_is_no_stalled_z(world: World) -> None:
    """2.5 px aside: the scatter of the teaching stop and of this stop (0.7 px each way) do that in some of 100."""
    world.put_tip(world.pad_um("P11"), z_um=SAFE_Z_UM)
    free = world.station.needle.taught_free()
    assert free is not None
    across = fake.np.array([-fake.BELOW_PX[1], fake.BELOW_PX[0]]) / fake.np.hypot(*fake.BELOW_PX)
    off = across * (free.within_px + 0.1)  # sideways: no push looks like this
    world.flex_px = lambda: (float(off[0]), float(off[1]))
    hidden = [True]

    def once(look: LookResult) -> LookResult:
        return replace(look, tip=NO_NEEDLE) if hidden and hidden.pop() else look

    world.station.always = once
    at = world.gantry.actual
    await world.station.look_white(at, world.calibrations.require_probe(), None, fake.begin({"op": "lift"}).job)
    assert (await _do(world, op="place", test_point="P00")).got.outcome == "placed"


async def test_a_tip_that_is_seen_again_lets_a_person_jog(world: World) -> None:
    world.put_tip(world.pad_um("P11"), z_um=SAFE_Z_UM - 50.0)
    world.station.always = lambda look: replace(look, tip=NO_NEEDLE)
    job = fake.begin({"op": "lift"}).job
    at = world.gantry.actual
    await world.station.look_white(at, world.calibrations.require_probe(), None, job)
    with pytest.raises(Fault):
        await _do(world, op="place", test_point="P00")
    world.station.always = lambda look: look
    await world.station.look_white(world.gantry.actual, world.calibrations.require_probe(), None, job)
    assert not world.station.needle.blind
    assert (await _do(world, op="jog", axis="x", by_um=500.0)).got.outcome == "jogged"


async def test_a_needle_that_was_taught_again_is_judged_by_its_own_model(world: World) -> None:
    world.put_tip(world.pad_um("P11"), z_um=SAFE_Z_UM)
    world.station.always = lambda look: replace(look, tip=NO_NEEDLE)
    job = fake.begin({"op": "lift"}).job
    await world.station.look_white(world.gantry.actual, world.calibrations.require_probe(), None, job)
    with pytest.raises(Fault) as caught:
        await _do(world, op="place", test_point="P00")
    assert caught.value.kind is FaultCode.TIP_NOT_FOUND
    old = world.calibrations.require_probe()
    world.calibrations.store_probe(replace(old, tip_px=(810.0, 620.0)))
    assert world.station.needle.free_pin is None, "of the old needle, and nothing but homing takes it away"
