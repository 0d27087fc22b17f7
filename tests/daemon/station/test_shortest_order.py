"""The order of points is never longer than the one given, and its times are those of the gantry's own legs."""

from __future__ import annotations

import math
import random
from itertools import pairwise, permutations

import numpy as np
import pytest

from daemon.config.model import Config, load_config
from daemon.station.shortest_order import shortest_order
from daemon.station.travel_time import TravelTimes, trapezoid_s
from drivers.gantry import Approach, Position
from drivers.gantry.contract import GantryConfig, axis_theta_deg
from drivers.gantry.path import Ends, plan
from tests.daemon.procedures.fake_station import EXAMPLE


@pytest.fixture(scope="module")
def config() -> Config:
    return load_config(EXAMPLE)


def _places(seed: int, count: int, config: Config, thetas: tuple[float, ...] = (0.0,)) -> list[Position]:
    rng = random.Random(seed)
    return [
        Position(
            rng.uniform(20_000.0, 120_000.0), rng.uniform(20_000.0, 80_000.0), config.gantry.work_z_um,
            rng.choice(thetas),
        )
        for _ in range(count)
    ]  # fmt: skip


def _leg_s(config: Config, axis: str, way: float) -> float:
    section = getattr(config.axes, axis)
    if abs(way) < section.speed**2 / section.acceleration:
        return 2 * math.sqrt(abs(way) / section.acceleration)
    return abs(way) / float(section.speed) + section.speed / section.acceleration


def _by_legs_s(config: Config, now: Position, target: Position, approach: Approach | None) -> float:
    """Time the legs that the gantry itself plans."""
    gantry = config.gantry
    machine = GantryConfig(
        safe_z_um=gantry.safe_z_um, backlash_um=gantry.approach_um, backlash_theta_deg=gantry.approach_deg
    )
    wide = (-1e9, 1e9)
    now, target = (
        Position(p.x_um, p.y_um, p.z_um, axis_theta_deg(p.theta_deg)) for p in (now, target)
    )  # fmt: skip
    at = {"x": now.x_um, "y": now.y_um, "z": now.z_um, "theta": now.theta_deg}
    total_s = gantry.settle_ms / 1e3
    for leg in plan(now, target, machine, Ends(wide, wide, wide, wide), approach=approach):
        total_s += max(_leg_s(config, axis, to - at[axis]) for axis, to in leg.to.items())
        at |= leg.to
    return total_s


@pytest.mark.parametrize("approach", [None, Approach(60.0, 0.0, 0.5)])
def test_times_are_those_of_the_legs_that_the_gantry_plans(config: Config, approach: Approach | None) -> None:
    places = _places(1, 60, config, (0.0, 45.0, 330.0))
    found = TravelTimes(config, places, approach).between(np.arange(60), np.arange(60))
    for i, j in random.Random(2).sample([(i, j) for i in range(60) for j in range(60) if i != j], 300):
        assert found[i, j] == pytest.approx(_by_legs_s(config, places[i], places[j], approach), abs=1e-9), (i, j)
    assert not np.diagonal(found).any()


def test_a_short_way_is_a_triangle_and_a_long_one_a_trapezoid() -> None:
    times = trapezoid_s(np.array([0.0, 1.0, 100.0]), speed=10.0, acceleration=100.0)
    assert times.tolist() == pytest.approx([0.0, 0.2, 10.1])


@pytest.mark.parametrize("seed", range(8))
def test_the_order_found_is_never_longer_than_the_one_given(seed: int, config: Config) -> None:
    places = _places(seed, 2 + 5 * seed, config, (0.0, 90.0, 180.0))
    times = TravelTimes(config, places)
    given = list(range(1, len(places)))
    found = shortest_order(times, given, 0)
    assert sorted(found) == given
    assert times.along([0, *found]) <= times.along([0, *given]) + 1e-9


@pytest.mark.parametrize("seed", range(6))
def test_of_seven_points_the_order_found_is_near_the_best_of_all(seed: int, config: Config) -> None:
    places = _places(100 + seed, 8, config, (0.0, 90.0))
    times = TravelTimes(config, places)
    best_s = min(times.along([0, *order]) for order in permutations(range(1, 8)))
    assert times.along([0, *shortest_order(times, range(1, 8), 0)]) <= 1.05 * best_s


def test_an_order_that_is_the_best_already_stays_as_long(config: Config) -> None:
    row = [Position(30_000.0 + 2_000.0 * i, 40_000.0, config.gantry.work_z_um, 0.0) for i in range(20)]
    times = TravelTimes(config, row)
    assert shortest_order(times, range(1, 20), 0) == list(range(1, 20))


def test_angles_are_grouped(config: Config) -> None:
    places = _places(5, 41, config, (0.0, 180.0))
    found = shortest_order(TravelTimes(config, places), range(1, 41), 0)
    thetas = [places[i].theta_deg for i in found]
    assert sum(a != b for a, b in pairwise(thetas)) == 1


def test_more_points_than_a_window_holds_are_ordered_too(config: Config) -> None:
    places = _places(7, 900, config)
    times = TravelTimes(config, places)
    found = shortest_order(times, range(1, 900), 0)
    assert sorted(found) == list(range(1, 900))
    assert times.along([0, *found]) < 0.6 * times.along(range(900))


def test_no_point_and_one_point_are_orders_too(config: Config) -> None:
    times = TravelTimes(config, _places(3, 2, config))
    assert shortest_order(times, [], 0) == []
    assert shortest_order(times, [1], 0) == [1]
