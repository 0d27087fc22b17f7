"""Homing finds the built-in edges, whatever side it starts from, and fails honestly."""

import pytest

from tests.sim_hw.rig import Rig

DONE, FAILED = 0x1400, 0x2000


def zero_error(rig: Rig) -> float:
    """Return how far the drive's zero is from the machine's."""
    return rig.plant.axes[rig.spec.name].rotor(rig.t_s) - rig.read(0x6064) / rig.spec.increments_per_unit


@pytest.mark.parametrize(
    ("axis", "start", "method", "edge"),
    [
        ("x", 9_000.0, 21, 0.0),
        ("x", -500.0, 21, 0.0),
        ("x", 9_000.0, 22, 0.0),
        ("x", -500.0, 22, 0.0),
        ("x", 9_000.0, 17, -3_000.0),
        ("x", -3_500.0, 17, -3_000.0),
        ("y", 149_000.0, 18, 153_000.0),
        ("z", 25_000.0, 19, 30_000.0),
        ("z", 30_200.0, 20, 30_000.0),
        ("theta", -150.0, 19, 0.0),
        ("theta", 80.0, 19, 0.0),
        ("theta", 80.0, 20, 0.0),
    ],
)
def test_each_method_finds_its_edge_from_either_side(axis: str, start: float, method: int, edge: float) -> None:
    unit = "deg" if axis == "theta" else "um"
    rig = Rig(axis, **{f"{axis}_start_{unit}": start})
    assert rig.home(method) & (DONE | FAILED) == DONE
    downwards = method in (18, 19, 22)
    backlash = rig.plant.backlash(axis) if downwards else 0.0
    sigma = 0.01 if axis == "theta" else 3.0
    assert zero_error(rig) == pytest.approx(edge - backlash, abs=4.0 * sigma)


def test_two_homings_differ_by_the_repeatability() -> None:
    rig = Rig()
    zeros = []
    for _ in range(6):
        rig.home(21)
        zeros.append(zero_error(rig))
        rig.t_s += 1.0
    assert len({round(zero, 3) for zero in zeros}) == 6
    assert max(zeros) - min(zeros) < 30.0


@pytest.mark.parametrize(("sign", "shown"), [(-1, -5_000.0), (1, 5_000.0)])
def test_the_home_offset_counts_with_the_sign_of_its_knob(sign: int, shown: float) -> None:
    rig = Rig(home_offset_sign=sign)
    rig.home(35, offset=rig.units(5_000.0))
    assert rig.read(0x6064) == rig.units(shown)


def test_homing_against_the_wrong_end_is_an_error() -> None:
    rig = Rig("x", x_start_um=195_000.0)
    assert rig.home(19) & (DONE | FAILED) & FAILED, "the home switch of X is at the other end"
    assert rig.read(0x6041, kind="H") & 0x6F == 0x27


@pytest.mark.parametrize("why", ["stalled", "switches off"])
def test_homing_without_a_switch_goes_on_until_it_is_told_to_stop(why: str) -> None:
    """A drive does not know how long its axis is: neither an unseen stall nor a switch that is off ends the run."""
    rig = Rig(special_function_enable=0 if why == "switches off" else 7)
    rig.faults.switch("stall", on=why == "stalled", axis="x")
    with pytest.raises(AssertionError, match="statusword"):
        rig.home(21)
    went_um = abs(rig.read(0x6064)) / rig.spec.increments_per_unit
    assert went_um > rig.spec.hard_max - rig.spec.hard_min
    assert rig.read(0x606C) != 0, "the field turns"
    rig.control(0x0F, after_s=1.0)
    assert rig.status() & 0x0400


def test_dropping_bit_4_interrupts() -> None:
    rig = Rig()
    rig.write(0x6098, 21, kind="b")
    rig.write(0x6099, 60, sub=1)
    rig.enable(6)
    rig.control(0x1F)
    rig.t_s += 0.2
    assert rig.plant.state_at(rig.t_s).moving
    rig.control(0x0F, after_s=0.5)
    assert not rig.plant.state_at(rig.t_s).moving
    assert rig.status() & (DONE | FAILED) == 0x0400


def test_home_switch_is_seen_in_60fdh() -> None:
    rig = Rig("theta", theta_start_deg=10.0)
    assert rig.read(0x60FD, kind="I") & 0b111 == 0b100
    assert Rig("theta", theta_start_deg=-10.0).read(0x60FD, kind="I") & 0b111 == 0
