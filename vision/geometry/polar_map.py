"""Polar map, the thesis' own from the image to the robot: an array of (d_im, omega) -> (d_w, gamma), eq. 6.3..6.6.

For each head angle of the calibration a row; for each of some directions omega in the image a column. An element
keeps what one pixel in that direction is in um (distances are taken in proportion) and the direction gamma in which the
head has to go. What lies between is interpolated bilinearly, in theta and omega: the distance as it stands, the
direction on the circle, kept relative to the head so that theta turns it between the rows.

Angles. The thesis prints omega = arctan(x_e / x_g) (eq. 6.5); its table 6.2 shows what was computed: atan(dx / dy) of
d = x_e - x_g, which cannot tell a direction from its opposite. Here omega = atan2(dx, dy) of the way from the place
below the tip to the target, full circle: 0 is down in the image, 90 deg is right, so that it grows counter-clockwise
as gamma does and gamma - omega is nearly constant, as in the table (pi / 2). gamma is atan2(dy, dx) in the robot frame.

It knows nothing of perspective, and where it has few rows or columns it knows little; `pose_map` beside it is what the
station uses. Both stand behind `ImageMap`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.geometry.frames import Array, rotation
from vision.geometry.homography import fit_homography
from vision.geometry.image_map import Correction, MapPoint, angle_groups, sightings_px, sightings_um

COLUMNS = 24
LEAST_AT_AN_ANGLE = 8
WIDEST_GAP_DEG = 60.0
"""Between neighbouring sightings' directions, as seen from the tip."""
KERNEL_SHARE = 0.6
"""Width of what is averaged into an element, against the mean distance of the sightings' directions."""
NEAREST_PX = 1.0
"""A sighting nearer to the place below the tip has no direction; the thesis stops there (6.2)."""


def direction_deg(away_px: Array) -> Any:
    """Return omega, -180..180, of ways (2,) or (N, 2) in the image; a number or (N,)."""
    return np.degrees(np.arctan2(away_px[..., 0], away_px[..., 1]))


@dataclass(frozen=True)
class PolarMap:
    """The array, of T head angles and C directions.

    thetas_deg: (T,), rising, 0..360. um_per_px: (T, C). gamma_deg: (T, C), direction of the way relative to the head
    (the robot's gamma minus theta); column k is omega = 360 k / C. spread: (T, C), one sigma of the way per um of it,
    from the scatter of the sightings. below_tip_px, hover_um, radius_um, residual_um, work_z_um, below_sigma_px: as in
    `PoseMap`.
    """

    thetas_deg: Array
    um_per_px: Array
    gamma_deg: Array
    spread: Array
    below_tip_px: tuple[float, float]
    below_sigma_px: float
    hover_um: float
    radius_um: float
    residual_um: float
    work_z_um: float

    def below_px(self, height_um: float = 0.0) -> tuple[float, float]:
        """Return the vector from the tip's image to the place below it on a surface `height_um` above the nominal."""
        share = 1.0 - height_um / self.hover_um
        return self.below_tip_px[0] * share, self.below_tip_px[1] * share

    def from_tip_um(
        self, points_px: ArrayLike, tip_px: tuple[float, float], theta_deg: float, *, height_um: float = 0.0
    ) -> Array:
        """Return where pixels, (2,) or (N, 2), lie from the place below the tip, robot frame, um; shape as given."""
        away_px = np.asarray(points_px, dtype=float) - np.add(tip_px, self.below_px(height_um))
        ways = np.array([self._way(d, theta_deg)[0] for d in np.atleast_2d(away_px)]).reshape(-1, 2)
        return np.asarray(ways[0] if away_px.ndim == 1 else ways)

    def correction(
        self,
        target_px: tuple[float, float],
        tip_px: tuple[float, float],
        theta_deg: float,
        sigma_px: float = 0.1,
        *,
        height_um: float = 0.0,
    ) -> Correction:
        """Return the way that brings the tip onto the target; its covariance is taken the same in all directions."""
        way, um_per_px, spread = self._way(np.subtract(target_px, np.add(tip_px, self.below_px(height_um))), theta_deg)
        seen_um = um_per_px * math.hypot(sigma_px, self.below_sigma_px * (1.0 - height_um / self.hover_um))
        variance = (spread * float(np.linalg.norm(way))) ** 2 + seen_um**2
        return Correction(float(way[0]), float(way[1]), np.eye(2) * variance)

    def _way(self, away_px: Array, theta_deg: float) -> tuple[Array, float, float]:
        """Interpolate bilinearly; return the way (2,) in the robot frame, um per px, and the spread."""
        omega_deg = float(direction_deg(away_px)) % 360.0
        left, right, along = _between(np.arange(self.um_per_px.shape[1]) * (360.0 / self.um_per_px.shape[1]), omega_deg)
        lower, upper, up = _between(self.thetas_deg, theta_deg % 360.0)

        def value(table: Array) -> float:
            rows = [(1.0 - along) * table[i, left] + along * table[i, right] for i in (lower, upper)]
            return float((1.0 - up) * rows[0] + up * rows[1])

        rows_deg = [_on_circle(self.gamma_deg[i, left], self.gamma_deg[i, right], along) for i in (lower, upper)]
        gamma = math.radians(_on_circle(rows_deg[0], rows_deg[1], up) + theta_deg)
        um_per_px = value(self.um_per_px)
        length = um_per_px * float(np.linalg.norm(away_px))
        return length * np.array([math.cos(gamma), math.sin(gamma)]), um_per_px, value(self.spread)


@dataclass(frozen=True)
class _Angle:
    """The sightings at one head angle as polar pairs: um per px, gamma - omega or gamma + omega, weights d_im^2."""

    omega_deg: Array
    ratio: Array
    turn_deg: Array
    hand: float
    d_px: Array
    width_deg: float
    landing_sigma: float

    def at(self, omega_deg: float) -> tuple[float, float, Array]:
        """Return um per px, gamma and the weights (N,), by a line through the neighbours' values in omega."""
        off = _wrap(self.omega_deg - omega_deg)
        w = self.d_px**2 * np.exp(-0.5 * (off / self.width_deg) ** 2)
        s0, s1, s2 = (float((w * off**k).sum()) for k in range(3))
        weights = w * (s2 - s1 * off) / (s0 * s2 - s1**2)
        mean = _mean_deg(self.turn_deg, w)
        turn = mean + float(weights @ _wrap(self.turn_deg - mean))
        return float(weights @ self.ratio), turn + self.hand * omega_deg, np.asarray(weights)


def fit_polar_map(
    sightings: Sequence[MapPoint],
    *,
    tip_px: tuple[float, float],
    below_tip_px: tuple[float, float],
    work_z_um: float,
    hover_um: float,
    below_sigma_px: float = 0.0,
    columns: int = COLUMNS,
) -> PolarMap:
    """Fill the array from sightings of one resting target at one or several head angles.

    The head's place with the tip on the target, to which all ways of an angle are counted (eq. 6.6's d_w,0), is where
    an affine through that angle's sightings puts it. Sightings far off the rest are left out by the same rule as in
    `fit_pose_map`. Raises ValueError if there are fewer than eight sightings at an angle, if they leave a gap of more
    than 60 deg round the tip, lie on a line, are not finite or make no map.
    """
    if columns < 4 or not hover_um > 0.0:
        raise ValueError(f"a polar map needs 4 or more columns and a hover_um above 0, got {columns} and {hover_um}")
    px, place_um = sightings_px(sightings), sightings_um(sightings)
    theta_deg = np.array([s.theta_deg for s in sightings], dtype=float)
    if not (np.isfinite(px).all() and np.isfinite(place_um).all() and np.isfinite(theta_deg).all()):
        raise ValueError("a sighting is not finite")
    groups = angle_groups([float(t) for t in theta_deg])
    away_px = px - np.add(tip_px, below_tip_px)
    rows, squares, freedom, count, reach_um = [], 0.0, 0.0, 0, 0.0
    for g in range(int(groups.max(initial=-1)) + 1):
        mine, theta = groups == g, float(theta_deg[groups == g].mean())
        mine[mine] = _believable(px[mine], place_um[mine], theta)
        angle = _polar(away_px[mine], place_um[mine], theta)
        lost, free = _left(angle)
        squares, freedom, count = squares + lost, freedom + free, count + len(angle.d_px)
        reach_um = max(reach_um, float((angle.ratio * angle.d_px).max()))
        rows.append((theta % 360.0, angle))
    if not rows:
        raise ValueError(f"no sightings; the array needs {LEAST_AT_AN_ANGLE} at each angle")
    rows.sort(key=lambda row: row[0])
    scatter_um = math.sqrt(squares / max(freedom, 1.0))
    tables = np.array([_row(angle, columns, scatter_um) for _, angle in rows])
    return PolarMap(
        thetas_deg=np.array([theta for theta, _ in rows]),
        um_per_px=tables[:, 0],
        gamma_deg=tables[:, 1],
        spread=tables[:, 2],
        below_tip_px=below_tip_px,
        below_sigma_px=below_sigma_px,
        hover_um=hover_um,
        radius_um=reach_um,
        residual_um=math.sqrt(squares / count),
        work_z_um=work_z_um,
    )


def _believable(px: Array, place_um: Array, theta_deg: float) -> NDArray[np.bool_]:
    """Return (N,) bool: which of one angle's sightings agree."""
    _enough(len(px), theta_deg)
    thetas, one_group = np.full(len(px), theta_deg), np.zeros(len(px), dtype=np.intp)
    return fit_homography(px, (place_um.mean(axis=0) - place_um) @ rotation(-theta_deg).T, one_group, thetas).used


def _enough(count: int, theta_deg: float) -> None:
    if count < LEAST_AT_AN_ANGLE:
        raise ValueError(
            f"{count} good sightings at {theta_deg:.2f} deg; the array needs {LEAST_AT_AN_ANGLE} at each angle"
        )


def _polar(away_px: Array, place_um: Array, theta_deg: float) -> _Angle:
    """Return the polar pairs of one angle."""
    d_px = np.linalg.norm(away_px, axis=1)
    # Far from the tip perspective bends the affine, so what is near counts more.
    weight = 1.0 / (1.0 + (d_px / np.median(d_px)) ** 2)
    design = np.c_[np.ones(len(d_px)), away_px]
    pull = np.linalg.pinv(design * np.sqrt(weight)[:, None]) * np.sqrt(weight)
    affine = pull @ place_um
    # The image's y points down: a camera that is not flipped has a negative determinant, as omega goes with gamma.
    hand = 1.0 if np.linalg.det(affine[1:]) < 0.0 else -1.0
    clear = d_px >= NEAREST_PX
    _enough(int(clear.sum()), theta_deg)
    away_px, d_px = away_px[clear], d_px[clear]
    way_um = (affine[0] - place_um[clear]) @ rotation(-theta_deg).T
    omega_deg = direction_deg(away_px) % 360.0
    gaps = np.diff(np.r_[np.sort(omega_deg), omega_deg.min() + 360.0])
    if gaps.max() > WIDEST_GAP_DEG:
        raise ValueError(f"the sightings leave a gap of {gaps.max():.0f} deg round the tip; spread them all round it")
    gamma_deg = np.degrees(np.arctan2(way_um[:, 1], way_um[:, 0]))
    ratio = np.linalg.norm(way_um, axis=1) / d_px
    landing_sigma = float(np.linalg.norm(pull[0])) / float(np.sqrt((d_px**2).mean()))
    width_deg = max(KERNEL_SHARE * 360.0 / len(d_px), float(gaps.max()) / 4)
    return _Angle(
        omega_deg=omega_deg,
        ratio=ratio,
        turn_deg=_wrap(gamma_deg - hand * omega_deg),
        hand=hand,
        d_px=d_px,
        width_deg=width_deg,
        landing_sigma=landing_sigma,
    )


def _left(angle: _Angle) -> tuple[float, float]:
    """Return the sum of squares of what the smoothed array leaves at its own sightings, and its degrees of freedom."""
    squares, freedom = 0.0, -2.0
    for omega, ratio, turn, d_px in zip(angle.omega_deg, angle.ratio, angle.turn_deg, angle.d_px, strict=True):
        smooth, gamma, weights = angle.at(float(omega))
        aside = math.radians(gamma - float(turn) - angle.hand * float(omega))
        squares += d_px**2 * (smooth**2 + ratio**2 - 2.0 * smooth * ratio * math.cos(aside))
        freedom += 2.0 * (1.0 - float(weights[omega == angle.omega_deg][0]))
    return float(squares), freedom


def _row(angle: _Angle, columns: int, scatter_um: float) -> Array:
    """Return the (3, C) elements of one angle: um per px, gamma, spread."""
    elements = []
    for k in range(columns):
        ratio, gamma, weights = angle.at(360.0 * k / columns)
        one = math.hypot(float(np.linalg.norm(weights / angle.d_px)), angle.landing_sigma)
        elements.append((ratio, gamma % 360.0, scatter_um * one / ratio))
    return np.array(elements).T


def _between(grid_deg: Array, angle_deg: float) -> tuple[int, int, float]:
    """Return the two places of a rising circular grid round an angle, and how far it is from the first, 0..1."""
    upper = int(np.searchsorted(grid_deg, angle_deg, side="right")) % len(grid_deg)
    lower = (upper - 1) % len(grid_deg)
    width = float(grid_deg[upper] - grid_deg[lower]) % 360.0
    return lower, upper, float((angle_deg - grid_deg[lower]) % 360.0) / width if width else 0.0


def _on_circle(first_deg: float, second_deg: float, along: float) -> float:
    """Interpolate between two angles the short way round."""
    return float(first_deg + along * _wrap(np.array(second_deg - first_deg)))


def _wrap(angles_deg: Array) -> Array:
    """Bring angles into -180..180."""
    return np.asarray((angles_deg + 180.0) % 360.0 - 180.0)


def _mean_deg(angles_deg: Array, weights: Array) -> float:
    """Return the weighted mean on the circle."""
    angles = np.radians(angles_deg)
    return math.degrees(math.atan2(float(weights @ np.sin(angles)), float(weights @ np.cos(angles))))
