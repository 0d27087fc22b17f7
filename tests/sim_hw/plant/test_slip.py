"""The fault `slip`: the carriage goes astray once each time it is switched on, and the drive's count does not know."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_hw.plant.motion import Ramps, plan_move
from tests.sim_hw.rig import BY_NAME, Rig

EXACT = {"repeatability_um": 0.0, "x_backlash_um": 0.0, "home_repeatability_um": 0.0}


def homed(seed: int = 1, **knobs: object) -> Rig:
    """Return an X axis that is homed, enabled and at 20 mm."""
    rig = Rig("x", seed, **{**EXACT, **knobs})
    rig.home(21)
    rig.ramps()
    rig.enable(1)
    rig.order(20_000.0)
    rig.run_until(0x400)
    return rig


def counted_um(rig: Rig) -> float:
    return rig.read(0x6064) / rig.spec.increments_per_unit


def test_a_standing_axis_slips_and_its_count_stays() -> None:
    rig = homed()
    place_um, count_um = rig.true_place(), counted_um(rig)
    rig.faults.switch("slip", on=True)
    rig.t_s += 0.1
    assert counted_um(rig) == count_um
    assert rig.true_place() - place_um == pytest.approx(300.0)
    assert rig.plant.rest_s() == pytest.approx(rig.t_s), "a slip is a coming to rest of its own"


def test_it_slips_once_and_again_only_when_switched_on_again() -> None:
    rig = homed()
    place_um = rig.true_place()
    slipped_um = []
    for on in (True, False, True):
        rig.faults.switch("slip", on=on, **({"um": -120.0} if on else {}))
        for _ in range(3):
            rig.t_s += 0.1
            rig.status()
        slipped_um.append(rig.true_place() - place_um)
    assert slipped_um == pytest.approx([-120.0, -120.0, -240.0])


def test_a_moving_axis_goes_on_and_ends_aside_by_what_it_slipped() -> None:
    rig = homed()
    rig.order(60_000.0)
    rig.t_s += 0.2
    assert rig.plant.state_at(rig.t_s).moving
    rig.faults.switch("slip", on=True, um=250.0)
    rig.run_until(0x400)
    assert counted_um(rig) == pytest.approx(60_000.0, abs=0.01)
    assert rig.true_place() == pytest.approx(60_250.0, abs=0.01)


def test_only_the_axis_named_slips_and_homing_finds_it_again() -> None:
    rig = homed()
    place_um = rig.true_place()
    rig.faults.switch("slip", on=True, axis="y")
    rig.t_s += 0.1
    rig.status()
    assert rig.true_place() == place_um
    rig.faults.switch("slip", on=True, axis="x", um=500.0)
    rig.home(21)
    assert rig.true_place() - counted_um(rig) == pytest.approx(0.0, abs=0.05)


def test_it_never_slips_beyond_a_hard_stop() -> None:
    rig = homed()
    rig.faults.switch("slip", on=True, um=1e6)
    rig.t_s += 0.1
    rig.status()
    assert rig.true_place() == pytest.approx(BY_NAME["x"].hard_max)


def test_the_error_of_a_stop_and_the_play_outlive_a_slip() -> None:
    rig = homed(seed=3, repeatability_um=8.0, x_backlash_um=15.0)
    place_um = rig.true_place()
    rig.faults.switch("slip", on=True, um=40.0)
    rig.t_s += 0.1
    rig.status()
    assert rig.true_place() - place_um == pytest.approx(40.0)


@given(target=st.floats(-5e4, 5e4), share=st.floats(0.0, 1.2))
def test_what_is_left_of_a_motion_is_the_same_motion(target: float, share: float) -> None:
    whole = plan_move(2.0, 0.0, 0.0, target, Ramps(2e4, 1e5, 8e4))
    now_s = 2.0 + share * (whole.end_s - 2.0)
    left = whole.rest_of(now_s)
    assert left.start_s == now_s
    assert left.end_s == pytest.approx(max(whole.end_s, now_s))
    for part in range(5):
        t_s = now_s + part / 4.0 * max(whole.end_s - now_s, 0.1)
        assert math.isclose(left.position(t_s), whole.position(t_s), rel_tol=1e-9, abs_tol=1e-6)
