"""A job's moves are checked, lit, counted, journalled and booked as rounds of move and verify."""

from __future__ import annotations

from pathlib import Path

import pytest

from daemon.domain.states import Event, State
from daemon.procedures.move_sequence import BELOW, MoveSequence, shifted
from drivers.errors import EnvelopeViolation, Stalled
from drivers.gantry import Position
from drivers.lights import Light
from tests.daemon.procedures.fake_station import Ran, World, a_board, begin

HERE = Position(50_000.0, 40_000.0, 5_200.0, 10.0)


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path, a_board(("A", 0.0, 0.0)), {})


@pytest.fixture
def ran() -> Ran:
    started = begin({"op": "home"})
    started.job.fire(Event.ACCEPTED)
    started.events.clear()
    return started


async def test_the_first_move_follows_a_look_and_every_other_one_a_verification(world: World, ran: Ran) -> None:
    sequence = MoveSequence(ran.job, world.context)
    reached = await sequence.go(HERE)
    await sequence.go(shifted(HERE, dx_um=1.0))
    assert reached == HERE
    assert ran.events == [Event.SEEN, Event.ARRIVED, Event.OFF_TARGET, Event.ARRIVED]
    assert ran.machine.state is State.VERIFY
    assert ran.job.moves == 2
    assert world.lights.log == [Light.WHITE, Light.WHITE]


async def test_every_move_is_journalled_as_its_target(world: World, ran: Ran) -> None:
    world.gantry.off_um = (3.0, 4.0, 0.0)
    reached = await MoveSequence(ran.job, world.context).go(shifted(HERE, dx_um=0.126, dy_um=0.006))
    await ran.job.settle()
    assert ran.steps == [("move", {"x_um": 50_000.13, "y_um": 40_000.01, "theta_deg": 10.0})]
    assert (reached.x_um, reached.y_um) == pytest.approx((50_003.126, 40_004.006))


async def test_z_goes_down_slowly_where_the_surface_may_be_unless_told_from_where_on(world: World, ran: Ran) -> None:
    sequence = MoveSequence(ran.job, world.context)
    await sequence.go(HERE)
    await sequence.go(shifted(HERE, dx_um=10.0), slow_z_um=4_321.0)
    assert world.gantry.slow_z_um == [world.geometry.slow_z_um(HERE), 4_321.0]


async def test_axes_come_from_below_unless_told_otherwise(world: World, ran: Ran) -> None:
    sequence = MoveSequence(ran.job, world.context)
    await sequence.go(HERE)
    await sequence.go(HERE, from_above=frozenset({"x"}))
    assert [above for _, above in world.gantry.moves] == [BELOW, {"x"}]


async def test_a_target_out_of_reach_is_refused_before_anything_is_done(world: World, ran: Ran) -> None:
    with pytest.raises(EnvelopeViolation):
        await MoveSequence(ran.job, world.context).go(shifted(HERE, dx_um=-60_000.0))
    assert (ran.events, ran.job.moves, world.gantry.moves, world.lights.log) == ([], 0, [], [])


async def test_a_move_that_fails_counts_and_never_arrives(world: World, ran: Ran) -> None:
    world.gantry.failures[1] = Stalled("blocked", device="x")
    with pytest.raises(Stalled):
        await MoveSequence(ran.job, world.context).go(HERE)
    await ran.job.settle()
    assert (ran.events, ran.job.moves, ran.steps) == ([Event.SEEN], 1, [])


def test_a_place_beside_another_is_off_by_what_was_said() -> None:
    assert shifted(HERE) == HERE
    assert shifted(HERE, 1.0, -2.0, 3.0) == Position(50_001.0, 39_998.0, 5_203.0, 10.0)
    assert shifted(HERE, dy_um=5.0) == Position(50_000.0, 40_005.0, 5_200.0, 10.0)
