"""Calipers and robust fits: intensity profiles, sub-pixel edges on them, and lines through many edges.

An edge's place is the peak of the profile's derivative, smoothed by a Gaussian, refined by a parabola through the
peak and its neighbours. On clean images that is good to a few hundredths of a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core.image import Gray, Plane

Floats = NDArray[np.float64]
TUKEY_REACH = 4.685
"""Residuals are weighted by Tukey's biweight with this many scales of reach (95 % efficient on Gaussian noise)."""


@dataclass(frozen=True, slots=True)
class Edge:
    """Hold one edge on a profile: `at_px` from the profile's start, signed `strength` in levels per px (+ = rising)."""

    at_px: float
    strength: float


@dataclass(frozen=True, slots=True)
class Line:
    """Hold a straight line through (x_px, y_px) along angle_rad (x towards y), with what its fit was worth."""

    x_px: float
    y_px: float
    angle_rad: float
    sigma_px: float
    used: int
    offered: int

    def offset_px(self, x_px: float, y_px: float) -> float:
        """Return the signed distance of a point from the line; positive to the right of its direction as seen."""
        return float((y_px - self.y_px) * np.cos(self.angle_rad) - (x_px - self.x_px) * np.sin(self.angle_rad))


@lru_cache(maxsize=16)
def derivative_kernel(sigma_px: float) -> Plane:
    """Return the row kernel (1, 2k+1) for cv2.filter2D whose answer to a unit ramp is 1: derivative of a Gaussian."""
    reach = max(2, int(np.ceil(3.0 * sigma_px)))
    at = np.arange(-reach, reach + 1, dtype=np.float64)
    kernel = at * np.exp(-0.5 * (at / sigma_px) ** 2)
    return np.asarray((kernel / np.sum(kernel * at))[None, :], dtype=np.float32)


def sample(plane: Plane | Gray, x_px: Floats, y_px: Floats) -> Plane:
    """Return `plane` at sub-pixel places by bilinear interpolation; outside it, the nearest pixel."""
    return np.asarray(
        cv2.remap(
            plane.astype(np.float32, copy=False),
            x_px.astype(np.float32),
            y_px.astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        dtype=np.float32,
    )


def profile(
    plane: Plane | Gray, start_px: tuple[float, float], end_px: tuple[float, float], width_px: int = 1
) -> Plane:
    """Return the intensity along a line at steps of 1 px from its start, shape (N,) float32.

    width_px: that many parallel lines, 1 px apart and centred on the line, are reduced by their median.
    """
    length = float(np.hypot(end_px[0] - start_px[0], end_px[1] - start_px[1]))
    if length < 1.0:
        raise ValueError(f"a profile needs a line of 1 px or more, got {length:.3f} px")
    along_x, along_y = (end_px[0] - start_px[0]) / length, (end_px[1] - start_px[1]) / length
    step = np.arange(int(length) + 1, dtype=np.float64)[None, :]
    side = (np.arange(width_px, dtype=np.float64) - (width_px - 1) / 2.0)[:, None]
    x = start_px[0] + step * along_x - side * along_y
    y = start_px[1] + step * along_y + side * along_x
    return np.asarray(np.median(sample(plane, x, y), axis=0), dtype=np.float32)


def derivative(rows: Plane, sigma_px: float) -> Plane:
    """Return d/dx of each row of (N, L), smoothed by a Gaussian of `sigma_px`, same shape."""
    return np.asarray(
        cv2.filter2D(rows, cv2.CV_32F, derivative_kernel(sigma_px), borderType=cv2.BORDER_REPLICATE), dtype=np.float32
    )


def refine_peaks(rows: Plane, at: NDArray[np.intp]) -> Floats:
    """Return the sub-pixel place of the peak of each row of (N, L) near column `at` (N,), by a parabola.

    The answer stays within half a pixel of `at`, which must lie in 1..L-2.
    """
    index = np.arange(rows.shape[0])
    before, here, after = (rows[index, at + shift].astype(np.float64) for shift in (-1, 0, 1))
    curve = before - 2.0 * here + after
    shift = np.where(np.abs(curve) > 1e-9, 0.5 * (before - after) / np.where(np.abs(curve) > 1e-9, curve, 1.0), 0.0)
    return np.asarray(at + np.clip(shift, -0.5, 0.5), dtype=np.float64)


def edges(values: Plane, sigma_px: float = 1.0, least_strength: float = 5.0) -> list[Edge]:
    """Return all edges on a profile (N,) at least `least_strength` levels per px strong, in order along it."""
    if values.shape[0] < 3:
        return []
    slope = derivative(values[None, :].astype(np.float32), sigma_px)
    size = np.abs(slope[0])
    peaks = np.flatnonzero((size[1:-1] >= least_strength) & (size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1
    if peaks.size == 0:
        return []
    places = refine_peaks(np.repeat(np.abs(slope), peaks.size, axis=0), peaks)
    return [Edge(float(place), float(slope[0, peak])) for place, peak in zip(places, peaks, strict=True)]


def tukey(residual: Floats, scale: float) -> Floats:
    """Return Tukey's biweight, 1 at zero residual, 0 beyond TUKEY_REACH scales."""
    return np.asarray(np.square(np.maximum(1.0 - np.square(residual / (TUKEY_REACH * scale)), 0.0)), dtype=np.float64)


def quantile(values: Floats | Plane | Gray, share: float = 0.5) -> float:
    """Return the value that `share` (0..1) of `values` lie below: a median or quantile without interpolation."""
    at = int(share * (values.size - 1))
    return float(np.partition(values, at, axis=None)[at])


def mad_sigma(residual: Floats, floor: float) -> float:
    """Return a robust standard deviation (1.4826 times the median absolute value), at least `floor`."""
    rank = residual.size // 2
    return max(1.4826 * float(np.partition(np.abs(residual), rank)[rank]), floor) if residual.size else floor


def solve_normal(normal: Floats, right: Floats) -> Floats:
    """Solve normal @ p = right, normal (P, P) symmetric and positive; ValueError where it is not.

    LAPACK's Cholesky, called directly: for a handful of parameters numpy's checks cost more than the solving.
    """
    from scipy.linalg.lapack import dposv  # noqa: PLC0415  # a third of what a start would load, see `vision.warm`

    _, parameters, info = dposv(normal, right)
    if info != 0:
        raise ValueError("the normal equations are singular: the points do not determine the parameters")
    return np.asarray(parameters, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Fit:
    """Hold a robust linear fit: parameters (P,), their covariance (P, P), weights (N,), residual scale."""

    parameters: Floats
    covariance: Floats
    weights: Floats
    scale: float


def robust_fit(
    design: Floats,
    target: Floats,
    prior: Floats | None = None,
    start: Floats | None = None,
    floor: float = 0.03,
    ceiling: float = np.inf,
    rounds: int = 6,
) -> Fit:
    """Solve design @ p = target by least squares with Tukey weights, iterated from `start` (N,) weights.

    prior: (P,) standard deviation of each parameter about zero in the units of the parameter (inf = free).
    floor, ceiling: least and largest residual scale believed, px; the ceiling is reached in steps.
    """
    size = design.shape[1]
    pull = np.zeros(size) if prior is None else 1.0 / np.square(prior)
    weights = np.ones(design.shape[0]) if start is None else start
    scale = 1.0
    parameters: Floats = np.zeros(size)
    normal = np.eye(size)
    for turn in range(rounds):
        weighted = design.T * weights
        normal = weighted @ design
        normal.flat[:: size + 1] += pull * scale**2 + 1e-9
        parameters = solve_normal(normal, weighted @ target)
        residual = target - design @ parameters
        kept = residual[weights > 0.1]
        scale = mad_sigma(kept if kept.size > size else residual, floor)
        scale = max(min(scale, ceiling * (rounds - turn)), floor)
        weights = tukey(residual, scale)
    return Fit(parameters, np.asarray(np.linalg.inv(normal) * scale**2), weights, scale)


def fit_straight_edge(
    plane: Plane | Gray,
    start_px: tuple[float, float],
    end_px: tuple[float, float],
    reach_px: float,
    *,
    rising: bool | None = None,
    calipers: int = 40,
) -> Line | None:
    """Fit a straight edge near the line start..end with many calipers across it; None if fewer than 5 agree.

    reach_px: half length of each caliper. rising: only edges that grow brighter to the right of start -> end (as seen
    with y down, that is along the direction turned from x towards y), or darker, or either (None).
    """
    length = float(np.hypot(end_px[0] - start_px[0], end_px[1] - start_px[1]))
    if length < 2.0:
        raise ValueError(f"a straight edge needs a line of 2 px or more, got {length:.3f} px")
    along_x, along_y = (end_px[0] - start_px[0]) / length, (end_px[1] - start_px[1]) / length
    step = np.linspace(0.0, length, calipers)[:, None]
    reach = int(np.ceil(reach_px)) + 4
    across = np.arange(-reach, reach + 1, dtype=np.float64)[None, :]
    x, y = start_px[0] + step * along_x - across * along_y, start_px[1] + step * along_y + across * along_x
    slope = derivative(sample(plane, x, y), 1.2)
    wanted = np.abs(slope) if rising is None else (slope if rising else -slope)
    inner = wanted[:, 4:-4]
    peak = np.argmax(inner, axis=1) + 4
    strength = wanted[np.arange(calipers), peak]
    good = (strength > 0.3 * float(np.percentile(strength, 80))) & (strength > 2.0)
    if np.count_nonzero(good) < 5:
        return None
    at = refine_peaks(wanted[good], peak[good]) - reach
    along = step[good, 0]
    middle = length / 2.0
    fit = robust_fit(np.stack([np.ones_like(along), along - middle], axis=1), at)
    used = int(np.count_nonzero(fit.weights > 0.3))
    if used < 5:
        return None
    offset, slant = (float(number) for number in fit.parameters)
    return Line(
        x_px=start_px[0] + middle * along_x - offset * along_y,
        y_px=start_px[1] + middle * along_y + offset * along_x,
        angle_rad=float(np.arctan2(along_y, along_x) + np.arctan(slant)),
        sigma_px=float(np.sqrt(fit.covariance[0, 0])),
        used=used,
        offered=calipers,
    )
