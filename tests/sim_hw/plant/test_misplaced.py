"""Ways that end beside their place: at the share asked for, kept by short ways, gone with the next long one."""

import pytest

from sim_hw.plant.motion import Ramps, plan_move
from sim_hw.plant.plant import Plant
from tests.sim_hw.rig import make_plant

FAR = 5_000.0


def _places(plant: Plant, ways: list[float], axis: str = "x") -> list[float]:
    """Drive ways as a motor does; return how far beside its place each ended."""
    t_s, at, beside = 0.0, plant.axes[axis].rotor(0.0), []
    for way in ways:
        demand = plan_move(t_s, at, 0.0, at + way, Ramps(1e5, 1e6, 1e6))
        plant.axes[axis].follow(demand, beside=plant.beside(axis, way))
        t_s, at = demand.end_s + 0.1, at + way
        beside.append(plant.axes[axis].position(t_s) - at)
    return beside


def test_without_the_knob_every_way_ends_where_it_did() -> None:
    assert _places(make_plant(), [FAR, -FAR, 100.0] * 5) == pytest.approx([0.0] * 15, abs=1e-6)


def test_two_axes_together_are_beside_their_place_at_the_share_and_within_the_reach() -> None:
    plant = make_plant(misplaced_share=0.05, misplaced_um=400.0)
    ways = [(plant.beside("x", FAR), plant.beside("y", FAR)) for _ in range(10_000)]
    assert sum(x != 0.0 or y != 0.0 for x, y in ways) == pytest.approx(500, abs=90)
    assert max(max(abs(x), abs(y)) for x, y in ways) <= 400.0
    assert plant.beside("z", FAR) == plant.beside("theta", 90.0) == 0.0


def test_a_correction_keeps_what_the_long_way_drew_and_so_can_cure_it() -> None:
    plant = make_plant(misplaced_share=1.0)
    first, *corrected = _places(plant, [FAR, 100.0, -300.0, FAR])
    assert abs(first) > 1.0
    assert corrected[:2] == pytest.approx([first, first], abs=1e-6)
    assert corrected[2] != pytest.approx(first, abs=1e-3)


def test_the_same_seed_misplaces_the_same_ways() -> None:
    first, again, other = (_places(make_plant(seed, misplaced_share=0.5), [FAR] * 8) for seed in (3, 3, 4))
    assert first == again != other


def test_what_follows_the_knob_is_the_same_however_many_ways_there_were_before() -> None:
    after = []
    for before in (2, 7):
        plant = make_plant(3)
        for _ in range(before):
            plant.beside("x", FAR)
        plant.set_knob("misplaced_share", 0.5)
        after.append([plant.beside("x", FAR) for _ in range(8)])
    assert after[0] == after[1] != [0.0] * 8
