"""The board in its nest: displaced, turned, gone, lifted and laid in again, with parts on it."""

import math

import pytest

from sim_hw.plant.pose import NEST_DEPTH_UM, Placement
from tests.sim_hw.rig import make_plant

CENTRE_MM = (40.0, 25.0)


def test_a_displaced_board_lies_that_much_farther_off_until_it_is_put_right() -> None:
    plant = make_plant(seed=3)
    before = plant.to_real_um(*CENTRE_MM)
    plant.faults.switch("board_displaced", on=True, dx_um=450.0, dy_um=-120.0)
    assert plant.to_real_um(*CENTRE_MM) == pytest.approx((before[0] + 450.0, before[1] - 120.0))
    plant.faults.switch("board_displaced", on=False)
    assert plant.to_real_um(*CENTRE_MM) == before


@pytest.mark.parametrize("turn_deg", [90.0, 180.0, 270.0])
def test_a_turned_board_lies_turned_about_its_middle(turn_deg: float) -> None:
    plant = make_plant(seed=3, board_rotation_deg=0.0)
    middle, right = plant.to_real_um(*CENTRE_MM), plant.to_real_um(50.0, 25.0)
    plant.faults.switch("board_turned", on=True, turn_deg=turn_deg)
    assert plant.to_real_um(*CENTRE_MM) == pytest.approx(middle)
    x_um, y_um = plant.to_real_um(50.0, 25.0)
    assert math.degrees(math.atan2(y_um - middle[1], x_um - middle[0])) % 360.0 == pytest.approx(turn_deg, abs=1e-6)
    assert math.hypot(x_um - middle[0], y_um - middle[1]) == pytest.approx(right[0] - middle[0])


def test_a_knob_turned_meanwhile_does_not_put_a_displaced_board_right() -> None:
    plant = make_plant(seed=3)
    plant.faults.switch("board_displaced", on=True, dx_um=450.0)
    lies = plant.to_real_um(*CENTRE_MM)
    plant.set_knob("lamp_rise_s", 0.01)
    assert plant.to_real_um(*CENTRE_MM) == lies


def test_a_board_that_is_gone_leaves_the_floor_of_the_nest() -> None:
    plant = make_plant(seed=3)
    place = plant.to_real_um(*CENTRE_MM)
    surface_um = plant.surface_um(place)
    plant.faults.switch("board_gone", on=True)
    assert plant.surface_um(place) == pytest.approx(surface_um - NEST_DEPTH_UM)


def test_each_laying_in_draws_another_pose_and_the_same_again_for_the_same_seed() -> None:
    poses = []
    for _ in range(2):
        plant = make_plant(seed=3)
        poses.append([plant.board_pose])
        for _ in range(3):
            plant.seat_board(Placement(0.0, 0.0, 60.0, 50.0, "bottom"))
            poses[-1].append(plant.board_pose)
    assert poses[0] == poses[1]
    assert len({pose.dx_um for pose in poses[0]}) == 4


def test_the_pin_is_pushed_in_by_the_part_it_stands_on() -> None:
    plant = make_plant(seed=3, z_start_um=5_400.0, board_dz_um=0.0)
    assert plant.state_at(0.0).pressed_um == 0.0
    plant.relief_um = lambda _x_mm, _y_mm: 700.0
    state = plant.state_at(0.0)
    assert state.pressed_um == pytest.approx(300.0, abs=30.0)
    assert state.tip_height_um == pytest.approx(0.0)
