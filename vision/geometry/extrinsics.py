"""Camera extrinsics: where the camera is, from points of a known model and their pixels (thesis appendix A).

Appendix A walks downhill on `E = |f(x) - y0|^2` with the Jacobian of the projection, from a guess, until it converges:
Gauss-Newton, whatever its name (Jacobi's iteration for diagonally dominant systems, which it cites, is another thing).
What is done differently here, and why:

- Its steps 2 and 5 as printed (`dy = y - y0`, `x = x + dx`) walk uphill; the residual is `y0 - y`.
- The Jacobian is analytic instead of the forward difference A.9, and a turn is a small rotation about the model's
  centroid instead of three angles: nothing is singular at theta_y = 90 deg. The angles appear in the result only.
- Steps are damped (Levenberg, Marquardt): one that does not shrink E is not taken.
- Its guess (1, 1, 1, 1, 1, 1) puts one of its own six points behind the camera; the start is computed instead.
- A flat model seen from afar fits nearly as well tilted the other way; the other tilt is tried, and what cannot be told
  from it is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vision.geometry.camera_model import Extrinsics, Intrinsics, check_points
from vision.geometry.frames import Array, rotation

LEAST_FLAT_POINTS, LEAST_SOLID_POINTS = 4, 6
"""A homography needs 4 points, a camera matrix 6."""
FLAT_RATIO, NO_RELIEF_RATIO = 0.1, 1e-6
"""Third over second extent of the model: below the first it counts as flat, below the second it has no relief at
all."""
LINE_RATIO = 1e-3
"""Second over first extent: below it, the points lie on a line."""
LEAST_START_RATIO = 1e-3
"""Of the linear start, second smallest over largest singular value (normalised coordinates): below it, many starts
fit."""
MAX_CONDITION = 500.0
"""Of the Jacobian, its columns at unit length: 1 to 60 for models worth the name, hundreds where they are nearly a
line."""
STEP_PX, STEP_SHARE = 1e-6, 1e-7
"""Converged: the next full step would move no point's image further than this plus this share of the root of E. Much
below, E no longer shows in double precision whether a step went down."""
MAX_ITERATIONS, MAX_DAMPING = 200, 1e12
DIFFERENT_DEG, EQUAL_SIGMA2 = 0.01, 9.0
"""Two minima are different poses from here on, and equally good if E differs by less than this many sigma squared."""
LEAST_COS_Y = 1e-6
"""Nearer than this to theta_y = +-90 deg the single angles mean nothing."""


@dataclass(frozen=True)
class ExtrinsicsFit:
    """The extrinsics and what they are worth.

    turn_covariance: (6, 6) of a small rotation about the camera's three axes, deg, and of t, um; defined at any pose.
    rms_px: root mean square of the residual distances. sigma_px: noise of one pixel coordinate, as given or as the
    residuals show it (their squares' sum over 2 N - 6). condition: of the Jacobian with unit columns.
    """

    extrinsics: Extrinsics
    turn_covariance: Array
    rms_px: float
    sigma_px: float
    condition: float
    iterations: int

    @property
    def covariance(self) -> Array:
        """Return the (6, 6) covariance of (theta_x, theta_y, theta_z, tx, ty, tz), deg and um.

        Raises ValueError at theta_y = +-90 deg, where theta_x and theta_z are not determined one by one.
        """
        if abs(math.cos(math.radians(self.extrinsics.theta_y_deg))) < LEAST_COS_Y:
            raise ValueError("theta_y is 90 deg and the single angles are undetermined; use turn_covariance")
        to_angles = np.eye(6)
        to_angles[:3, :3] = np.linalg.inv(_axes_of_angles(self.extrinsics))
        return np.asarray(to_angles @ self.turn_covariance @ to_angles.T)


@dataclass(frozen=True)
class _Task:
    """The model about its centroid in units of its size, (N, 3), and its pixels, (N, 2)."""

    model: Array
    pixels: Array
    intrinsics: Intrinsics
    axes: Array
    flatness: float


@dataclass(frozen=True)
class _Pose:
    """Rotation and centroid (camera frame, units of the model's size) with the sum E of squared residuals, px^2."""

    r: Array
    c: Array
    cost: float = math.inf
    iterations: int = 0


def fit_extrinsics(
    points_um: ArrayLike,
    points_px: ArrayLike,
    intrinsics: Intrinsics,
    *,
    sigma_px: float | None = None,
    start: Extrinsics | None = None,
) -> ExtrinsicsFit:
    """Find the extrinsics that show the model's points at the pixels seen (appendix A: least squares in the image).

    points_um (N, 3) in the world, points_px (N, 2) in the same order. At least 4 points if they are flat (relief below
    a tenth of their extent), else 6. sigma_px: noise of one coordinate, if known; else the residuals tell it, which few
    points do badly. start: where to begin instead of the computed start; it may be rough, but not behind the model.

    There is no outlier rejection: one wrong pair shows in rms_px. Raises ValueError if the arrays do not fit together
    or are not finite, if there are too few points, if they lie on a line or determine no pose, if the tilt is ambiguous
    or if the iteration does not converge.
    """
    if sigma_px is not None and not (math.isfinite(sigma_px) and sigma_px > 0.0):
        raise ValueError(f"sigma_px must be finite and greater than 0, got {sigma_px!r}")
    world, pixels = _check_pairs(points_um, points_px)
    mean = world.mean(axis=0)
    size = float(np.sqrt(((world - mean) ** 2).sum(axis=1).mean()))
    task = _prepare(world - mean, size, pixels, intrinsics)
    dof = pixels.size - 6
    # What leaves the range of doubles ends as a refusal, not as a warning.
    with np.errstate(all="ignore"):
        begin = _starts(task) if start is None else [_from_start(start, mean, size)]
        best = _best(task, begin)
        best = _check_tilt(task, best, best.cost / dof if sigma_px is None else sigma_px**2)
        jacobian, condition = _check_condition(task, best)
    variance = best.cost / dof if sigma_px is None else sigma_px**2
    return ExtrinsicsFit(
        extrinsics=Extrinsics.from_matrix(best.r, best.c * size - best.r @ mean),
        turn_covariance=_covariance(jacobian, variance, best.r @ mean, size),
        rms_px=math.sqrt(best.cost / len(pixels)),
        sigma_px=math.sqrt(variance),
        condition=condition,
        iterations=best.iterations,
    )


def jacobian_px(points_um: ArrayLike, intrinsics: Intrinsics, extrinsics: Extrinsics) -> Array:
    """Return d(x1, y1, x2, ...) / d(theta_x, theta_y, theta_z, tx, ty, tz), shape (2 N, 6), px per deg and px per um.

    Eq. A.10 to A.12, analytic. Raises ValueError if a point is not in front of the camera.
    """
    points = np.atleast_2d(check_points(points_um, "points_um", 3))
    turned = points @ extrinsics.rotation.T
    seen = turned + extrinsics.translation_um
    if not (seen[:, 2] > 0.0).all():
        raise ValueError("a point lies behind the camera; check the pose")
    jacobian = _jacobian(turned, seen, intrinsics)
    jacobian[:, :3] = jacobian[:, :3] @ np.radians(_axes_of_angles(extrinsics))
    return jacobian


def _from_start(start: Extrinsics, mean_um: Array, size: float) -> _Pose:
    """Return extrinsics as the pose of the centred, scaled model."""
    return _Pose(start.rotation, (start.rotation @ mean_um + start.translation_um) / size)


def _check_pairs(points_um: Any, points_px: Any) -> tuple[Array, Array]:
    """Return both arrays checked."""
    world, pixels = check_points(points_um, "points_um", 3), check_points(points_px, "points_px", 2)
    if world.ndim != 2 or pixels.ndim != 2 or len(world) != len(pixels):
        raise ValueError(f"points_um (N, 3) and points_px (N, 2) must pair up, got {world.shape} and {pixels.shape}")
    if len(world) < LEAST_FLAT_POINTS:
        raise ValueError(
            f"{len(world)} points; at least {LEAST_FLAT_POINTS} are needed, {LEAST_SOLID_POINTS} if not flat"
        )
    if max(np.abs(world).max(), np.abs(pixels).max()) > 1e12:
        raise ValueError("coordinates beyond 1e12 are no um and no px; check the units")
    return world, pixels


def _prepare(centred: Array, size: float, pixels: Array, intrinsics: Intrinsics) -> _Task:
    """Return the task with the model's principal axes (rows, right-handed), or refuse what determines no pose."""
    if size < 1e-9:
        raise ValueError("all points are one; spread them")
    model = centred / size
    _, extent, axes = np.linalg.svd(model, full_matrices=True)
    if extent[1] < LINE_RATIO * extent[0]:
        raise ValueError("the points lie on a line; spread them over both directions")
    axes[2] = np.cross(axes[0], axes[1])
    flatness = float(extent[2] / extent[1])
    if flatness > FLAT_RATIO and len(model) < LEAST_SOLID_POINTS:
        raise ValueError(f"{len(model)} points; at least {LEAST_SOLID_POINTS} are needed unless they lie in a plane")
    return _Task(model, pixels, intrinsics, axes, flatness)


def _axes_of_angles(extrinsics: Extrinsics) -> Array:
    """Return the camera-frame axis (columns) about which each of the three angles turns: Rz Ry ex, Rz ey, ez."""
    turn_z = np.eye(3)
    turn_z[:2, :2] = rotation(extrinsics.theta_z_deg)
    y = math.radians(extrinsics.theta_y_deg)
    return np.column_stack([turn_z @ (math.cos(y), 0.0, -math.sin(y)), turn_z[:, 1], (0.0, 0.0, 1.0)])


def _cross_matrix(vectors: Array) -> Array:
    """Return [v]x with [v]x w = v x w, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ([zero, -z, y], [z, zero, -x], [-y, x, zero])]
    return np.stack(rows, axis=-2)


def _jacobian(turned: Array, seen: Array, intrinsics: Intrinsics) -> Array:
    """Return the derivatives of pixels by (small turn in rad, shift), (2 N, 6); `turned` is `seen` less the shift."""
    x, y, z = seen.T
    zero = np.zeros_like(z)
    du = np.column_stack([1.0 / z, zero, -x / z**2]) * intrinsics.fx_px
    dv = np.column_stack([zero, 1.0 / z, -y / z**2]) * intrinsics.fy_px
    by_shift = np.stack([du, dv], axis=1)
    by_turn = by_shift @ -_cross_matrix(turned)
    return np.concatenate([by_turn, by_shift], axis=2).reshape(-1, 6)


def _seen(task: _Task, pose: _Pose) -> tuple[Array, Array]:
    turned = task.model @ pose.r.T
    return turned, turned + pose.c


def _residual(task: _Task, seen: Array) -> Array:
    """Return seen less computed pixels, (2 N,); infinite if a point is not in front of the camera."""
    if not (seen[:, 2] > 1e-9).all():
        return np.full(task.pixels.size, math.inf)
    k = task.intrinsics
    computed = seen[:, :2] / seen[:, 2:] * (k.fx_px, k.fy_px) + (k.cx_px, k.cy_px)
    return np.asarray((task.pixels - computed).ravel())


def _refine(task: _Task, pose: _Pose) -> _Pose | None:
    """Iterate steps 2 to 6 of appendix A, damped; None if the start is behind the camera or nothing converges."""
    turned, seen = _seen(task, pose)
    residual = _residual(task, seen)
    cost, damping = float(residual @ residual), 1e-3
    if not math.isfinite(cost):
        return None
    for count in range(MAX_ITERATIONS):
        jacobian = _jacobian(turned, seen, task.intrinsics)
        full_step = np.linalg.lstsq(jacobian, residual, rcond=None)[0]
        if np.abs(jacobian @ full_step).max() < STEP_PX + STEP_SHARE * math.sqrt(cost):
            return _Pose(pose.r, pose.c, cost, count)
        normal, slope = jacobian.T @ jacobian, jacobian.T @ residual
        while damping < MAX_DAMPING:
            step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), slope, rcond=None)[0]
            trial = _Pose(cv2.Rodrigues(step[:3])[0] @ pose.r, pose.c + step[3:])
            trial_turned, trial_seen = _seen(task, trial)
            trial_residual = _residual(task, trial_seen)
            trial_cost = float(trial_residual @ trial_residual)
            if trial_cost < cost:
                break
            damping *= 10.0
        else:
            return None
        pose, turned, seen, residual, cost = trial, trial_turned, trial_seen, trial_residual, trial_cost
        damping = max(damping / 10.0, 1e-12)
    return None


def _best(task: _Task, begin: list[_Pose]) -> _Pose:
    """Return the lowest minimum that the starts lead to."""
    ends = [end for pose in begin if (end := _refine(task, pose)) is not None]
    if not ends:
        raise ValueError(
            "no pose was found from which the camera sees these points there: are the pairs and the units right?"
        )
    return min(ends, key=lambda pose: pose.cost)


def _check_tilt(task: _Task, best: _Pose, variance: float) -> _Pose:
    """Return the better of the two tilts of a flat model, or refuse if both fit equally well.

    From afar, mirroring the model in the plane across the line of sight changes little in the image; a flat model
    can be turned into its mirror image.
    """
    sight, flat_axis = best.c / np.linalg.norm(best.c), task.axes[2]
    across = np.eye(3) - 2.0 * np.outer(sight, sight)
    other = _refine(task, _Pose(across @ best.r @ (np.eye(3) - 2.0 * np.outer(flat_axis, flat_axis)), best.c))
    if other is None or _angle_deg(other.r, best.r) < DIFFERENT_DEG:
        return best
    if abs(other.cost - best.cost) < EQUAL_SIGMA2 * max(variance, STEP_PX**2):
        raise ValueError(
            "two tilts of the model fit equally well; tilt it more, go nearer, or use points off its plane"
        )
    return min(best, other, key=lambda pose: pose.cost)


def _angle_deg(a: Array, b: Array) -> float:
    """Return the angle between two rotations."""
    return math.degrees(float(np.linalg.norm(cv2.Rodrigues(a @ b.T)[0])))


def _check_condition(task: _Task, pose: _Pose) -> tuple[Array, float]:
    """Return the Jacobian at the solution and its condition, or refuse."""
    jacobian = _jacobian(*_seen(task, pose), task.intrinsics)
    length = np.linalg.norm(jacobian, axis=0)
    condition = float(np.linalg.cond(jacobian / length)) if (length > 0.0).all() else math.inf
    if not condition < MAX_CONDITION:
        raise ValueError("the points determine the pose badly; spread them wider, or use more of them")
    return jacobian, condition


def _covariance(jacobian: Array, variance: float, mean_um: Array, size: float) -> Array:
    """Return the covariance of (turn in deg, t in um) from that of (turn in rad, centroid in units of size)."""
    to_t = np.zeros((6, 6))
    to_t[:3, :3] = np.degrees(np.eye(3))
    # t = centroid - R mean, and a turn moves R mean.
    to_t[3:, :3] = _cross_matrix(mean_um)
    to_t[3:, 3:] = size * np.eye(3)
    inverse = np.linalg.pinv(jacobian)
    half = to_t @ inverse
    return np.asarray(variance * (half @ half.T))


def _starts(task: _Task) -> list[_Pose]:
    """Return the linear starts there are: the plane's homography, and the camera matrix if the model has relief."""
    rays = (task.pixels - (task.intrinsics.cx_px, task.intrinsics.cy_px)) / (
        task.intrinsics.fx_px,
        task.intrinsics.fy_px,
    )
    solid = len(task.model) >= LEAST_SOLID_POINTS and task.flatness > NO_RELIEF_RATIO
    starts = [_homography_start(task, rays), _matrix_start(task, rays) if solid else None]
    found = [start for start in starts if start is not None]
    if not found:
        raise ValueError("the points hardly determine a pose; are three of four on a line, or two of them the same?")
    return found


def _linear(model: Array, rays: Array) -> Array | None:
    """Return the matrix (3, D + 1) that takes model points (N, D) to rays (N, 2): direct linear transformation."""
    spread = float(np.sqrt(((rays - rays.mean(axis=0)) ** 2).sum(axis=1).mean()))
    if not spread > 1e-12:
        return None
    unit_rays = (rays - rays.mean(axis=0)) / spread
    ones = np.column_stack([model, np.ones(len(model))])
    zero = np.zeros_like(ones)
    rows = np.vstack(
        [np.hstack([ones, zero, -unit_rays[:, :1] * ones]), np.hstack([zero, ones, -unit_rays[:, 1:] * ones])]
    )
    _, singular, right = np.linalg.svd(rows, full_matrices=True)
    if singular[rows.shape[1] - 2] < LEAST_START_RATIO * singular[0]:
        return None
    back = np.array([[spread, 0.0, rays[:, 0].mean()], [0.0, spread, rays[:, 1].mean()], [0.0, 0.0, 1.0]])
    matrix: Array = back @ right[-1].reshape(3, -1)
    # The centroid is the model's origin and has to lie in front.
    return matrix * math.copysign(1.0, matrix[2, -1])


def _homography_start(task: _Task, rays: Array) -> _Pose | None:
    """Return the pose of the best plane through the model: H = (r1 r2 t) up to scale."""
    h = _linear(task.model @ task.axes[:2].T, rays)
    if h is None:
        return None
    scale = float(np.linalg.norm(h[:, :2])) / math.sqrt(2.0)
    r12 = _nearest_orthonormal(h[:, :2])
    return _Pose(np.column_stack([r12, np.cross(r12[:, 0], r12[:, 1])]) @ task.axes, h[:, 2] / scale)


def _matrix_start(task: _Task, rays: Array) -> _Pose | None:
    """Return the pose in the camera matrix (R t), up to scale, of a model with relief."""
    m = _linear(task.model, rays)
    if m is None or np.linalg.det(m[:, :3]) <= 0.0:
        return None
    scale = float(np.linalg.norm(m[:, :3])) / math.sqrt(3.0)
    return _Pose(_nearest_orthonormal(m[:, :3]), m[:, 3] / scale)


def _nearest_orthonormal(columns: Array) -> Array:
    """Return the matrix with orthonormal columns nearest to `columns`."""
    u, _, vt = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u @ vt)
