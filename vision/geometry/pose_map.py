"""Pose map from the image to the robot: a planar projective model, turned by theta (thesis 6.2, 6.3).

Camera, probe and head are one rigid body, so at one working height a pixel always shows the same place *relative to
the tip*: a homography takes pixels to um in the head frame, and theta turns those into the robot's. The thesis keeps
the same relation as an array of (d_im, omega) -> (d_w, gamma), one per degree (eq. 6.4; here `polar_map`); a Cartesian
XYZ-theta head is degenerate for hand-eye calibration, which is why none is attempted.

The view is oblique. At working height the tip hovers `hover_um` above the nominal touching plane, and the place below
it appears `below_tip_px` away from the tip's own image: that vector is part of the map. On a board whose surface lies
higher the tip hovers less, and the vector shrinks in proportion. (The scale grows as well, by the height over the
camera's distance: under 0.2 % for 100 um, less than 1 um in a correction of 500 um. It is left out.)
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from vision.geometry.frames import Array, rotation
from vision.geometry.homography import (
    MIN_PAIRS,
    HomographyFit,
    apply_homography,
    fit_homography,
    jacobian,
    parameter_jacobian,
)
from vision.geometry.image_map import Correction, MapPoint, angle_groups, sightings_px, sightings_um

__all__ = ["FORMAT", "Correction", "MapPoint", "PoseMap", "fit_pose_map", "worst_shrink"]

FORMAT = "reprobe-posemap-2"
NUMBERS = ("below_sigma_px", "hover_um", "radius_um", "residual_um", "work_z_um")
LEAST_DISTANCE_UM = 100.0
"""Nearer to the tip the stops' scatter alone decides whether a correction shrinks the error."""


@dataclass(frozen=True)
class PoseMap:
    """Pixels to um at the working height.

    homography: (3, 3), takes (x_px, y_px, 1) to head-frame um, its last element 1; only differences of mapped points
    are used, so its origin is free. covariance: (8, 8), of its other elements row by row (pulled back from the fit, so
    it belongs to pixels and um as they stand). below_tip_px: from the tip's image to the place below it on the
    nominal touching plane, which is `hover_um` below the tip; below_sigma_px: one sigma of each of its coordinates.
    radius_um bounds the region in which the map was fitted, measured from the place below the tip. residual_um: root
    mean square distance that the fit left, mostly the scatter of the stops it was made from.
    """

    homography: Array
    covariance: Array
    below_tip_px: tuple[float, float]
    below_sigma_px: float
    hover_um: float
    radius_um: float
    residual_um: float
    work_z_um: float

    def __post_init__(self) -> None:
        """Refuse what is no map."""
        numbers = (*self.below_tip_px, self.below_sigma_px, self.hover_um, self.radius_um, self.residual_um,
                   self.work_z_um)  # fmt: skip
        if self.homography.shape != (3, 3) or not np.isfinite(self.homography).all():
            raise ValueError("homography is not 3x3 and finite")
        if self.covariance.shape != (8, 8) or not np.isfinite(self.covariance).all():
            raise ValueError("covariance is not 8x8 and finite")
        if (np.diag(self.covariance) < 0.0).any() or not np.allclose(self.covariance, self.covariance.T):
            raise ValueError("covariance is not symmetric with a diagonal of squares")
        if not all(map(math.isfinite, numbers)):
            raise ValueError("a number is not finite")
        if self.hover_um <= 0.0:
            raise ValueError(f"hover_um is {self.hover_um}; the tip must hover above the touching plane")
        if self.below_sigma_px < 0.0 or self.residual_um < 0.0 or self.radius_um <= 0.0:
            raise ValueError("below_sigma_px, residual_um or radius_um is negative, or there is no region")

    @property
    def mirrored(self) -> bool:
        """Whether the map turns a left hand into a right one: the camera delivers a flipped image.

        The robot's y points up where the image's points down, so a camera above the board has det(d um / d px) < 0.
        """
        return bool(np.linalg.det(self.homography) > 0.0)

    def below_px(self, height_um: float = 0.0) -> tuple[float, float]:
        """Return the vector from the tip's image to the place below it on a surface `height_um` above the nominal."""
        share = 1.0 - height_um / self.hover_um
        return self.below_tip_px[0] * share, self.below_tip_px[1] * share

    def height_from_shift_um(self, shift_px: ArrayLike) -> float:
        """Return how far up a thing near the tip moved, relative to the head, from its shift in the image (2,).

        What lies `hover_um` *below* the tip appears at +below_tip_px from it, so what moves d upwards shifts by
        -d / hover_um * below_tip_px. Only the shift's component along that vector counts; the rest is sideways. Raises
        ValueError where the view shows no height: it is square on.
        """
        below = np.array(self.below_tip_px)
        square = float(below @ below)
        if square < 1e-6:
            raise ValueError("the camera looks straight down: height does not show in the picture")
        return -float(np.asarray(shift_px, dtype=float).reshape(2) @ below) / square * self.hover_um

    def to_head_um(self, points_px: ArrayLike) -> Array:
        """Map pixels, shape (2,) or (N, 2), to the head frame, um."""
        mapped = apply_homography(self.homography, np.atleast_2d(np.asarray(points_px, dtype=float)))
        return np.asarray(mapped[0] if np.ndim(points_px) == 1 else mapped)

    def from_tip_um(
        self, points_px: ArrayLike, tip_px: tuple[float, float], theta_deg: float, *, height_um: float = 0.0
    ) -> Array:
        """Return where pixels lie from the place below the tip, robot frame, um; shape as given.

        `height_um`: of the surface they lie on, above the nominal touching plane.
        """
        below_um = self.to_head_um(np.add(tip_px, self.below_px(height_um)))
        return (self.to_head_um(points_px) - below_um) @ rotation(theta_deg).T

    def to_px(
        self, from_tip_um: ArrayLike, tip_px: tuple[float, float], theta_deg: float, *, height_um: float = 0.0
    ) -> Array:
        """Return the pixels, shape (N, 2), of places given from below the tip in the robot frame (inverse map)."""
        below_um = self.to_head_um(np.add(tip_px, self.below_px(height_um)))
        head_um = np.atleast_2d(np.asarray(from_tip_um, dtype=float)) @ rotation(theta_deg) + below_um
        back: Array = np.asarray(np.linalg.inv(self.homography), dtype=float)
        return apply_homography(back, head_um)

    def scale_px_per_um(self, tip_px: tuple[float, float], *, height_um: float = 0.0) -> float:
        """Return the larger image scale below the tip: what a circle's semi-major axis is multiplied with."""
        ring = np.array([(math.cos(a), math.sin(a)) for a in np.linspace(0, math.pi, 36, endpoint=False)]) * 100.0
        px = self.to_px(np.vstack([ring, -ring]), tip_px, 0.0, height_um=height_um)
        return float(np.linalg.norm(px[:36] - px[36:], axis=1).max() / 200.0)

    def correction(
        self,
        target_px: tuple[float, float],
        tip_px: tuple[float, float],
        theta_deg: float,
        sigma_px: float = 0.1,
        *,
        height_um: float = 0.0,
    ) -> Correction:
        """Return the way that brings the tip onto the target.

        `sigma_px`: one sigma per coordinate of tip and target together, hypot(tip's, target's); it is taken to come
        from both in equal parts. `height_um`: of the target's surface above the nominal touching plane.
        """
        dx, dy = self.from_tip_um(target_px, tip_px, theta_deg, height_um=height_um)
        turn = rotation(theta_deg)
        in_head = self._covariance_um2(np.asarray(target_px, dtype=float), tip_px, sigma_px, height_um)
        return Correction(float(dx), float(dy), turn @ in_head @ turn.T)

    def _covariance_um2(
        self, target_px: Array, tip_px: tuple[float, float], sigma_px: float, height_um: float
    ) -> Array:
        """Return the (2, 2) covariance of target minus place below the tip in the head frame.

        The homography is uncertain at both ends in the same way, so its part is that of the difference.
        """
        below_px = np.add(tip_px, self.below_px(height_um))
        at_target, at_below = jacobian(self.homography, target_px), jacobian(self.homography, below_px)
        by_map = parameter_jacobian(self.homography, target_px) - parameter_jacobian(self.homography, below_px)
        seen = (at_target @ at_target.T + at_below @ at_below.T) * sigma_px**2 / 2
        sigma_below_px = self.below_sigma_px * (1.0 - height_um / self.hover_um)
        whole: Array = by_map @ self.covariance @ by_map.T + seen + at_below @ at_below.T * sigma_below_px**2
        return whole

    def to_json(self) -> str:
        """Return the map as JSON text."""
        arrays = {"homography": self.homography.tolist(), "covariance": self.covariance.tolist()}
        numbers = {name: getattr(self, name) for name in NUMBERS}
        return json.dumps({"format": FORMAT} | arrays | {"below_tip_px": list(self.below_tip_px)} | numbers, indent=1)

    @classmethod
    def from_json(cls, text: str) -> PoseMap:
        """Read a map back; anything else is a ValueError that says to calibrate."""
        try:
            raw = json.loads(text)
            if raw["format"] != FORMAT:
                raise ValueError(f"format is {raw['format']!r}, not {FORMAT!r}")
            below_x, below_y = (float(v) for v in raw["below_tip_px"])
            homography, covariance = (np.array(raw[name], dtype=float) for name in ("homography", "covariance"))
            return cls(homography, covariance, (below_x, below_y), *(float(raw[name]) for name in NUMBERS))
        except (KeyError, TypeError, ValueError, OverflowError) as exc:
            raise ValueError(f"not a pose map: {exc}; calibrate the map again") from exc

    @classmethod
    def load(cls, path: Path) -> PoseMap:
        """Read a map from a file."""
        return cls.from_json(path.read_text())


def fit_pose_map(
    sightings: Sequence[MapPoint],
    *,
    tip_px: tuple[float, float],
    below_tip_px: tuple[float, float],
    work_z_um: float,
    hover_um: float,
    below_sigma_px: float = 0.0,
) -> PoseMap:
    """Fit the map to sightings of one resting target from several head positions, at one or several head angles.

    In the head frame the target moves against the head: `u = R(-theta) (M - P)`. M is unknown and only shifts the
    origin, which is free; at each further angle it is another shift, run-out included, and is fitted as well.
    Sightings far off the rest are left out, at most a fifth of them. `hover_um`: height of the tip above the touching
    plane at which `below_tip_px` was measured; `below_sigma_px`: one sigma of each coordinate of that measurement.
    Raises ValueError if there are too few sightings, if they lie on a line, or if the fit is ill-conditioned or not
    finite.
    """
    fit = _fit(sightings)
    px = sightings_px(sightings)[fit.used]
    below_um = apply_homography(fit.homography, np.add(tip_px, below_tip_px)[None, :])
    reach_um = float(np.linalg.norm(apply_homography(fit.homography, px) - below_um, axis=1).max())
    return PoseMap(
        homography=fit.homography,
        covariance=fit.covariance,
        below_tip_px=below_tip_px,
        below_sigma_px=below_sigma_px,
        hover_um=hover_um,
        radius_um=reach_um,
        residual_um=fit.rms_um,
        work_z_um=work_z_um,
    )


def _fit(sightings: Sequence[MapPoint]) -> HomographyFit:
    if not sightings:
        raise ValueError(f"no sightings; the map needs at least {MIN_PAIRS}")
    px, place_um = sightings_px(sightings), sightings_um(sightings)
    theta_deg = np.array([s.theta_deg for s in sightings], dtype=float)
    if not (np.isfinite(px).all() and np.isfinite(place_um).all() and np.isfinite(theta_deg).all()):
        raise ValueError("a sighting is not finite")
    away = place_um.mean(axis=0) - place_um
    um = np.array([rotation(-t) @ u for t, u in zip(theta_deg, away, strict=True)])
    return fit_homography(px, um, angle_groups([float(t) for t in theta_deg]), theta_deg)


def worst_shrink(
    sightings: Sequence[MapPoint],
    *,
    tip_px: tuple[float, float],
    below_tip_px: tuple[float, float],
    work_z_um: float,
    hover_um: float,
    below_sigma_px: float = 0.0,
) -> float:
    """Return the largest share of its error that a correction by such a map would leave; takes what the fit takes.

    Leave-one-out: each sighting is corrected by the map of all others, and the place where that puts the head is held
    against where those others put it. Sightings within 100 um of the tip, and those the fit leaves out, are not asked.
    A map that cannot be fitted without one of its sightings leaves everything: infinity. What this cannot see is an
    error that all sightings share, as a wrong `below_tip_px`. Raises ValueError if there is nothing to ask.
    """
    used = _fit(sightings).used
    kept = [s for s, good in zip(sightings, used, strict=True) if good]
    groups = angle_groups([s.theta_deg for s in kept])
    shares = []
    for k, one in enumerate(kept):
        rest = [s for i, s in enumerate(kept) if i != k]
        same = [s for i, s in enumerate(kept) if i != k and groups[i] == groups[k]]
        if not same:
            continue
        try:
            pose_map = fit_pose_map(rest, tip_px=tip_px, below_tip_px=below_tip_px, work_z_um=work_z_um,
                                    hover_um=hover_um, below_sigma_px=below_sigma_px)  # fmt: skip
        except ValueError:
            return math.inf
        goal_um = np.mean([_landing_um(pose_map, s, tip_px) for s in same], axis=0)
        before_um = math.dist(goal_um, (one.x_um, one.y_um))
        if before_um > LEAST_DISTANCE_UM:
            shares.append(math.dist(goal_um, _landing_um(pose_map, one, tip_px)) / before_um)
    if not shares:
        raise ValueError("no sighting is farther than 100 um from the tip; spread them wider")
    return max(shares)


def _landing_um(pose_map: PoseMap, sighting: MapPoint, tip_px: tuple[float, float]) -> Array:
    """Return where the head would be after the correction of a sighting."""
    way_um = pose_map.from_tip_um(sighting.target_px, tip_px, sighting.theta_deg)
    return np.add((sighting.x_um, sighting.y_um), way_um)
