"""A touch sense ends a descent early, lets none begin on its false word, and makes none longer."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.registry import PROCEDURES
from tests.daemon.procedures.fake_station import SENSE_INPUT, World, a_board, begin, run
from tests.daemon.procedures.test_touch import (
    PRESS_UM,
    TOUCH_Z_UM,
    Holder,
    _goes_aside,
    _over,
    _surface,
    _surface_z_um,
    _touch,
)
from vision import Tip

EARLY_UM = 100.0


def over_a(folder: Path, **sense: object) -> World:
    """Return a station with a touch sense, whose tip is over A and was seen there."""
    world = World(folder, a_board(("A", 20_000.0, 15_000.0), ("B", 25_000.0, 15_000.0)), {"sense": sense})
    world.teach().with_map().calibrations.store(_surface(world))
    world.height_um = lambda x, y: world.geometry.height_um((x, y))
    _over(world, "A")
    return world


@pytest.fixture
def world(tmp_path: Path) -> World:
    return over_a(tmp_path, kind="drive_input")


async def test_a_descent_stops_near_the_surface_and_goes_on_where_nothing_is_felt(world: World) -> None:
    world.gantry.metal_z_um = _surface_z_um(world)
    ran = await _touch(world, Holder())
    heights = [move.z_um for move, _ in world.gantry.moves]
    assert heights[:2] == pytest.approx([_surface_z_um(world) + EARLY_UM, _surface_z_um(world) - PRESS_UM])
    assert len(heights) == 3
    assert ran.got.outcome == "touched"


async def test_metal_well_above_the_surface_ends_the_descent_there(world: World) -> None:
    world.gantry.metal_z_um = _surface_z_um(world) + EARLY_UM + 1.0
    with pytest.raises(Fault) as caught:
        await _touch(world, Holder())
    assert caught.value.kind is FaultCode.WRONG_HEIGHT
    assert min(move.z_um for move, _ in world.gantry.moves) == pytest.approx(_surface_z_um(world) + EARLY_UM)


@pytest.mark.parametrize(("closed", "inputs"), [("high", {SENSE_INPUT}), ("low", {3})])
async def test_a_sense_that_is_closed_before_the_descent_lowers_nothing(
    tmp_path: Path, closed: str, inputs: set[int]
) -> None:
    world = over_a(tmp_path, kind="drive_input", closed=closed)
    world.gantry.inputs = inputs
    here = world.gantry.reported
    with pytest.raises(Fault) as caught:
        await _touch(world, Holder())
    assert caught.value.kind is FaultCode.CONTACT_BEFORE_DESCENT
    assert min(move.z_um for move, _ in world.gantry.moves) == here.z_um


async def test_a_sense_that_closes_late_makes_no_descent_longer(world: World) -> None:
    """The board lies lower than it was measured: the needle stops where it would without a sense."""
    world.gantry.metal_z_um = _surface_z_um(world) - 2_000.0
    await _touch(world, Holder())
    assert min(move.z_um for move, _ in world.gantry.moves) == pytest.approx(_surface_z_um(world) - PRESS_UM)


async def test_without_a_sense_no_input_is_asked(tmp_path: Path) -> None:
    world = over_a(tmp_path)
    world.gantry.inputs = {SENSE_INPUT}
    assert (await _touch(world, Holder())).got.outcome == "touched"
    assert len(world.gantry.moves) == 2


@pytest.mark.parametrize("stuck", [True, False])
@pytest.mark.parametrize("seen_um", [25.0, 0.0])
async def test_a_needle_that_may_be_pushed_in_a_little_is_lifted_to_see_what_closes_the_sense(
    world: World, seen_um: float, stuck: bool
) -> None:
    """A push of less than the flex of camera and needle is no certain sight, nor is a pin that looks free."""
    here = world.gantry.reported
    if seen_um:
        world.height_um = lambda _x, _y: here.z_um - TOUCH_Z_UM + seen_um  # the board came up against it
    if stuck:
        world.gantry.inputs = {SENSE_INPUT}
    else:
        world.gantry.metal_z_um = here.z_um + 25.0
    with pytest.raises(Fault) as caught:
        await _touch(world, Holder())
    heights = [move.z_um for move, _ in world.gantry.moves]
    if stuck:
        assert caught.value.kind is FaultCode.CONTACT_BEFORE_DESCENT
        assert heights == [world.config.gantry.safe_z_um, here.z_um], "where it was free it may hover"
    else:
        assert caught.value.kind is FaultCode.WRONG_HEIGHT
        assert heights == [world.config.gantry.safe_z_um]


@pytest.mark.parametrize("by", ["a move", "a look"])
async def test_after_a_press_a_pin_that_looks_free_and_feels_metal_goes_nowhere_sideways(world: World, by: str) -> None:
    """Z lost steps on its way up: what is left of the push is less than a look can tell."""
    world.gantry.metal_z_um = _surface_z_um(world)
    await _touch(world, Holder())
    here = world.gantry.reported
    world.gantry.sticks_at_um = _surface_z_um(world) - 30.0
    world.gantry.actual = replace(here, z_um=world.gantry.sticks_at_um)
    if by == "a look":
        model = world.calibrations.require_probe()
        seen = (await world.station.look_white(here, model, None, begin({"op": "look"}).job)).tip
        assert isinstance(seen, Tip)
        await world.station.seen_at(here, seen, begin({"op": "look"}).job)
    with pytest.raises(Fault) as caught:
        await _goes_aside(world, world.station)
    assert caught.value.kind is FaultCode.AXIS_STALLED
    assert "feels metal" in caught.value.message
    world.gantry.sticks_at_um, world.gantry.actual = None, here
    await _goes_aside(world, world.station)


async def test_a_touch_or_a_lift_that_ends_with_the_needle_on_metal_is_no_success(world: World) -> None:
    """It should not be believed by its count alone that Z lifted."""
    world.gantry.metal_z_um = _surface_z_um(world)
    tester = Holder()
    job = asyncio.create_task(_touch(world, tester, hold_ms=60_000, lease_ms=30_000))
    await tester.made.wait()
    world.gantry.sticks_at_um = world.gantry.reported.z_um
    tester.held.lift("", {})
    with pytest.raises(Fault) as caught:
        await job
    assert caught.value.kind is FaultCode.AXIS_STALLED
    with pytest.raises(Fault) as caught:
        await run(world, PROCEDURES["lift"], {"op": "lift"})
    assert caught.value.kind is FaultCode.AXIS_STALLED
    world.gantry.sticks_at_um, world.gantry.actual = None, world.gantry.reported
    assert (await run(world, PROCEDURES["lift"], {"op": "lift"})).got.outcome == "lifted"
