"""The plant and the pictures agree about where the board is: each side works it out for itself."""

import numpy as np
import pytest

from sim_hw.board.board import ROBOT_ORIGIN_UM
from sim_hw.plant.pose import ORIGIN_UM
from sim_hw.scene.optics import board_plane
from tests.sim_hw.rig import make_plant


def test_both_halves_put_the_board_in_the_same_place() -> None:
    plant = make_plant(seed=8, board_rotation_deg=0.2, board_tilt_x_um_per_mm=3.0, board_tilt_y_um_per_mm=-2.0)
    pose, centre_um = plant.board_pose, plant.placement.centre_um
    assert ROBOT_ORIGIN_UM == ORIGIN_UM
    plane = board_plane(ORIGIN_UM, (80.0, 50.0), pose)
    for x_mm, y_mm in ((0.0, 0.0), (80.0, 0.0), (33.3, 48.5)):
        x_um, y_um, z_um = plane @ np.array([x_mm, y_mm, 1.0])
        place_um = plant.to_real_um(x_mm, y_mm)
        assert (x_um, y_um) == pytest.approx(place_um, abs=1e-6)
        assert z_um == pytest.approx(pose.height_um(place_um, centre_um), abs=1e-3)
