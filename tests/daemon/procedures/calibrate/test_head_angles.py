"""A plan of head angles stands on the motor's steps, inside the allowed range, in the order the axis turns."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.calibrate.head_angles import DEFAULT_ANGLES, STEP_DEG, between, plan_angles

WHOLE = (-220.0, 100.0)


def _axis(head_deg: float) -> float:
    return head_deg - 360.0 if head_deg > 100.1 else head_deg


@given(st.integers(6, 400), st.floats(-220.0, -100.0), st.floats(0.0, 100.0))
def test_every_angle_is_one_the_motor_can_stand_at_inside_the_axis_range(n: int, low: float, high: float) -> None:
    found = plan_angles(n, None, low, high)
    assert all(abs(a / STEP_DEG - round(a / STEP_DEG)) < 1e-6 for a in found)
    assert all(low - 1e-6 <= _axis(a) <= high + 1e-6 for a in found)
    assert not any(100.0 < a < 140.0 for a in found)
    assert [_axis(a) for a in found] == sorted(_axis(a) for a in found)


def test_a_number_of_angles_is_spread_evenly_from_end_to_end() -> None:
    found = [_axis(a) for a in plan_angles(24, None, *WHOLE)]
    assert len(found) == 24
    assert (found[0], found[-1]) == pytest.approx((-220.0, 100.0), abs=STEP_DEG)
    assert max(b - a for a, b in pairwise(found)) < 320.0 / 23 + 2 * STEP_DEG
    assert len(plan_angles(None, None, *WHOLE)) == DEFAULT_ANGLES


def test_every_degree_is_the_thesis_own_plan_and_its_missing_one() -> None:
    found = plan_angles(None, 1.0, *WHOLE)
    assert len(found) == 321
    assert [_axis(a) for a in found] == pytest.approx([*range(-220, 101)], abs=STEP_DEG)


def test_landings_are_tried_between_the_angles_that_were_fitted() -> None:
    fitted = plan_angles(24, None, *WHOLE)
    tried = between(fitted, 8)
    assert len(tried) == 8
    assert min(abs(_axis(t) - _axis(f)) for t in tried for f in fitted) > 5.0
    assert len(between(plan_angles(6, None, *WHOLE), 8)) == 5


def test_too_few_angles_are_refused_with_their_number() -> None:
    with pytest.raises(Fault, match="at least 6") as caught:
        plan_angles(None, 45.0, 0.0, 100.0)
    assert caught.value.kind is FaultCode.INVALID_REQUEST


@pytest.mark.parametrize(
    ("every_deg", "low", "high", "count"), [(20.0, 0.0, 100.0, 6), (20.0, 0.1, 100.0, None), (20.0, 0.0, 99.9, None)]
)
def test_six_angles_are_enough_and_multiples_at_both_ends_count(
    every_deg: float, low: float, high: float, count: int | None
) -> None:
    if count is None:
        with pytest.raises(Fault, match="leaves 5 head angles"):
            plan_angles(None, every_deg, low, high)
    else:
        planned = plan_angles(None, every_deg, low, high)
        assert planned == pytest.approx([0.0, 20.0, 40.0, 60.0, 80.0, 100.0], abs=STEP_DEG)


def test_the_plan_keeps_to_the_narrower_of_axis_and_configuration() -> None:
    assert [_axis(a) for a in plan_angles(6, None, -300.0, 200.0)][::5] == pytest.approx([-220.0, 100.0], abs=STEP_DEG)
    assert [_axis(a) for a in plan_angles(6, None, -100.0, 50.0)] == pytest.approx(
        [-100.0, -70.0, -40.0, -10.0, 20.0, 50.0], abs=STEP_DEG
    )


def test_angles_stand_inside_the_range_though_its_ends_are_between_two_steps() -> None:
    third = STEP_DEG / 3
    low, high = -100.0 * STEP_DEG + third, 100.0 * STEP_DEG - third
    found = [_axis(a) / STEP_DEG for a in plan_angles(6, None, low, high)]
    assert (found[0], found[-1]) == pytest.approx((-99.0, 99.0))
    wide = [_axis(a) / STEP_DEG for a in plan_angles(6, None, low - third, high + third)]
    assert (wide[0], wide[-1]) == pytest.approx((-100.0, 100.0)), "an end that is a step itself counts"


def test_angles_that_fall_on_one_step_are_visited_once() -> None:
    found = plan_angles(50, None, 0.0, 20 * STEP_DEG)
    assert [a / STEP_DEG for a in found] == pytest.approx([*range(21)])


def test_angles_between_are_in_the_middle_of_their_neighbours_across_zero_too() -> None:
    assert between([340.0 + 0.2, 0.0, 20.0, 40.0], 3) == pytest.approx([350.1, 10.0, 30.0], abs=STEP_DEG)
    assert between([0.0, 20.0, 40.0, 60.0, 80.0], 2) == pytest.approx([10.0, 50.0], abs=STEP_DEG)
    assert between([0.0, 20.0, 40.0, 60.0, 80.0], 3) == pytest.approx([10.0, 50.0], abs=STEP_DEG)
    assert between([140.0, 160.0], 8) == pytest.approx([150.0], abs=STEP_DEG)
    assert between([80.0, 100.0], 8) == pytest.approx([90.0], abs=STEP_DEG)


def test_the_last_head_angle_belongs_to_the_upper_end_of_the_axis() -> None:
    """A motor's step from 100 deg is still 100 deg; the next one would be beyond the band."""
    assert between([90.0, 100.0 + STEP_DEG / 3], 1) == pytest.approx([95.0], abs=STEP_DEG)
    assert between([140.0, 100.0 + STEP_DEG * 2 / 3], 1)[0] > 100.0, "far beyond it, it is the lower end"
