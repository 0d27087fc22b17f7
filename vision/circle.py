"""Measure a round thing to a fraction of a pixel: robust fit to edges on radial calipers.

The camera looks obliquely, so a circle on the board is an ellipse whose minor axis lies along the needle. All radii
here are semi-major; angles go round in the plane of the board, so that an undistorted pad is a constant radius.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vision.caliper import Fit, Floats, derivative, refine_peaks, robust_fit, sample
from vision.image import Plane

# Samples per px along a ray, and the smoothing of its derivative in px.
RAY_STEPS = 2
RAY_SIGMA_PX = 0.9
# Ellipses may differ from the view's ratio and direction by about this share of the radius (lens, tilt, pad shape).
SHAPE_SIGMA = 0.025
LEAST_RAYS = 10
LEAST_COVERAGE = 0.35
# An edge this near the fit lies on it: px, or share of the radius if that is more.
NEAR_PX, NEAR_SHARE = 0.7, 0.03
ROUNDS = 3


@dataclass(frozen=True, slots=True)
class View:
    """Hold how obliquely the board is seen: minor over major axis of a circle, direction of the minor axis."""

    ratio: float = 0.87
    minor_rad: float = float(np.arctan2(232.0, 119.0))

    def to_image(self, x_px: float, y_px: float, radius_px: Floats, phi_rad: Floats) -> tuple[Floats, Floats]:
        """Return image points at board radius and angle (0 = along the minor axis) about a centre."""
        u, v = self.ratio * radius_px * np.cos(phi_rad), radius_px * np.sin(phi_rad)
        c, s = np.cos(self.minor_rad), np.sin(self.minor_rad)
        return x_px + u * c - v * s, y_px + u * s + v * c

    def flattening(self) -> Floats:
        """Return the (2, 2) matrix that turns image offsets into offsets on the board, in semi-major px."""
        c, s = np.cos(self.minor_rad), np.sin(self.minor_rad)
        minor = np.array([c, s])
        return np.asarray(np.eye(2) + (1.0 / self.ratio - 1.0) * np.outer(minor, minor))


@dataclass(frozen=True, slots=True)
class CircleFit:
    """Hold a fitted circle as seen: centre, semi-major radius, and how far it can be trusted.

    sigma_px: 1-sigma of each coordinate of the centre. visible: share of the contour that nothing hides (0..1).
    coverage: share of the visible contour with an edge on the fit (0..1). residual_px: scatter of those edges.
    contrast: median step across the contour, levels per px (of the smoothed slope).
    """

    x_px: float
    y_px: float
    radius_px: float
    sigma_px: float
    visible: float
    coverage: float
    residual_px: float
    strength: float


@lru_cache(maxsize=8)
def _directions(rays: int) -> tuple[Floats, Floats]:
    """Return ray angles (N,) and the design (N, 5) of radius, centre and second harmonic."""
    phi: Floats = np.arange(rays, dtype=np.float64) * (2.0 * np.pi / rays)
    design: Floats = np.stack([np.ones(rays), np.cos(phi), np.sin(phi), np.cos(2 * phi), np.sin(2 * phi)], axis=1)
    return phi, design


def fit_circle(
    plane: Plane,
    centre_px: tuple[float, float],
    radius_px: float,
    view: View,
    *,
    reach_px: float,
    bright_inside: bool = True,
    hidden: NDArray[np.bool_] | None = None,
) -> CircleFit | None:
    """Fit a circle near a seed; None when fewer than LEAST_RAYS rays meet its edge.

    plane: (H, W) float32, unfiltered. reach_px: how far from the seed's radius edges are looked for at first (twice
    that later brings nothing: it shrinks round by round). hidden: (H, W) bool, what to leave out.
    """
    rays = 48 if radius_px < 10.0 else 72
    x, y, radius = centre_px[0], centre_px[1], radius_px
    found: CircleFit | None = None
    for turn in range(ROUNDS):
        reach = max(reach_px / (1.0 + 0.6 * turn), 1.8)
        found = _one_round(plane, (x, y, radius), view, rays, reach, 1.0 if bright_inside else -1.0, hidden)
        if found is None or found.radius_px < 1.0 or found.coverage < LEAST_COVERAGE:
            return None
        if np.hypot(found.x_px - centre_px[0], found.y_px - centre_px[1]) > 2.0 * reach_px:
            return None
        moved = abs(found.x_px - x) + abs(found.y_px - y)
        x, y, radius = found.x_px, found.y_px, found.radius_px
        if turn and moved < 0.02:
            break
    return found


def _one_round(
    plane: Plane,
    circle: tuple[float, float, float],
    view: View,
    rays: int,
    reach: float,
    sign: float,
    hidden: NDArray[np.bool_] | None,
) -> CircleFit | None:
    x, y, radius = circle
    phi, design = _directions(rays)
    inner = max(radius - reach - 3.0, 0.2)
    steps = int((radius + reach + 3.0 - inner) * RAY_STEPS) + 1
    rho = inner + np.arange(steps) / RAY_STEPS
    xs, ys = view.to_image(x, y, np.broadcast_to(rho, (rays, steps)), phi[:, None])
    wanted = -sign * RAY_STEPS * derivative(sample(plane, xs, ys), RAY_SIGMA_PX * RAY_STEPS)
    near = np.abs(rho - radius) <= reach
    near[:2] = near[-2:] = False
    columns = np.flatnonzero(near)
    if columns.size < 3:
        return None
    peak = columns[0] + np.argmax(wanted[:, columns], axis=1)
    strength = wanted[np.arange(rays), peak]
    place = inner + refine_peaks(wanted, peak) / RAY_STEPS
    seen = _visible(plane.shape, view, (x, y), place, phi, hidden)
    if np.count_nonzero(seen) < LEAST_RAYS:
        return None
    level = float(np.partition(strength[seen], (index := int(0.7 * np.count_nonzero(seen))))[index])
    inside = (place > radius - reach) & (place < radius + reach)
    good = seen & inside & (strength > max(0.35 * level, 2.0))
    if np.count_nonzero(good) < LEAST_RAYS:
        return None
    prior = np.array([np.inf, np.inf, np.inf, SHAPE_SIGMA * radius, SHAPE_SIGMA * radius])
    fit = robust_fit(design[good], place[good] - radius, prior, floor=0.04, ceiling=max(0.3, 0.02 * radius), rounds=4)
    residual = place[good] - radius - design[good] @ fit.parameters
    return _as_circle(fit, residual, circle, view, float(np.count_nonzero(seen)), rays, level)


def _visible(
    shape: tuple[int, ...],
    view: View,
    centre: tuple[float, float],
    place: Floats,
    phi: Floats,
    hidden: NDArray[np.bool_] | None,
) -> NDArray[np.bool_]:
    """Return which edge places (N,) lie in the picture and are not hidden."""
    xs, ys = view.to_image(centre[0], centre[1], place, phi)
    columns, rows = np.rint(xs).astype(np.intp), np.rint(ys).astype(np.intp)
    inside = (columns >= 1) & (rows >= 1) & (columns < shape[1] - 1) & (rows < shape[0] - 1)
    if hidden is None:
        return np.asarray(inside, dtype=np.bool_)
    inside[inside] = ~hidden[rows[inside], columns[inside]]
    return np.asarray(inside, dtype=np.bool_)


def _as_circle(
    fit: Fit, residual: Floats, circle: tuple[float, float, float], view: View, seen: float, rays: int, level: float
) -> CircleFit | None:
    near = max(NEAR_PX, NEAR_SHARE * circle[2])
    used = float(np.count_nonzero(np.abs(residual) < near))
    if used < LEAST_RAYS:
        return None
    grow, minor, major = (float(number) for number in fit.parameters[:3])
    c, s = np.cos(view.minor_rad), np.sin(view.minor_rad)
    dx, dy = view.ratio * minor * c - major * s, view.ratio * minor * s + major * c
    # Neighbouring rays share pixels and blur: half of them count as independent.
    variance = 2.0 * float(fit.covariance[1, 1] + fit.covariance[2, 2]) / 2.0
    return CircleFit(
        circle[0] + dx,
        circle[1] + dy,
        circle[2] + grow,
        float(np.sqrt(variance + 0.02**2)),
        seen / rays,
        used / seen,
        fit.scale,
        level,
    )
