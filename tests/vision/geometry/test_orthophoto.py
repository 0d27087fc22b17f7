"""A tilted plane made straight again: its grid is square, and its pixels are where OpenCV's warp has them."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vision.geometry.camera_model import Extrinsics, Intrinsics, back_project, project
from vision.geometry.frames import rotation
from vision.geometry.orthophoto import Orthophoto, make_orthophoto, plane_homography
from vision.geometry.similarity import fit_similarity

CALM = settings(max_examples=100, deadline=None, derandomize=True)
CAMERA = Intrinsics(1400.0, 1390.0, 399.5, 299.5)
# 40 degrees oblique and turned, about 12 um per px in the middle.
TILTED = Extrinsics(215.0, 12.0, 25.0, 60.0, -40.0, 17000.0)
PITCH_UM, DOT_UM = 500.0, 45.0
AREA_UM, SCALE = (-2000.0, -1500.0, 4000.0, 3000.0), 0.1
Z_UM = 35.0


def _dots(extrinsics: Extrinsics) -> np.ndarray:
    """A frame of a grid of soft dots on the plane at Z_UM, each pixel the mean of 3 x 3 rays."""
    frame = np.zeros((600, 800))
    rows, columns = np.mgrid[0:600, 0:800]
    homography = np.linalg.inv(plane_homography(CAMERA, extrinsics, Z_UM))
    for dx in (-1 / 3, 0, 1 / 3):
        for dy in (-1 / 3, 0, 1 / 3):
            q = np.stack([columns + dx, rows + dy, np.ones_like(rows)], axis=-1) @ homography.T
            place = q[..., :2] / q[..., 2:]
            off = place - PITCH_UM * np.round(place / PITCH_UM)
            frame += np.exp(-0.5 * (off**2).sum(axis=-1) / DOT_UM**2) / 9
    gray = np.round(20 + 200 * frame).astype(np.uint8)
    return np.ascontiguousarray(np.broadcast_to(gray[..., None], (600, 800, 3)))


def _centre(photo: Orthophoto, near_px: np.ndarray) -> np.ndarray:
    """The centroid of the dot round a pixel."""
    column, row = np.round(near_px).astype(int)
    weight = np.clip(photo.picture[row - 18 : row + 19, column - 18 : column + 19, 0].astype(float) - 22, 0, None)
    ys, xs = np.mgrid[-18:19, -18:19]
    return np.array([column + (weight * xs).sum() / weight.sum(), row + (weight * ys).sum() / weight.sum()])


def _grid(photo: Orthophoto) -> tuple[np.ndarray, np.ndarray]:
    places = np.array([(i * PITCH_UM, j * PITCH_UM) for i in range(-3, 4) for j in range(-2, 3)])
    return places, np.array([_centre(photo, photo.to_px(place)) for place in places])


def test_a_tilted_grid_becomes_square_to_a_fiftieth_of_a_pixel() -> None:
    photo = make_orthophoto(_dots(TILTED), CAMERA, TILTED, AREA_UM, SCALE, Z_UM)
    assert photo.picture.shape == (301, 401, 3)
    places, centres = _grid(photo)
    assert np.abs(centres - photo.to_px(places)).max() < 0.02
    # Square whatever its place and turn: eq. 3.23 leaves nothing, and its scale is that of the photo.
    fit = fit_similarity(centres * (1, -1), places)
    assert fit.rms * SCALE < 0.02
    assert 1 / fit.scale == pytest.approx(SCALE, rel=2e-4)
    assert fit.theta_deg == pytest.approx(0.0, abs=0.01)


def test_a_wrong_tilt_leaves_the_grid_askew() -> None:
    """Half a degree off shows: the test above measures the tilt and not its own tolerance."""
    askew = Extrinsics(215.5, 12.0, 25.0, 60.0, -40.0, 17000.0)
    places, centres = _grid(make_orthophoto(_dots(TILTED), CAMERA, askew, AREA_UM, SCALE, Z_UM))
    assert fit_similarity(centres * (1, -1), places).rms * SCALE > 0.2


def test_a_rigid_transformation_alone_regenerates_nothing() -> None:
    """The thesis' "2D rigid transformation" (eq. 3.23), laid on the oblique picture itself, is off by 10 px."""
    places = np.array([(i * PITCH_UM, j * PITCH_UM, 0) for i in range(-3, 4) for j in range(-2, 3)])
    fit = fit_similarity(project(places, CAMERA, TILTED) * (1, -1), places[:, :2])
    assert fit.rms / fit.scale > 5.0


def test_it_is_opencv_s_warp_of_the_four_corners() -> None:
    frame = _dots(TILTED)
    photo = make_orthophoto(frame, CAMERA, TILTED, AREA_UM, SCALE, Z_UM)
    corners = np.array([(0, 0), (400, 0), (400, 300), (0, 300)], dtype=np.float32)
    world = np.c_[photo.to_um(corners), np.full(4, Z_UM)]
    source = project(world, CAMERA, TILTED).astype(np.float32)
    theirs = cv2.warpPerspective(frame, cv2.getPerspectiveTransform(source, corners), (401, 301))
    assert np.abs(photo.picture.astype(int) - theirs).max() <= 1


def test_a_camera_that_looks_square_on_gives_its_own_pixels_back() -> None:
    frame = np.random.default_rng(0).integers(0, 256, (600, 800, 3), dtype=np.uint8)
    camera, above = Intrinsics(1000.0, 1000.0, 399.5, 299.5), Extrinsics(180.0, 0.0, 0.0, 0.0, 0.0, 10000.0)
    photo = make_orthophoto(frame, camera, above, (-2995.0, -1995.0, 4000.0, 3000.0), 0.1)
    # (-2995, 1005) is pixel (100, 199): 10 um per px, y up.
    assert photo.origin_um == (-2995.0, 1005.0)
    assert np.abs(photo.picture.astype(int) - frame[199:500, 100:501]).max() <= 1
    assert photo.seen.all()


def test_what_the_camera_did_not_see_is_marked() -> None:
    photo = make_orthophoto(_dots(TILTED), CAMERA, TILTED, (-8000.0, -2000.0, 16000.0, 4000.0), 0.02)
    rows, columns = np.nonzero(photo.seen)
    world = np.c_[photo.to_um(np.c_[columns, rows]), np.zeros(len(rows))]
    source = project(world, CAMERA, TILTED)
    assert (source > -0.1).all()
    assert (source < (799.1, 599.1)).all()
    assert 0.1 < photo.seen.mean() < 0.9
    assert not photo.picture[0, 0].any()


@CALM
@given(st.floats(-3000, 3000), st.floats(-3000, 3000), st.floats(-200, 200))
def test_the_homography_is_the_projection_of_the_plane(x: float, y: float, z: float) -> None:
    q = plane_homography(CAMERA, TILTED, z) @ (x, y, 1.0)
    pixel = project((x, y, z), CAMERA, TILTED)
    assert q[:2] / q[2] == pytest.approx(pixel, abs=1e-6)
    assert q[2] == pytest.approx(TILTED.to_camera_um((x, y, z))[2])
    assert back_project(project((x, y, 0.0), CAMERA, TILTED), CAMERA, TILTED) == pytest.approx((x, y, 0.0), abs=1e-6)


@CALM
@given(st.floats(-180, 180), st.floats(0.5, 2.0), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
def test_a_similarity_is_found_exactly(theta: float, scale: float, tx: float, ty: float) -> None:
    points = np.array([(0.0, 0.0), (3000.0, 100.0), (-500.0, 2500.0)]) + 7000.0
    targets = points @ rotation(theta).T * scale + (tx, ty)
    fit = fit_similarity(points, targets)
    assert fit.apply(points) == pytest.approx(targets, abs=1e-6)
    assert fit.scale == pytest.approx(scale)
    assert math.cos(math.radians(fit.theta_deg - theta)) == pytest.approx(1.0)
    assert fit.rms < 1e-6


@CALM
@given(st.tuples(*[st.floats()] * 4), st.floats(), st.floats(), st.tuples(*[st.floats()] * 6))
def test_any_numbers_give_a_value_error_or_a_picture(
    area: tuple[float, float, float, float], scale: float, z: float, pose: tuple[float, ...]
) -> None:
    frame = np.full((6, 8, 3), 9, np.uint8)
    for call in (
        lambda: make_orthophoto(frame, CAMERA, TILTED, area, scale, z).origin_um,
        lambda: make_orthophoto(frame, CAMERA, Extrinsics(*pose), (0.0, 0.0, 10.0, 10.0), 1.0, z).origin_um,
        lambda: fit_similarity([area[:2], area[2:]], [(scale, z), (z, scale)]).apply((1.0, 2.0)),
    ):
        try:
            found = call()
        except ValueError:
            continue
        assert np.isfinite(found).all()


def test_what_makes_no_orthophoto_is_refused() -> None:
    frame = np.zeros((600, 800, 3), np.uint8)
    with pytest.raises(ValueError, match="expected"):
        make_orthophoto(frame[..., 0], CAMERA, TILTED, AREA_UM, SCALE)
    with pytest.raises(ValueError, match="positive"):
        make_orthophoto(frame, CAMERA, TILTED, (0.0, 0.0, -1.0, 5.0), SCALE)
    with pytest.raises(ValueError, match="too many"):
        make_orthophoto(frame, CAMERA, TILTED, AREA_UM, 100.0)
    with pytest.raises(ValueError, match="behind"):
        make_orthophoto(frame, CAMERA, TILTED, (-1e6, -1e6, 2e6, 2e6), 0.001)
    with pytest.raises(ValueError, match="does not see"):
        make_orthophoto(frame, CAMERA, TILTED, (20000.0, 0.0, 100.0, 100.0), SCALE)
    with pytest.raises(ValueError, match="pairs"):
        fit_similarity([(0, 0)], [(0, 0)])
    with pytest.raises(ValueError, match="differ"):
        fit_similarity([(5, 5), (5, 5)], [(0, 0), (1, 1)])
