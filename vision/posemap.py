"""The map from the image to the robot: a planar projective model, turned by theta (thesis 6.2, 6.3).

Camera, needle and head are one rigid body, so at one working height a pixel always shows the same place *relative to
the tip*: a homography takes pixels to um in the head frame, and theta turns those into the robot's. The thesis keeps
the same relation as an array of (d_im, omega) -> (d_w, gamma), one per degree (eq. 6.4); a Cartesian XYZ-theta head is
degenerate for hand-eye calibration, which is why none is attempted.

The view is oblique. At working height the tip hovers, and the place below it appears `below_tip_px` away from the
tip's own picture: that vector is part of the map.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from vision.frames import Array, rotation

FORMAT = "reprobe-posemap-1"
MAX_CONDITION = 1e4
MIN_PAIRS = 6
OUTLIER_FACTOR, OUTLIER_FLOOR_UM, LEAST_GOOD_SHARE = 4.0, 25.0, 0.8


@dataclass(frozen=True)
class Sighting:
    """One resting target seen from one head position: pixels and the robot's own coordinates."""

    target_px: tuple[float, float]
    x_um: float
    y_um: float
    theta_deg: float


@dataclass(frozen=True)
class Correction:
    """How far the head has to go, robot frame, um, with one sigma."""

    dx_um: float
    dy_um: float
    sigma_um: float

    @property
    def distance_um(self) -> float:
        """Length of the way."""
        return math.hypot(self.dx_um, self.dy_um)


@dataclass(frozen=True)
class PoseMap:
    """Pixels to um at the working height.

    `homography` (3, 3) takes (x_px, y_px, 1) to head-frame um; only differences of mapped points are used, so its
    origin is free. `radius_um` bounds the region in which it was fitted, measured from the point below the tip.
    """

    homography: Array
    below_tip_px: tuple[float, float]
    radius_um: float
    residual_um: float
    work_z_um: float

    def to_head_um(self, points_px: ArrayLike) -> Array:
        """Map pixels, shape (2,) or (N, 2), to the head frame, um."""
        p = np.atleast_2d(np.asarray(points_px, dtype=float))
        q = np.c_[p, np.ones(len(p))] @ self.homography.T
        mapped: Array = q[:, :2] / q[:, 2:]
        return mapped[0] if np.ndim(points_px) == 1 else mapped

    def from_tip_um(self, points_px: ArrayLike, tip_px: tuple[float, float], theta_deg: float) -> Array:
        """Return where pixels lie from the place below the tip, robot frame, um; shape as given."""
        below_px = np.add(tip_px, self.below_tip_px)
        return (self.to_head_um(points_px) - self.to_head_um(below_px)) @ rotation(theta_deg).T

    def to_px(self, from_tip_um: ArrayLike, tip_px: tuple[float, float], theta_deg: float) -> Array:
        """Return the pixels, shape (N, 2), of places given from below the tip in the robot frame (inverse map)."""
        below_um = self.to_head_um(np.add(tip_px, self.below_tip_px))
        head_um = np.atleast_2d(np.asarray(from_tip_um, dtype=float)) @ rotation(theta_deg) + below_um
        q = np.c_[head_um, np.ones(len(head_um))] @ np.linalg.inv(self.homography).T
        pixels: Array = q[:, :2] / q[:, 2:]
        return pixels

    def scale_px_per_um(self, tip_px: tuple[float, float]) -> float:
        """Return the larger image scale below the tip: what a circle's semi-major axis is multiplied with."""
        ring = np.array([(math.cos(a), math.sin(a)) for a in np.linspace(0, math.pi, 36, endpoint=False)]) * 100.0
        px = self.to_px(np.vstack([ring, -ring]), tip_px, 0.0)
        return float(np.linalg.norm(px[:36] - px[36:], axis=1).max() / 200.0)

    def correction(self, target_px: tuple[float, float], tip_px: tuple[float, float], theta_deg: float,
                   sigma_px: float = 0.1) -> Correction:  # fmt: skip
        """Return the way that brings the tip onto the target."""
        dx, dy = self.from_tip_um(target_px, tip_px, theta_deg)
        sigma = math.hypot(self.residual_um, sigma_px / self.scale_px_per_um(tip_px))
        return Correction(float(dx), float(dy), sigma)

    def to_json(self) -> str:
        """Return the map as JSON text."""
        return json.dumps(
            {
                "format": FORMAT,
                "homography": self.homography.tolist(),
                "below_tip_px": list(self.below_tip_px),
                "radius_um": self.radius_um,
                "residual_um": self.residual_um,
                "work_z_um": self.work_z_um,
            },
            indent=1,
        )

    @classmethod
    def from_json(cls, text: str) -> PoseMap:
        """Read a map back; anything else is a ValueError that says to calibrate."""
        try:
            raw = json.loads(text)
            if raw["format"] != FORMAT:
                raise ValueError(f"format is {raw['format']!r}, not {FORMAT!r}")
            below_x, below_y = (float(v) for v in raw["below_tip_px"])
            pose_map = cls(
                np.array(raw["homography"], dtype=float),
                (below_x, below_y),
                *(float(raw[k]) for k in ("radius_um", "residual_um", "work_z_um")),
            )
        except (KeyError, TypeError, ValueError) as exc:
            raise ValueError(f"not a pose map: {exc}; calibrate the map again") from exc
        if pose_map.homography.shape != (3, 3) or not np.isfinite(pose_map.homography).all():
            raise ValueError("not a pose map: homography is not 3x3 and finite; calibrate the map again")
        return pose_map

    @classmethod
    def load(cls, path: Path) -> PoseMap:
        """Read a map from a file."""
        return cls.from_json(path.read_text())


def fit_pose_map(
    sightings: Sequence[Sighting],
    *,
    tip_px: tuple[float, float],
    below_tip_px: tuple[float, float],
    work_z_um: float,
) -> PoseMap:
    """Fit the map to sightings of one resting target from several head positions.

    In the head frame the target moves against the head: `u = R(-theta) (M - P)`. M is unknown and only shifts the
    origin, which is free. Sightings far off the rest are left out, at most a fifth of them. Raises ValueError if there
    are too few sightings, if they lie on a line, or if the fit is ill-conditioned or not finite.
    """
    px = np.array([s.target_px for s in sightings], dtype=float).reshape(-1, 2)
    if len(px) < MIN_PAIRS:
        raise ValueError(f"{len(px)} sightings; the map needs at least {MIN_PAIRS}")
    mean = np.array([[s.x_um, s.y_um] for s in sightings]).mean(axis=0)
    um = np.array([rotation(-s.theta_deg) @ (mean - (s.x_um, s.y_um)) for s in sightings])
    if not (np.isfinite(px).all() and np.isfinite(um).all()):
        raise ValueError("a sighting is not finite")
    homography, residual = _fit_homography(px, um)
    good = residual <= max(OUTLIER_FACTOR * float(np.median(residual)), OUTLIER_FLOOR_UM)
    if not good.all() and good.mean() >= LEAST_GOOD_SHARE and good.sum() >= MIN_PAIRS:
        px = px[good]
        homography, residual = _fit_homography(px, um[good])
    rms = float(np.sqrt((residual**2).mean()))
    pose_map = PoseMap(homography, below_tip_px, 1.0, rms, work_z_um)
    reach = np.linalg.norm(pose_map.to_head_um(px) - pose_map.to_head_um(np.add(tip_px, below_tip_px)), axis=1)
    return PoseMap(homography, below_tip_px, float(reach.max()), rms, work_z_um)


def _fit_homography(px: Array, um: Array) -> tuple[Array, Array]:
    """Return the homography px -> um and the residuals (N,) in um; robust, on normalised points."""
    n_px, n_um = _normaliser(px), _normaliser(um)
    a, b = _apply(n_px, px), _apply(n_um, um)
    singular = np.linalg.svd(a - a.mean(axis=0), compute_uv=False)
    if singular[1] < 0.05 * singular[0]:
        raise ValueError("the sightings lie on a line; spread them over both directions")
    affine = np.linalg.lstsq(np.c_[a, np.ones(len(a))], b, rcond=None)[0].T
    start = np.r_[affine.ravel(), 0.0, 0.0]

    def residuals(p: Array) -> Array:
        return (_apply(np.r_[p, 1.0].reshape(3, 3), a) - b).ravel()

    fit = least_squares(residuals, start, loss="soft_l1", f_scale=0.02)
    if fit.status <= 0 or np.linalg.cond(np.asarray(fit.jac, dtype=float)) > MAX_CONDITION:
        raise ValueError("the fit is ill-conditioned; spread the sightings wider")
    h = np.linalg.inv(n_um) @ np.r_[fit.x, 1.0].reshape(3, 3) @ n_px
    return h / h[2, 2], np.asarray(np.linalg.norm(_apply(h, px) - um, axis=1), dtype=float)


def _normaliser(points: Array) -> Array:
    """Return the similarity that puts points round the origin at mean distance 1."""
    centre = points.mean(axis=0)
    scale = 1.0 / max(1e-9, float(np.linalg.norm(points - centre, axis=1).mean()))
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1.0]])


def _apply(h: Array, points: Array) -> Array:
    """Map points (N, 2) by a homography."""
    q = np.c_[points, np.ones(len(points))] @ h.T
    mapped: Array = q[:, :2] / q[:, 2:]
    return mapped
