import math

import numpy as np
import pytest

from sim_hw.scene.optics import NEEDLE_DIRECTION, TIP_PX, Stand, board_plane, make_optics
from tests.sim_hw.scene_double import FakePose

OPTICS = make_optics()
ORIGIN_UM, SIZE_MM = (60_000.0, 40_000.0), (40.0, 30.0)


def test_the_tip_falls_where_it_should_and_the_needle_runs_where_it_should() -> None:
    end, above = OPTICS.project([[0.0, 0.0, 0.0], [0.0, 0.0, 3000.0]])
    assert end == pytest.approx(TIP_PX, abs=1e-6)
    direction = (end - above) / np.linalg.norm(end - above)
    assert direction == pytest.approx((119 / 260.74, 232 / 260.74), abs=1e-3)
    assert math.hypot(*NEEDLE_DIRECTION) == pytest.approx(1.0, abs=1e-3)


def test_the_axis_leans_30_degrees_and_the_camera_frame_is_right_handed() -> None:
    right, below, axis = OPTICS.rotation
    assert -axis[2] == pytest.approx(math.cos(math.radians(30.0)))
    assert np.cross(right, below) == pytest.approx(axis)
    assert OPTICS.rotation @ OPTICS.rotation.T == pytest.approx(np.eye(3), abs=1e-12)


def test_one_pixel_is_12_um_across_the_view_and_more_along_it() -> None:
    axis = OPTICS.rotation[2]
    away = np.array([axis[0], axis[1], 0.0]) / math.hypot(axis[0], axis[1])
    across = np.array([-away[1], away[0], 0.0])
    end, aside, far = OPTICS.project([[0, 0, 0], 120.0 * across, 120.0 * away])
    assert np.linalg.norm(aside - end) == pytest.approx(10.0, abs=0.1)
    assert np.linalg.norm(far - end) == pytest.approx(10.0 * math.cos(math.radians(30.0)), abs=0.35)


def test_image_right_is_about_plus_x_and_image_up_about_plus_y_of_the_head() -> None:
    end, x, y = OPTICS.project([[0, 0, 0], [1000.0, 0, 0], [0, 1000.0, 0]])
    assert (x - end)[0] > 70.0
    assert (y - end)[1] < -60.0


def test_a_point_200_um_below_the_tip_appears_8_px_further_along_the_needle() -> None:
    end, below = OPTICS.project([[0, 0, 0], [0, 0, -200.0]])
    assert float((below - end) @ NEEDLE_DIRECTION) == pytest.approx(8.5, abs=0.4)


@pytest.mark.parametrize("theta_deg", [0.0, 77.0, 200.0, 359.0])
def test_the_homography_is_the_pinhole_model_written_out_point_by_point(theta_deg: float) -> None:
    pose = FakePose(150.0, -90.0, 0.7, 40.0, 0.8, -0.5)
    tip_um = (75_000.0, 52_000.0, 230.0)
    matrix = OPTICS.homography(board_plane(ORIGIN_UM, SIZE_MM, pose), Stand(tip_um, theta_deg))
    for u_mm, v_mm in ((0.0, 0.0), (40.0, 0.0), (13.3, 27.1), (20.0, 15.0)):
        turn, back = math.radians(0.7), -math.radians(theta_deg)
        x, y = u_mm * 1e3 - 20_000.0, v_mm * 1e3 - 15_000.0
        robot_x = 80_000.0 + math.cos(turn) * x - math.sin(turn) * y + 150.0
        robot_y = 55_000.0 + math.sin(turn) * x + math.cos(turn) * y - 90.0
        robot_z = 40.0 + 0.8 * (robot_x - 80_000.0) / 1e3 - 0.5 * (robot_y - 55_000.0) / 1e3
        dx, dy = robot_x - tip_um[0], robot_y - tip_um[1]
        head = (
            math.cos(back) * dx - math.sin(back) * dy,
            math.sin(back) * dx + math.cos(back) * dy,
            robot_z - tip_um[2],
        )
        seen = matrix @ (u_mm, v_mm, 1.0)
        assert seen[:2] / seen[2] == pytest.approx(OPTICS.project([head])[0], abs=1e-6)
