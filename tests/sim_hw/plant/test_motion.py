"""Trapezoids are exact: they end where they should, when they should, within their limits."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_hw.plant.motion import Ramps, Trajectory, plan_move, plan_stop

places = st.floats(-2e5, 2e5)
ramps = st.builds(Ramps, st.floats(1.0, 2e5), st.floats(10.0, 1e6), st.floats(10.0, 1e6))


def assert_joined(trajectory: Trajectory, x0: float, v0: float, limit: Ramps) -> None:
    """Position and velocity go on without a jump from segment to segment, and end at rest."""
    t_s, x, v = trajectory.start_s, x0, v0
    for segment in trajectory.segments:
        assert segment.t0_s == pytest.approx(t_s)
        assert segment.x0 == pytest.approx(x, abs=1e-6)
        assert segment.v0 == pytest.approx(v, abs=1e-6 * (1.0 + abs(v)))
        assert abs(segment.a) in (0.0, pytest.approx(limit.acceleration), pytest.approx(limit.deceleration))
        t_s, x, v = segment.t1_s, segment.position(segment.t1_s), segment.velocity(segment.t1_s)
        assert abs(v) <= max(limit.speed, abs(v0)) * (1.0 + 1e-9) + 1e-9
    assert x == pytest.approx(trajectory.end, abs=1e-5)
    assert v == pytest.approx(0.0, abs=1e-4)


@given(x0=places, target=places, limit=ramps)
def test_a_move_from_rest_takes_the_textbook_time(x0: float, target: float, limit: Ramps) -> None:
    trajectory = plan_move(3.0, x0, 0.0, target, limit)
    assert_joined(trajectory, x0, 0.0, limit)
    up, down, distance = limit.acceleration, limit.deceleration, abs(target - x0)
    peak = min(limit.speed, math.sqrt(2.0 * distance * up * down / (up + down)))
    cruise = distance - peak * peak / 2.0 * (1.0 / up + 1.0 / down)
    expected_s = peak / up + peak / down + (cruise / peak if peak > 0.0 else 0.0)
    assert trajectory.end_s - 3.0 == pytest.approx(expected_s, rel=1e-6, abs=1e-7)
    assert trajectory.position(trajectory.end_s + 1.0) == target


@given(x0=places, target=places, v0=st.floats(-1e5, 1e5), limit=ramps)
def test_a_move_may_begin_at_any_speed(x0: float, target: float, v0: float, limit: Ramps) -> None:
    trajectory = plan_move(0.0, x0, v0, target, limit)
    assert trajectory.end == target
    if abs(v0) / limit.deceleration < 1e3:  # beyond, rounding of the distances is all that is left
        assert_joined(trajectory, x0, v0, limit)


@given(v0=st.floats(-1e5, 1e5), rate=st.floats(10.0, 1e6))
def test_a_stop_needs_half_v_squared_over_a(v0: float, rate: float) -> None:
    trajectory = plan_stop(1.0, 0.0, v0, rate)
    assert trajectory.end == pytest.approx(v0 * abs(v0) / (2.0 * rate))
    assert trajectory.end_s - 1.0 == pytest.approx(abs(v0) / rate)


@given(target=st.floats(1.0, 1e5), share=st.floats(0.0, 1.0), limit=ramps)
def test_time_at_a_place_is_the_inverse_of_the_place_at_a_time(target: float, share: float, limit: Ramps) -> None:
    trajectory = plan_move(0.0, 0.0, 0.0, target, limit)
    place = share * target
    times = [t_s for t_s in (segment.time_at(place) for segment in trajectory.segments) if t_s is not None]
    assert times or place == pytest.approx(target)
    for t_s in times:
        assert trajectory.position(t_s) == pytest.approx(place, abs=1e-5)
