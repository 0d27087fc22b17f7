"""A station's moves are booked and bounded, and nothing goes sideways that may be pressed."""

from __future__ import annotations

import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.platform.clock import Stopwatch
from daemon.station.allowance import Allowance
from daemon.station.free_pin import FreePin
from daemon.station.needle import NeedlePlace
from daemon.station.station import Station
from drivers.deadline import Deadline
from drivers.errors import EnvelopeViolation, Stalled
from drivers.gantry import Approach, Position
from tests.daemon.procedures.fake_station import (
    probe_model,
)
from tests.daemon.station.bench import HERE, Bench


async def test_a_move_goes_to_its_target_under_the_callers_deadline_and_is_booked(bench: Bench) -> None:
    target = replace(HERE, x_um=51_000.0)
    assert await bench.station.go(target, bench.caller) == target
    assert await bench.station.go(HERE, bench.caller, from_above=frozenset({"y"})) == HERE
    assert bench.gantry.moves == [(target, frozenset()), (HERE, {"y"})]
    assert bench.gantry.asked == [bench.caller.deadline] * 2
    assert bench.booked_ms("motion") is not None
    assert bench.booked_ms("bus") is None


async def test_a_move_comes_from_as_far_as_is_known_at_its_time(bench: Bench) -> None:
    known: list[Approach | None] = [Approach(60.0, 0.0, 0.5), None]
    station = Station(bench.config, bench.hardware, approach=lambda: known.pop(0))
    station.needle.reported(HERE)
    await station.go(replace(HERE, x_um=49_000.0), bench.caller)
    await station.go(HERE, bench.caller)
    assert bench.gantry.approaches == [Approach(60.0, 0.0, 0.5), None]


BESIDE = [replace(HERE, x_um=50_010.0), replace(HERE, y_um=39_990.0), replace(HERE, theta_deg=1.0)]


@pytest.mark.parametrize("target", BESIDE)
async def test_while_the_needle_is_down_nothing_goes_sideways(bench: Bench, target: Position) -> None:
    pressed = replace(HERE, z_um=4_900.0)
    await bench.station.go(pressed, bench.caller)
    for way in (target, replace(target, z_um=4_900.0), replace(target, z_um=12_000.0)):
        with pytest.raises(Fault) as caught:
            await bench.station.go(way, bench.caller)
        assert caught.value.kind is FaultCode.NEEDLE_DOWN
    assert [move for move, _ in bench.gantry.moves] == [pressed]
    await bench.station.go(replace(HERE, z_um=4_800.0), bench.caller)
    await bench.station.go(replace(HERE, z_um=12_000.0), bench.caller)
    await bench.station.go(target, bench.caller)
    assert len(bench.gantry.moves) == 4, "straight down and straight up it may go, and once it is up anywhere"


@pytest.mark.parametrize("target", BESIDE)
async def test_while_nothing_is_known_of_the_needle_it_is_read_before_anything_goes_sideways(
    bench: Bench, target: Position
) -> None:
    bench.station.needle.forget()
    bench.gantry.reported = replace(HERE, z_um=4_900.0)
    with pytest.raises(Fault) as caught:
        await bench.station.go(target, bench.caller)
    assert caught.value.kind is FaultCode.NEEDLE_DOWN
    assert bench.gantry.moves == []
    bench.station.needle.forget()
    bench.gantry.reported = HERE
    await bench.station.go(target, bench.caller)


async def test_a_descent_that_fails_leaves_the_needle_down_until_it_is_read_to_be_up(bench: Bench) -> None:
    bench.gantry.failures[1] = Stalled("stuck", device="z")
    with pytest.raises(Stalled):
        await bench.station.go(replace(HERE, z_um=4_900.0), bench.caller)
    assert bench.station.needle.may_be_down
    assert bench.station.needle.z_um is None
    await bench.station.retract(Deadline.after(60.0))
    assert bench.station.needle.is_up


async def test_after_homing_the_needle_is_where_the_drives_say(bench: Bench) -> None:
    bench.gantry.reported = replace(HERE, z_um=30_000.0)
    await bench.station.home(bench.caller)
    assert (bench.station.needle.place, bench.station.needle.z_um) == (NeedlePlace.UP, 30_000.0)
    bench.gantry.failures[0] = Stalled("stuck", device="x")
    with pytest.raises(Stalled):
        await bench.station.home(bench.caller)
    assert bench.station.needle.place is NeedlePlace.UNKNOWN


async def test_only_homing_that_came_to_its_end_stands_for_a_pin_that_was_seen_free(bench: Bench) -> None:
    free = FreePin(probe_model(), (800.0, 620.0), 2.0, 5_200.0)
    bench.station.pressing(free)
    bench.gantry.failures[0] = Stalled("stuck", device="x")
    with pytest.raises(Stalled):
        await bench.station.home(bench.caller)
    assert bench.station.needle.free_pin is free
    bench.gantry.failures.clear()
    await bench.station.home(bench.caller)
    assert bench.station.needle.free_pin is None


async def test_a_target_out_of_reach_is_refused(bench: Bench) -> None:
    outside = replace(HERE, x_um=-1.0)
    with pytest.raises(EnvelopeViolation):
        await bench.station.go(outside, bench.caller)
    with pytest.raises(EnvelopeViolation):
        bench.station.check(outside)
    bench.station.check(HERE)
    assert bench.gantry.moves == []


@pytest.mark.parametrize(("z_um", "moves"), [(5_205.0, 0), (5_195.0, 0), (5_205.1, 1), (5_194.9, 1), (12_000.0, 1)])
async def test_z_is_brought_to_a_height_unless_it_is_there(bench: Bench, z_um: float, moves: int) -> None:
    at = replace(HERE, z_um=z_um, theta_deg=7.0)
    reached = await bench.station.to_height(at, 5_200.0, bench.caller)
    assert reached == (replace(at, z_um=5_200.0) if moves else at)
    assert len(bench.gantry.moves) == moves


async def test_homing_is_a_motion_and_is_asked_of_the_drives(bench: Bench) -> None:
    await bench.station.home(bench.caller)
    assert bench.gantry.homings == 1
    assert bench.booked_ms("motion") is not None
    await bench.station.require_homed(bench.caller)
    bench.gantry.is_homed = False
    with pytest.raises(Fault) as caught:
        await bench.station.require_homed(bench.caller)
    assert caught.value.kind is FaultCode.NOT_HOMED


async def test_the_drives_are_asked_for_two_seconds_at_most(bench: Bench) -> None:
    await bench.station.require_homed(bench.caller)
    assert bench.gantry.asked[-1].at_s <= time.monotonic() + 2.0
    soon = Allowance(Deadline.after(0.5), Stopwatch())
    await bench.station.require_homed(soon)
    assert bench.gantry.asked[-1] == soon.deadline


async def test_the_position_is_what_the_drives_say(bench: Bench) -> None:
    assert await bench.station.position(bench.caller) == HERE
    assert bench.gantry.asked == [bench.caller.deadline]
    assert bench.booked_ms("bus") is not None


@pytest.mark.parametrize(("z_um", "moves"), [(11_999.0, 1), (12_000.0, 0), (15_000.0, 0)])
async def test_the_needle_is_lifted_to_the_safe_height_if_it_is_lower(bench: Bench, z_um: float, moves: int) -> None:
    bench.gantry.reported = replace(HERE, z_um=z_um)
    await bench.station.retract(bench.caller.deadline)
    assert bench.gantry.moves == [(replace(HERE, z_um=12_000.0), frozenset())] * moves


async def test_stop_reaches_the_axes(bench: Bench) -> None:
    await bench.station.stop()
    assert bench.gantry.stopped == 1


def test_exchanges_are_those_of_all_lines(bench: Bench) -> None:
    assert bench.station.exchanges == 0
    lines = {name: SimpleNamespace(statistics=SimpleNamespace(requests=n)) for name, n in (("a", 3), ("b", 4))}
    bench.hardware.buses = cast("Any", lines)
    assert bench.station.exchanges == 7
