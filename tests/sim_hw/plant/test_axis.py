"""Mechanics: backlash, the error of a stop, lost steps at a hard stop, switches."""

import math
import random
from itertools import pairwise

import pytest

from sim_hw.plant.axis import Axis
from sim_hw.plant.motion import Ramps, Trajectory, plan_move
from tests.sim_hw.rig import BY_NAME, Rig

RAMPS = Ramps(50_000.0, 200_000.0, 200_000.0)


def move(axis: Axis, t_s: float, by: float, **how: float) -> Trajectory:
    demand = plan_move(t_s, 0.0, 0.0, by, RAMPS)
    axis.follow(demand, **how)
    return demand


def make_axis(start: float = 50_000.0, name: str = "x") -> Axis:
    return Axis(BY_NAME[name], start, random.Random(3))


def test_backlash_is_lost_on_reversal_and_only_once() -> None:
    axis = make_axis()
    move(axis, 0.0, 1000.0, backlash=15.0)
    assert axis.position(10.0) == pytest.approx(51_000.0)
    move(axis, 10.0, -1000.0, backlash=15.0)
    assert axis.position(20.0) == pytest.approx(50_015.0)
    move(axis, 20.0, -1000.0, backlash=15.0)
    assert axis.position(30.0) == pytest.approx(49_015.0)
    move(axis, 30.0, 10.0, backlash=15.0)
    assert axis.position(40.0) == pytest.approx(49_015.0), "within the backlash the carriage does not move"
    move(axis, 40.0, 990.0, backlash=15.0)
    assert axis.position(50.0) == pytest.approx(50_000.0), "approached from below, nothing is lost"


def test_every_stop_draws_its_own_error_of_8_um_in_the_plane() -> None:
    rig = Rig()
    axis, sigma = make_axis(), rig.plant.stop_sigma("x")
    errors = []
    for number in range(2000):
        t_s = 10.0 * number
        move(axis, t_s, 1000.0 if number % 2 else -1000.0, sigma=sigma)
        errors.append(axis.position(t_s + 9.0) - axis.carriage(t_s + 9.0))
    rms = math.sqrt(sum(error * error for error in errors) / len(errors))
    assert rms * math.sqrt(2.0) == pytest.approx(8.0, rel=0.05)
    lag_one = sum(a * b for a, b in pairwise(errors)) / len(errors) / rms**2
    assert abs(lag_one) < 0.1


def test_an_axis_against_its_hard_stop_loses_steps_and_nobody_knows() -> None:
    axis = make_axis(start=1000.0)
    demand = move(axis, 0.0, -10_000.0)
    assert axis.position(demand.end_s + 1.0) == pytest.approx(-5000.0)
    move(axis, 10.0, 5000.0)
    assert axis.position(20.0) == pytest.approx(0.0, abs=1e-6)


def test_the_past_stays_what_it_was_for_ten_seconds() -> None:
    axis = make_axis()
    move(axis, 0.0, 1000.0)
    before = [axis.position(0.01 * step) for step in range(50)]
    for number in range(1, 10):
        move(axis, float(number), 100.0)
    assert [axis.position(0.01 * step) for step in range(50)] == before


def test_a_crossing_is_when_the_carriage_passes_the_place() -> None:
    axis = make_axis(start=500.0)
    move(axis, 0.0, -1000.0, backlash=15.0)
    t_s = axis.next_crossing(0.0, 0.0, upwards=False)
    assert t_s is not None
    assert axis.carriage(t_s) == pytest.approx(0.0, abs=1e-6)
    assert axis.next_crossing(0.0, 0.0, upwards=True) is None
    assert axis.next_crossing(0.0, t_s, upwards=False) is None


def test_a_stalled_axis_stays() -> None:
    axis = make_axis()
    axis.follow(plan_move(0.0, 0.0, 0.0, 1000.0, RAMPS), stalled=True, sigma=10.0)
    assert axis.position(10.0) == 50_000.0
