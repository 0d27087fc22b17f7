"""The camera's pose from known points (appendix A): the thesis' example, OpenCV's answer, and an honest covariance."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.vision.geometry.test_camera_model import M_EXT, MODEL, PRINTED, THESIS_K, USED_K
from vision.geometry.camera_model import Extrinsics, Intrinsics, project
from vision.geometry.extrinsics import ExtrinsicsFit, fit_extrinsics, jacobian_px

CALM = settings(max_examples=100, deadline=None, derandomize=True)
CAMERA = Intrinsics(1430.0, 1425.0, 799.5, 599.5)
PRINTED_PX = (PRINTED[:2] / PRINTED[2]).T
FIELDS = ("theta_x_deg", "theta_y_deg", "theta_z_deg", "tx_um", "ty_um", "tz_um")
SQUARE = np.array([[-4e3, -4e3, 0], [4e3, -4e3, 0], [4e3, 4e3, 0], [-4e3, 4e3, 0]])


def _numbers(pose: Extrinsics) -> np.ndarray:
    return np.array([getattr(pose, name) for name in FIELDS])


def _pose(rng: np.random.Generator) -> Extrinsics:
    """A camera that looks down (+z towards it), tilted by 10 to 60 degrees, turned at will, 15 to 40 mm away."""
    tilt, toward, turn = math.radians(rng.uniform(10, 60)), rng.uniform(0, 2 * math.pi), rng.uniform(-math.pi, math.pi)
    lean = cv2.Rodrigues(tilt * np.array([math.cos(toward), math.sin(toward), 0]))[0]
    r = lean @ cv2.Rodrigues(np.array([0, 0, turn]))[0] @ np.diag([1.0, -1.0, -1.0])
    return Extrinsics.from_matrix(r, np.array([*rng.uniform(-0.15, 0.15, 2), 1.0]) * rng.uniform(15e3, 40e3))


def _points(rng: np.random.Generator, kind: str) -> np.ndarray:
    if kind == "square":
        return SQUARE
    points = rng.uniform(-5e3, 5e3, (6 if kind == "six" else 20, 3))
    points[:, 2] *= {"flat": 0.0, "thin": 0.02}.get(kind, 1.0)
    return points


def _turn_deg(a: Extrinsics, b: Extrinsics) -> np.ndarray:
    """The small turn from b to a about the camera's axes."""
    skew = a.rotation @ b.rotation.T
    return np.degrees([skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1]]) / 2.0


def _distance(fit: ExtrinsicsFit, pose: Extrinsics) -> float:
    """The squared distance from the fit in units of its own covariance."""
    off = np.r_[_turn_deg(pose, fit.extrinsics), pose.translation_um - fit.extrinsics.translation_um]
    return float(off @ np.linalg.solve(fit.turn_covariance, off))


def test_the_thesis_example_is_estimated_from_its_own_pixels() -> None:
    """Eq. 3.30's pixels give eq. 3.29's six numbers; theta_y is printed -0.65, but r_31 = 0.6118 makes it -0.658."""
    fit = fit_extrinsics(MODEL, PRINTED_PX, USED_K)
    found = _numbers(fit.extrinsics) * np.r_[np.full(3, math.pi / 180), np.ones(3)]
    assert found == pytest.approx([2.04, -0.658, -0.36, 4.2125, 6.7617, 23.6748], abs=0.006)
    assert fit.extrinsics.matrix == pytest.approx(M_EXT, abs=0.006)
    assert fit.rms_px < 0.5


def test_the_printed_k_cannot_have_made_the_printed_pixels() -> None:
    assert fit_extrinsics(MODEL, PRINTED_PX, THESIS_K).rms_px > 100.0


def test_the_thesis_guess_of_ones_is_behind_the_camera() -> None:
    guess = Extrinsics(*[math.degrees(1.0)] * 3, 1.0, 1.0, 1.0)
    assert guess.to_camera_um(MODEL)[:, 2].min() < 0.0
    with pytest.raises(ValueError, match="no pose"):
        fit_extrinsics(MODEL, PRINTED_PX, USED_K, start=guess)
    farther = Extrinsics(*[math.degrees(1.0)] * 3, 1.0, 1.0, 20.0)
    found = fit_extrinsics(MODEL, PRINTED_PX, USED_K, start=farther)
    assert _numbers(found.extrinsics) == pytest.approx(
        _numbers(fit_extrinsics(MODEL, PRINTED_PX, USED_K).extrinsics), abs=1e-5
    )


def test_the_printed_sign_of_the_residual_walks_uphill() -> None:
    """Appendix A, steps 2 to 5: with dy = y - y0 the step x + dx doubles the error; with y0 - y it removes it."""
    truth = Extrinsics(160, 20, 30, 100, 200, 30000)
    near = Extrinsics(160.5, 19.5, 30.3, 120, 190, 30100)
    points = _points(np.random.default_rng(0), "solid")
    seen, begin = project(points, CAMERA, truth), project(points, CAMERA, near)
    pinv = np.linalg.pinv(jacobian_px(points, CAMERA, near))
    errors = []
    for dy in (begin - seen, seen - begin):
        moved = Extrinsics(*(_numbers(near) + pinv @ dy.ravel()))
        errors.append(np.linalg.norm(project(points, CAMERA, moved) - seen) / np.linalg.norm(begin - seen))
    assert errors[0] > 1.9
    assert errors[1] < 0.05


def test_the_jacobian_is_what_the_differences_of_eq_a9_tend_to() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        pose, points = _pose(rng), _points(rng, "six")
        analytic = jacobian_px(points, CAMERA, pose)
        for column, step in enumerate([1e-4] * 3 + [1e-1] * 3):
            shift = np.zeros(6)
            shift[column] = step
            ahead = project(points, CAMERA, Extrinsics(*(_numbers(pose) + shift)))
            back = project(points, CAMERA, Extrinsics(*(_numbers(pose) - shift)))
            assert analytic[:, column] == pytest.approx(((ahead - back) / (2 * step)).ravel(), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("kind", ["flat", "square", "thin", "six", "solid"])
def test_the_pose_is_opencv_s_to_a_thousandth_of_its_sigma(kind: str) -> None:
    """Both minimise the same E; where they differ by more, ours must be the lower minimum."""
    rng = np.random.default_rng(2)
    same = 0
    for _ in range(40):
        pose, points = _pose(rng), _points(rng, kind)
        seen = project(points, CAMERA, pose) + rng.normal(0, 0.2, (len(points), 2))
        fit = fit_extrinsics(points, seen, CAMERA, sigma_px=0.2)
        _, rvec, tvec = cv2.solvePnP(points, seen, CAMERA.matrix, None, flags=cv2.SOLVEPNP_ITERATIVE)
        theirs = Extrinsics.from_matrix(cv2.Rodrigues(rvec)[0], tvec.ravel())
        if _distance(fit, theirs) < 1e-6:
            same += 1
        else:
            assert fit.rms_px**2 * len(points) < ((project(points, CAMERA, theirs) - seen) ** 2).sum()
    assert same >= 38


@pytest.mark.parametrize("kind", ["flat", "square", "six", "solid"])
def test_the_covariance_is_honest(kind: str) -> None:
    """300 noisy views of one pose: squared errors over their covariance have mean 6 and the chi-square's tail."""
    rng = np.random.default_rng(3)
    pose, points, n, sigma = Extrinsics(160, 20, 30, 100, 200, 30000), _points(rng, kind), 300, 0.15
    clean = project(points, CAMERA, pose)
    fits = [fit_extrinsics(points, clean + rng.normal(0, sigma, clean.shape), CAMERA, sigma_px=sigma) for _ in range(n)]
    distances = np.array([_distance(fit, pose) for fit in fits])
    assert distances.mean() == pytest.approx(6.0, abs=4 * math.sqrt(12 / n))
    assert np.mean(distances > 12.592) == pytest.approx(0.05, abs=4 * math.sqrt(0.05 * 0.95 / n))
    # The thesis' six numbers each, by the same measure: a variance from n values is good to sqrt(2 / n).
    off = np.array([_numbers(fit.extrinsics) - _numbers(pose) for fit in fits])
    stated = np.diag(fits[0].covariance)
    assert (off**2).mean(axis=0) / stated == pytest.approx(np.ones(6), abs=5 * math.sqrt(2 / n))
    assert (np.abs(off.mean(axis=0)) < 5 * np.sqrt(stated / n)).all()


def test_the_noise_is_told_by_the_residuals() -> None:
    """Without a given sigma the residuals tell it, unbiased, over 2 N - 6 degrees of freedom."""
    rng = np.random.default_rng(4)
    points = _points(rng, "solid")
    clean = project(points, CAMERA, _pose(rng))
    fits = [fit_extrinsics(points, clean + rng.normal(0, 0.3, clean.shape), CAMERA) for _ in range(100)]
    variance = np.mean([fit.sigma_px**2 for fit in fits])
    assert variance == pytest.approx(0.09, rel=4 * math.sqrt(2 / (100 * (40 - 6))))
    assert fits[0].rms_px == pytest.approx(fits[0].sigma_px * math.sqrt((40 - 6) / 20))


def test_without_noise_the_pose_is_exact() -> None:
    rng = np.random.default_rng(5)
    for kind in ("square", "flat", "six", "thin", "solid"):
        for _ in range(10):
            pose, points = _pose(rng), _points(rng, kind)
            fit = fit_extrinsics(points, project(points, CAMERA, pose), CAMERA)
            assert fit.extrinsics.matrix == pytest.approx(pose.matrix, abs=1e-6, rel=1e-9)


def test_theta_y_of_90_degrees_is_a_pose_like_any_other() -> None:
    pose = Extrinsics(25.0, 90.0, 0.0, 100.0, -200.0, 30000.0)
    points = _points(np.random.default_rng(6), "solid")
    seen = project(points, CAMERA, pose)
    fit = fit_extrinsics(points, seen, CAMERA, sigma_px=0.1)
    assert fit.extrinsics.matrix == pytest.approx(pose.matrix, abs=1e-5)
    assert np.linalg.eigvalsh(fit.turn_covariance).min() > 0.0
    with pytest.raises(ValueError, match="turn_covariance"):
        _ = fit.covariance


def test_a_start_with_the_other_tilt_does_not_end_in_the_wrong_minimum() -> None:
    """From afar a square has a second, higher minimum; the mirrored tilt is always tried."""
    rng = np.random.default_rng(7)
    truth, other = Extrinsics(150, 0, 0, 0, 0, 60000), Extrinsics(210, 0, 0, 0, 0, 60000)
    seen = project(SQUARE, CAMERA, truth) + rng.normal(0, 0.1, (4, 2))
    fit = fit_extrinsics(SQUARE, seen, CAMERA, start=other, sigma_px=0.1)
    assert fit.extrinsics.theta_x_deg == pytest.approx(150, abs=1.0)


def test_two_tilts_that_cannot_be_told_apart_are_refused_and_relief_tells_them() -> None:
    rng = np.random.default_rng(8)
    pose = Extrinsics(150, 0, 0, 0, 0, 1e6)
    flat = np.vstack([SQUARE, SQUARE / 2])
    with pytest.raises(ValueError, match="two tilts"):
        fit_extrinsics(flat, project(flat, CAMERA, pose) + rng.normal(0, 0.1, (8, 2)), CAMERA, sigma_px=0.1)
    solid = np.vstack([SQUARE, SQUARE / 2 + (0, 0, 3000.0)])
    seen = project(solid, CAMERA, pose) + rng.normal(0, 0.1, (8, 2))
    assert fit_extrinsics(solid, seen, CAMERA, sigma_px=0.1).extrinsics.theta_x_deg % 360 == pytest.approx(150, abs=6)


@pytest.mark.parametrize(
    ("points", "word"),
    [
        (SQUARE[:3], "at least 4"),
        (SQUARE[:0], "at least 4"),
        (np.vstack([SQUARE[:3], [(0, 0, 4000)]]), "at least 6"),
        (np.outer(np.arange(8), (1000.0, 500.0, 200.0)), "line"),
        (np.outer(np.arange(8), (1000.0, 500.0, 0.0)) + [[0, 3.0 * (k % 2), 0] for k in range(8)], "line"),
        (np.array([[0, 0, 0], [1e3, 0, 0], [3e3, 0, 0], [500, 2e3, 0]]), "line"),
        (SQUARE[[0, 1, 2, 2]], "same"),
        (np.full((8, 3), 5.0), "one"),
    ],
)
def test_points_that_determine_no_pose_are_refused(points: np.ndarray, word: str) -> None:
    seen = project(points, CAMERA, Extrinsics(160, 20, 30, 100, 200, 30000)) if len(points) else np.zeros((0, 2))
    with pytest.raises(ValueError, match=word):
        fit_extrinsics(points, seen, CAMERA)


def test_a_model_that_is_nearly_a_line_is_refused_one_way_or_another() -> None:
    """Two thousandths as wide as long: the turn about its long axis hardly shows in the picture."""
    rng, refused = np.random.default_rng(9), []
    for _ in range(40):
        points = rng.normal(0, 1, (12, 3)) * (3000.0, 6.0, 0.0)
        seen = project(points, CAMERA, Extrinsics(160, 20, 30, 100, 200, 30000))
        try:
            assert fit_extrinsics(points, seen, CAMERA).condition < 500
        except ValueError as exc:
            refused.append(str(exc))
    assert any("badly" in reason for reason in refused)
    assert len(refused) > 20


def test_what_does_not_fit_together_is_refused() -> None:
    seen = project(SQUARE, CAMERA, Extrinsics(160, 20, 30, 100, 200, 30000))
    with pytest.raises(ValueError, match="pair up"):
        fit_extrinsics(SQUARE, seen[:3], CAMERA)
    with pytest.raises(ValueError, match="pair up"):
        fit_extrinsics(SQUARE[0], seen[0], CAMERA)
    with pytest.raises(ValueError, match="points_px must be finite"):
        fit_extrinsics(SQUARE, np.where(seen == seen[0, 0], np.nan, seen), CAMERA)
    with pytest.raises(ValueError, match="units"):
        fit_extrinsics(SQUARE * 1e12, seen, CAMERA)
    for bad in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="sigma_px"):
            fit_extrinsics(SQUARE, seen, CAMERA, sigma_px=bad)
    with pytest.raises(ValueError, match="behind"):
        jacobian_px(SQUARE, CAMERA, Extrinsics(0, 0, 0, 0, 0, -1))
    with pytest.raises(ValueError, match="pose"):
        fit_extrinsics(SQUARE, np.full((4, 2), 600.0), CAMERA)


@CALM
@given(
    arrays(np.float64, st.tuples(st.integers(3, 9), st.just(3)), elements=st.floats(-1e13, 1e13)),
    arrays(np.float64, st.tuples(st.just(9), st.just(2)), elements=st.floats(-1e5, 1e5)),
    st.floats(1e-3, 1e12),
)
def test_any_points_give_a_value_error_or_a_finite_pose_before_the_camera(
    points: np.ndarray, seen: np.ndarray, f: float
) -> None:
    try:
        fit = fit_extrinsics(points, seen[: len(points)], Intrinsics(f, f, 0.0, 0.0))
    except ValueError:
        return
    assert np.isfinite(fit.turn_covariance).all()
    assert math.isfinite(fit.rms_px)
    assert (fit.extrinsics.to_camera_um(points)[:, 2] > 0.0).all()


@CALM
@given(st.integers(0, 2**32 - 1), st.floats(-30, 30), st.floats(-30, 30), st.floats(-180, 180))
def test_a_rendered_pose_is_found_again(seed: int, x: float, y: float, z: float) -> None:
    """Any view of a deep model from before it: the pose comes back, exact to the rounding."""
    points = np.random.default_rng(seed).uniform(-4e3, 4e3, (8, 3))
    pose = Extrinsics(x, y, z, 50.0, -80.0, 25e3)
    fit = fit_extrinsics(points, project(points, CAMERA, pose), CAMERA)
    assert fit.extrinsics.matrix == pytest.approx(pose.matrix, abs=1e-4)
