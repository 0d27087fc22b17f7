"""The thesis' camera (ch. 3) with the numbers of its text, and the way back from pixels."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from vision.geometry.camera_model import (
    Extrinsics,
    Intrinsics,
    Plane,
    Ray,
    back_project,
    check_points,
    focal_px,
    intersect,
    pixel_ray,
    project,
    view_angle_deg,
    view_angle_from_target_deg,
)

CALM = settings(max_examples=150, deadline=None, derandomize=True)
# Eq. 3.25, one square of the model for one um.
MODEL = np.array([[0, 11, 9], [0, 3, 9], [3, 0, 9], [0, 11, 2], [0, 3, 2], [3, 0, 2]], dtype=float)
M_EXT = np.array(
    [
        [0.7403, -0.6702, -0.0535, 4.2125],
        [-0.2788, -0.2336, -0.9315, 6.7617],
        [0.6118, 0.7045, -0.3598, 23.6748],
    ]
)  # eq. 3.29
PRINTED = np.array(
    [
        [38073, 53747, 74457, 44992, 60666, 81375],
        [21212, 22151, 21053, 57760, 58700, 57601],
        [28.18, 22.54, 22.27, 30.70, 25.06, 24.79],
    ]
)  # eq. 3.30
THESIS_K = Intrinsics(5026.0, 2806.0, 2000.0, 1500.0)  # eq. 3.28
USED_K = Intrinsics(5026.0, 5026.0, 2000.0, 1500.0)  # what eq. 3.30 was computed with

angles = st.floats(-180.0, 180.0)
small = st.floats(-2000.0, 2000.0)
poses = st.builds(Extrinsics, angles, angles, angles, small, small, st.floats(1e4, 1e5))
cameras = st.builds(
    Intrinsics, st.floats(300.0, 9000.0), st.floats(300.0, 9000.0), st.floats(-100.0, 3000.0), st.floats(-100.0, 3000.0)
)


def _thesis_pose() -> Extrinsics:
    """Eq. 3.29 as angles; its four digits make it a rotation to 1e-4 only, so the nearest one is taken."""
    u, _, vt = np.linalg.svd(M_EXT[:, :3])
    return Extrinsics.from_matrix(u @ vt, M_EXT[:, 3])


def test_the_printed_focal_lengths_have_the_two_view_angles_swapped() -> None:
    """Eq. 3.26 and 3.27 as printed, and put right: square pixels have one focal length."""
    assert focal_px(4000, 43.4) == pytest.approx(5026, abs=0.5)
    assert focal_px(3000, 56.26) == pytest.approx(2806, abs=0.5)
    right = Intrinsics.from_view((4000, 3000), (56.26, 43.4))
    assert (right.fx_px, right.fy_px) == pytest.approx((3741, 3769), abs=0.5)
    assert (right.cx_px, right.cy_px) == (1999.5, 1499.5)
    assert right.fx_px == pytest.approx(right.fy_px, rel=0.01)
    assert focal_px(4000, 56.2) == pytest.approx(3746, abs=0.5)


def test_a_view_angle_is_of_the_whole_sensor() -> None:
    """The thesis prints alpha = 2 atan(d / f): for its own example that is 94 degrees, not 56."""
    assert view_angle_deg(4000, focal_px(4000, 56.26)) == pytest.approx(56.26)
    assert math.degrees(2 * math.atan(4000 / focal_px(4000, 56.26))) == pytest.approx(93.8, abs=0.1)
    assert view_angle_deg(36.0, 50.0) == pytest.approx(39.6, abs=0.05)


def test_a_target_seen_square_on_tells_the_view_angle() -> None:
    camera = Intrinsics(3741.0, 3741.0, 1999.5, 1499.5)
    ends = project([[-9e4, 0, 0], [9e4, 0, 0]], camera, Extrinsics(0, 0, 0, 0, 0, 4e5))
    seen_px = float(np.linalg.norm(ends[1] - ends[0]))
    assert view_angle_from_target_deg(1.8e5, seen_px, 4000, 4e5) == pytest.approx(view_angle_deg(4000, 3741.0))


def test_a_sensor_and_a_lens_make_a_camera() -> None:
    camera = Intrinsics.from_sensor(4.0, (2.8, 3.0), (1600, 1200))
    assert (camera.fx_px, camera.fy_px) == pytest.approx((4000 / 2.8, 4000 / 3.0))
    assert (camera.cx_px, camera.cy_px) == (799.5, 599.5)
    assert camera.matrix == pytest.approx(np.array([[4000 / 2.8, 0, 799.5], [0, 4000 / 3, 599.5], [0, 0, 1]]))


def test_the_thesis_example_as_printed() -> None:
    """Eq. 3.29 and 3.30, to the digits printed: four of M_ext make +-1e-4 x 5026 x 12, that is 6, of x_1 and x_2."""
    pose = _thesis_pose()
    radians = [math.radians(a) for a in (pose.theta_x_deg, pose.theta_y_deg, pose.theta_z_deg)]
    assert radians == pytest.approx([2.04, -0.65, -0.36], abs=0.0085)
    assert pose.matrix == pytest.approx(M_EXT, abs=1e-4)
    pixels = project(MODEL, USED_K, pose)
    depth = pose.to_camera_um(MODEL)[:, 2]
    homogeneous = np.c_[pixels * depth[:, None], depth].T
    assert homogeneous[:2] == pytest.approx(PRINTED[:2], abs=6.0)
    assert homogeneous[2] == pytest.approx(PRINTED[2], abs=0.012)
    assert pixels == pytest.approx((PRINTED[:2] / PRINTED[2]).T, abs=1.2)


def test_the_thesis_example_does_not_use_the_k_it_prints() -> None:
    """Its second row needs f_y = 5026, not the 2806 of eq. 3.28; and its first pixel is 1351, not 1360."""
    rows = THESIS_K.matrix @ M_EXT @ np.c_[MODEL, np.ones(6)].T
    assert rows[0] == pytest.approx(PRINTED[0], abs=6.0)
    assert np.abs(rows[1] - PRINTED[1]).min() > 5000
    needed = (PRINTED[1] - 1500 * PRINTED[2]) / (M_EXT[1] @ np.c_[MODEL, np.ones(6)].T)
    assert needed == pytest.approx([5026] * 6, rel=0.002)
    assert PRINTED[:2, 0] / PRINTED[2, 0] == pytest.approx((1351, 753), abs=0.5)


def test_angles_are_turned_in_the_thesis_order_about_the_camera_s_axes() -> None:
    """Eq. 3.11: R = Rz Ry Rx, each the right-handed turn that cv2.Rodrigues draws."""
    pose = Extrinsics(20.0, -35.0, 110.0, 0, 0, 1)
    parts = [cv2.Rodrigues(np.radians(a) * axis)[0] for a, axis in zip((20.0, -35.0, 110.0), np.eye(3), strict=True)]
    assert pose.rotation == pytest.approx(parts[2] @ parts[1] @ parts[0])
    assert pose.centre_um == pytest.approx(-pose.rotation.T @ (0, 0, 1))


@CALM
@given(angles, st.one_of(angles, st.sampled_from([90.0, -90.0, 90.0 - 1e-9, -90.0 + 1e-7])), angles)
def test_a_rotation_survives_its_angles_even_at_the_singular_tilt(x: float, y: float, z: float) -> None:
    r = Extrinsics(x, y, z, 1.0, 2.0, 3.0).rotation
    again = Extrinsics.from_matrix(r, (1.0, 2.0, 3.0))
    assert again.rotation == pytest.approx(r, abs=1e-14)
    assert abs(again.theta_y_deg) <= 90.0 + 1e-9


@CALM
@given(poses, cameras, st.lists(st.tuples(small, small, small), min_size=1, max_size=5))
def test_projection_is_opencv_s(pose: Extrinsics, camera: Intrinsics, points: list[tuple[float, float, float]]) -> None:
    rvec = cv2.Rodrigues(pose.rotation)[0]
    expected = cv2.projectPoints(np.array(points), rvec, pose.translation_um, camera.matrix, None)[0].reshape(-1, 2)
    assert project(points, camera, pose) == pytest.approx(expected, abs=1e-6)
    assert project(points[0], camera, pose) == pytest.approx(expected[0], abs=1e-6)


@CALM
@given(poses, cameras, small, small, angles, st.floats(0, 80), small)
def test_back_projection_undoes_projection(
    pose: Extrinsics, camera: Intrinsics, u: float, v: float, turn: float, tilt: float, offset: float
) -> None:
    """A point on any plane that is not seen edge-on comes back to itself."""
    a, b = math.radians(turn), math.radians(tilt)
    plane = Plane((math.sin(b) * math.cos(a), math.sin(b) * math.sin(a), math.cos(b)), offset)
    normal = np.array(plane.normal)
    across = np.cross(normal, (0.3, -0.5, 0.8))
    point = normal * offset + across * u + np.cross(normal, across) * v
    sight = point - pose.centre_um
    assume(abs(sight @ normal) > 0.02 * np.linalg.norm(sight) and pose.to_camera_um(point)[2] > 100.0)
    pixel = project(point, camera, pose)
    back = back_project(pixel, camera, pose, plane)
    assert back == pytest.approx(point, abs=1e-6 * np.linalg.norm(sight))
    assert project(back, camera, pose) == pytest.approx(pixel, abs=1e-6 * max(1.0, float(np.abs(pixel).max())))


@CALM
@given(st.tuples(*[st.floats()] * 3), st.tuples(*[st.floats()] * 2), st.tuples(*[st.floats()] * 6), st.floats())
def test_any_numbers_give_a_value_error_or_finite_numbers(
    point: tuple[float, ...], pixel: tuple[float, ...], pose: tuple[float, ...], f: float
) -> None:
    calls = (
        lambda: project(point, Intrinsics(f, 1.0, *pixel), Extrinsics(*pose)),
        lambda: back_project(pixel, Intrinsics(f, f, 0.0, 0.0), Extrinsics(*pose)),
        lambda: back_project(pixel, Intrinsics(1e3, 1e3, 0.0, 0.0), Extrinsics(0, 0, 0, 0, 0, 1), Plane(point, f)),
        lambda: np.array([focal_px(f, pose[0]), view_angle_deg(f, pose[1])]),
    )
    for call in calls:
        try:
            found = call()
        except ValueError:
            continue
        assert np.isfinite(found).all()


@pytest.mark.parametrize(
    "bad",
    [None, "abc", [[1, 2]], [1, 2], [[1, 2, 3, 4]], np.zeros((2, 2, 3)), [[1, 2, np.nan]], [[1, 2], [3]], [1j, 2, 3],
     [True, False, True], {"x": 1}],
)  # fmt: skip
def test_points_of_another_shape_or_type_are_a_value_error(bad: object) -> None:
    with pytest.raises(ValueError, match="points_um"):
        check_points(bad, "points_um", 3)


def test_a_camera_that_cannot_be_is_refused() -> None:
    for bad in (0.0, -5.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="fx_px"):
            Intrinsics(bad, 1000.0, 0.0, 0.0)
        with pytest.raises(ValueError, match="view_deg"):
            focal_px(1600, bad)
        with pytest.raises(ValueError, match="focal_mm"):
            Intrinsics.from_sensor(bad, (2.8, 2.8), (1600, 1200))
    with pytest.raises(ValueError, match="180"):
        focal_px(1600, 180.0)
    with pytest.raises(ValueError, match="tz_um"):
        Extrinsics(0, 0, 0, 0, 0, math.nan)
    with pytest.raises(ValueError, match="theta_x_deg"):
        Extrinsics("20", 0, 0, 0, 0, 1)  # type: ignore[arg-type]


def test_what_is_no_rotation_is_refused() -> None:
    for bad in (np.eye(3) * 1.1, np.diag([1.0, 1.0, -1.0]), np.zeros((3, 3))):
        with pytest.raises(ValueError, match="no rotation"):
            Extrinsics.from_matrix(bad, (0, 0, 1))
    with pytest.raises(ValueError, match="rotation"):
        Extrinsics.from_matrix(np.ones((2, 3)), (0, 0, 1))


def test_what_lies_behind_the_camera_has_no_pixel_and_no_place() -> None:
    camera, pose = Intrinsics(1000, 1000, 0, 0), Extrinsics(180, 0, 0, 0, 0, 1000)
    with pytest.raises(ValueError, match="behind"):
        project([[0, 0, 0], [0, 0, 1001.0]], camera, pose)
    with pytest.raises(ValueError, match="plane"):
        back_project((0, 0), camera, pose, Plane((0, 0, 1), 1500.0))
    with pytest.raises(ValueError, match="plane"):
        back_project((0, 0), camera, pose, Plane((1, 0, 0), 10.0))
    with pytest.raises(ValueError, match="normal"):
        Plane((0.0, 0.0, 0.0))


def test_a_ray_starts_at_the_camera_and_passes_the_point() -> None:
    camera, pose = Intrinsics(1400, 1410, 799.5, 599.5), Extrinsics(170, 12, -30, 100, -50, 20000)
    point = np.array([500.0, -700.0, 33.0])
    ray = pixel_ray(project(point, camera, pose), camera, pose)
    assert np.linalg.norm(ray.direction) == pytest.approx(1.0)
    assert np.cross(ray.direction, point - ray.origin_um) == pytest.approx(np.zeros(3), abs=1e-6)
    assert ray.direction @ (point - ray.origin_um) > 0
    met = intersect(Ray(ray.origin_um, ray.direction), Plane((0, 0, 2.0), 33.0))
    assert met == pytest.approx(point)
