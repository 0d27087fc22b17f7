"""Homographies of the plane: mapping, local scale, and a least-squares fit that says how well it knows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vision.geometry.frames import Array, rotation

MAX_CONDITION = 1e4
MIN_PAIRS = 6
MIN_SPREAD = 0.05
"""Of the lesser direction against the greater; below it the points lie on a line."""
OUTLIER_FACTOR, OUTLIER_FLOOR_UM, LEAST_GOOD_SHARE = 4.0, 25.0, 0.8


@dataclass(frozen=True)
class HomographyFit:
    """A homography (3, 3) with h[2, 2] = 1 and how well it is known.

    covariance: (8, 8) of the other elements, row by row. residuals_um: (N,) distances over all pairs. used: (N,) bool,
    False for those left out. offsets_um: (G, 2), by which the targets of each group lie off those of the first.
    """

    homography: Array
    covariance: Array
    residuals_um: Array
    used: NDArray[np.bool_]
    offsets_um: Array

    @property
    def rms_um(self) -> float:
        """Root mean square of the residuals of what was used."""
        return float(np.sqrt((self.residuals_um[self.used] ** 2).mean()))


def apply_homography(h: Array, points: Array) -> Array:
    """Map points (N, 2) by a homography."""
    q = np.c_[points, np.ones(len(points))] @ h.T
    mapped: Array = q[:, :2] / q[:, 2:]
    return mapped


def jacobian(h: Array, point: Array) -> Array:
    """Return the (2, 2) derivative of the mapped point by the point."""
    q = h @ (point[0], point[1], 1.0)
    return np.asarray((h[:2, :2] - np.outer(q[:2] / q[2], h[2, :2])) / q[2])


def parameter_jacobian(h: Array, point: Array) -> Array:
    """Return the (2, 8) derivative of the mapped point by the elements of h, row by row, without h[2, 2]."""
    x, y = float(point[0]), float(point[1])
    q = h @ (x, y, 1.0)
    u, v = q[:2] / q[2]
    rows = [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    return np.array(rows, dtype=float) / float(q[2])


def fit_homography(px: Array, um: Array, groups: NDArray[np.intp], thetas_deg: Array) -> HomographyFit:
    """Fit px (N, 2) -> um (N, 2); each group g > 0 has an offset of its own, fixed in the robot frame, in `um`.

    `um` is in the head frame of each pair's angle. Robust first; pairs far off the rest are then left out, if they are
    no more than a fifth, and the others are fitted by plain least squares, whose covariance is what is said here.
    Raises ValueError for too few pairs, pairs on a line, an ill-conditioned or not finite fit.
    """
    problem = _Problem(px, um, groups, thetas_deg)
    every = np.ones(len(px), dtype=bool)
    residuals = problem.residuals_um(problem.solve(every, loss="soft_l1"))
    good = residuals <= max(OUTLIER_FACTOR * float(np.median(residuals)), OUTLIER_FLOOR_UM)
    used = good if good.mean() >= LEAST_GOOD_SHARE and good.sum() >= MIN_PAIRS else every
    return problem.finish(problem.solve(used, loss="linear"), used)


class _Problem:
    """The fit in normalised coordinates: eight parameters of the homography, then two for each further group."""

    def __init__(self, px: Array, um: Array, groups: NDArray[np.intp], thetas_deg: Array) -> None:
        self._px, self._um, self._groups = px, um, groups
        if len(px) < MIN_PAIRS or 2 * len(px) < self._size + 4:
            needed = max(MIN_PAIRS, self._size // 2 + 2)
            raise ValueError(f"{len(px)} sightings; the map needs at least {needed}")
        self._n_px, self._n_um = _normaliser(px), _normaliser(um)
        self._a, self._b = apply_homography(self._n_px, px), apply_homography(self._n_um, um)
        singular = np.linalg.svd(self._a - self._a.mean(axis=0), compute_uv=False)
        if singular[1] < MIN_SPREAD * singular[0]:
            raise ValueError("the sightings lie on a line; spread them over both directions")
        self._to_head = np.array([rotation(-t) for t in thetas_deg]).reshape(-1, 2, 2)

    @property
    def _size(self) -> int:
        return 8 + 2 * int(self._groups.max())

    def solve(self, used: NDArray[np.bool_], loss: Literal["linear", "soft_l1"]) -> Array:
        """Return the parameters."""
        from scipy.optimize import least_squares  # noqa: PLC0415  # slow to load, and only calibrations need it

        # Without perspective all is linear: the exact start.
        blank, columns = np.zeros(self._size), [*range(6), *range(8, self._size)]
        start = blank.copy()
        slope, error = self._jacobian(blank)[used][..., columns].reshape(-1, len(columns)), self._errors(blank)[used]
        start[columns] = np.linalg.lstsq(slope, -error.ravel(), rcond=None)[0]

        def errors(p: Array) -> Array:
            return np.asarray(self._errors(p)[used].ravel())

        def slopes(p: Array) -> Array:
            return np.asarray(self._jacobian(p)[used].reshape(-1, self._size))

        fit = least_squares(errors, start, slopes, loss=loss, f_scale=0.02)
        parameters = np.asarray(fit.x, dtype=float)
        if fit.status <= 0 or np.linalg.cond(np.asarray(fit.jac, dtype=float)) > MAX_CONDITION:
            raise ValueError("the fit is ill-conditioned; spread the sightings wider")
        if (np.c_[self._a, np.ones(len(self._a))][used] @ _matrix(parameters)[2] <= 0.0).any():
            raise ValueError("the fit puts a horizon among the sightings; leave out the wrong ones")
        return parameters

    def residuals_um(self, parameters: Array) -> Array:
        return np.asarray(np.linalg.norm(self._errors(parameters), axis=1) / self._n_um[0, 0])

    def finish(self, parameters: Array, used: NDArray[np.bool_]) -> HomographyFit:
        """Take the fit out of the normalised coordinates."""
        errors = self._errors(parameters)[used]
        j = self._jacobian(parameters)[used].reshape(-1, self._size)
        variance = float((errors**2).sum()) / (errors.size - self._size)
        normalised = (np.linalg.inv(j.T @ j) * variance)[:8, :8]
        back = np.linalg.inv(self._n_um)
        h = back @ _matrix(parameters) @ self._n_px
        # h's elements are linear in the parameters; dividing by h[2, 2] is not.
        by_parameter = np.kron(back, self._n_px.T)[:, :8] / h[2, 2]
        h = h / h[2, 2]
        pull = by_parameter[:8] - np.outer(h.ravel()[:8], by_parameter[8])
        covariance = pull @ normalised @ pull.T
        if not (np.isfinite(h).all() and np.isfinite(covariance).all()):
            raise ValueError("the fit is not finite; spread the sightings wider")
        offsets = np.r_[0.0, 0.0, parameters[8:]].reshape(-1, 2) / self._n_um[0, 0]
        return HomographyFit(h, (covariance + covariance.T) / 2, self.residuals_um(parameters), used, offsets)

    def _errors(self, p: Array) -> Array:
        """Return (N, 2), normalised."""
        offsets = np.r_[0.0, 0.0, p[8:]].reshape(-1, 2)[self._groups]
        turned = np.einsum("nij,nj->ni", self._to_head, offsets)
        return np.asarray(apply_homography(_matrix(p), self._a) - self._b - turned)

    def _jacobian(self, p: Array) -> Array:
        """Return (N, 2, size), normalised."""
        homogeneous = np.c_[self._a, np.ones(len(self._a))]
        q = homogeneous @ _matrix(p).T
        whole = np.zeros((len(q), 2, self._size))
        scaled = homogeneous / q[:, 2:]
        whole[:, 0, 0:3] = whole[:, 1, 3:6] = scaled
        whole[:, :, 6:8] = -(q[:, :2] / q[:, 2:])[:, :, None] * scaled[:, None, :2]
        further = np.flatnonzero(self._groups)
        for coordinate in (0, 1):
            whole[further, :, 6 + 2 * self._groups[further] + coordinate] = -self._to_head[further, :, coordinate]
        return whole


def _matrix(p: Array) -> Array:
    return np.asarray(np.r_[p[:8], 1.0].reshape(3, 3))


def _normaliser(points: Array) -> Array:
    """Return the similarity that puts points round the origin at mean distance 1."""
    centre = points.mean(axis=0)
    scale = 1.0 / max(1e-9, float(np.linalg.norm(points - centre, axis=1).mean()))
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1.0]])
