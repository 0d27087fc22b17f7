"""The truth is a function of seed, knobs and orders alone."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_hw.plant.knobs import Knobs
from sim_hw.plant.plant import BoardPose, Placement
from sim_hw.plant.runout import tip_offset_um
from tests.sim_hw.rig import Rig, make_plant


def scripted(seed: int, polls: int) -> list[tuple[float, ...]]:
    """Home and move one axis while asking `polls` times per 10 ms; return the truth along the way."""
    rig = Rig(seed=seed)
    rig.home(21)
    rig.t_s = 20.0
    rig.ramps()
    rig.enable(1)
    rig.order(30_000.0)
    truth = []
    for _ in range(200):
        for part in range(polls):
            rig.t_s += 0.01 / polls
            if part < polls - 1:
                rig.status()
        state = rig.plant.state_at(rig.t_s)
        truth.append((round(state.x_um, 6), round(state.tip_x_um, 6), state.tip_height_um))
    return truth


def test_the_same_seed_gives_the_same_truth_however_often_it_is_asked() -> None:
    first = scripted(5, 1)
    assert scripted(5, 1) == first
    assert [row[0] for row in scripted(5, 4)] == pytest.approx([row[0] for row in first], abs=1e-5)
    assert scripted(6, 1) != first


def test_power_up_places_are_where_a_station_is_left() -> None:
    for seed in range(50):
        state = make_plant(seed).state_at(0.0)
        assert 5_000.0 <= state.x_um <= 15_000.0
        assert 5_000.0 <= state.y_um <= 15_000.0
        assert state.tip_height_um > 10_000.0
        assert not 100.0 < state.theta_deg < 140.0
        assert (state.white, state.red, state.moving) == (0.0, 0.0, False)


def test_the_tip_is_under_the_head_with_its_runout() -> None:
    plant = make_plant(theta_start_deg=-90.0, x_start_um=70_000.0, y_start_um=60_000.0)
    state = plant.state_at(0.0)
    dx_um, dy_um = tip_offset_um(270.0)
    assert (state.tip_x_um, state.tip_y_um) == pytest.approx((70_000.0 + dx_um, 60_000.0 + dy_um))


def test_the_tip_height_counts_from_the_real_board() -> None:
    plant = make_plant(z_start_um=5_200.0, board_dz_um=30.0, board_tilt_x_um_per_mm=2.0, board_tilt_y_um_per_mm=0.0)
    state = plant.state_at(0.0)
    centre_x_um, _ = plant.placement.centre_um
    expected = 200.0 - 30.0 - 2.0 * (state.tip_x_um - centre_x_um) / 1000.0
    assert state.tip_height_um == pytest.approx(expected)


def test_board_poses_stay_within_their_knobs_and_vary() -> None:
    poses = [BoardPose.drawn(Knobs(), seed) for seed in range(300)]
    assert max(math.hypot(pose.dx_um, pose.dy_um) for pose in poses) <= 200.0
    assert max(abs(pose.rotation_deg) for pose in poses) <= 0.2
    assert 12.0 < math.sqrt(sum(pose.dz_um**2 for pose in poses) / 300.0) < 18.0
    assert len({pose.dx_um for pose in poses}) == 300


def test_one_board_knob_leaves_the_rest_of_the_pose() -> None:
    plant = make_plant(seed=9)
    before = plant.board_pose
    plant.set_knob("board_dx_um", 12.5)
    assert plant.board_pose.dx_um == 12.5
    assert plant.board_pose.dy_um == before.dy_um
    plant.set_knob("board_dx_um", None)
    assert plant.board_pose == before


def test_the_bottom_is_turned_about_its_own_vertical_axis() -> None:
    top, bottom = Placement(1.0, 2.0, 81.0, 52.0), Placement(1.0, 2.0, 81.0, 52.0, "bottom")
    assert top.to_robot_um(11.0, 22.0) == (70_000.0, 60_000.0)
    assert bottom.to_robot_um(11.0, 22.0) == (130_000.0, 60_000.0)
    assert top.centre_um == bottom.centre_um == (100_000.0, 65_000.0)


def test_a_turned_board_turns_about_its_centre_counter_clockwise() -> None:
    plant = make_plant(board_dx_um=0.0, board_dy_um=0.0, board_rotation_deg=0.1)
    assert plant.to_real_um(40.0, 25.0) == pytest.approx((100_000.0, 65_000.0))
    x_um, y_um = plant.to_real_um(80.0, 25.0)
    assert y_um - 65_000.0 == pytest.approx(40_000.0 * math.sin(math.radians(0.1)))
    assert x_um < 140_000.0


@given(x_mm=st.floats(0, 80), y_mm=st.floats(0, 50), seed=st.integers(0, 1000))
def test_to_cad_undoes_to_real(x_mm: float, y_mm: float, seed: int) -> None:
    plant = make_plant(seed)
    assert plant.to_cad_mm(*plant.to_real_um(x_mm, y_mm)) == pytest.approx((x_mm, y_mm), abs=1e-9)
