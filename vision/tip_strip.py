"""Lay the needle straight and measure it: its two outer edges, its axis, the rims of its marking.

Strip coordinates: u runs along the needle towards its end and is 0 where the end is expected, v runs across it,
turned from u as y is from x. The silhouette is symmetric about the axis v = a + b u; its half width is known from
teaching, which is what tells the outer edges from the highlights inside and the pads behind.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.caliper import Fit, Floats, derivative, refine_peaks, robust_fit
from vision.image import Plane

# Rows between two calipers; the strip is averaged over as many rows plus one, so that neighbours hardly share noise.
CALIPER_STEP_PX = 4
# Clear of the end, of the rims' bow, and as far up the cylinder as the axis needs.
END_CLEARANCE_PX = 25
RIM_CLEARANCE_PX = 22
CYLINDER_LENGTH_PX = 130
# Below this the needle is so thin that highlights lie beside its edges and pull them: such points show a bend, but the
# axis is fitted without them.
THIN_END_PX = 65.0
EDGE_SIGMA_PX = 0.8
RIM_SIGMA_PX = 1.5


@dataclass(frozen=True, slots=True)
class NeedleShape:
    """Hold the taught silhouette: half widths grow from `end_half_px` by `taper_slope` px per px up to the marking."""

    end_to_rim_px: float
    marking_px: float
    end_half_px: float
    taper_slope: float
    cylinder_half_px: float

    def half_width(self, u_px: Floats) -> Floats:
        """Return the half width at `u_px` (0 = end, negative towards the barrel), px."""
        taper = self.end_half_px - self.taper_slope * u_px
        return np.where(u_px < -self.end_to_rim_px, self.cylinder_half_px, taper)


@dataclass(frozen=True, slots=True)
class Strip:
    """Hold a straightened piece: `pixels` (rows along u from `u_from_px`, columns v from -`reach_px`) and its place."""

    pixels: Plane
    x_px: float
    y_px: float
    angle_rad: float
    u_from_px: int
    reach_px: int
    # The slope (levels per px) from which an edge counts fully; it follows the light.
    edge_level: float

    def to_image(self, u_px: float, v_px: float) -> tuple[float, float]:
        """Return the image point (x, y) of a strip point, px."""
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        return float(self.x_px + u_px * c - v_px * s), float(self.y_px + u_px * s + v_px * c)


@dataclass(frozen=True, slots=True)
class EdgePoints:
    """Hold edge points in strip coordinates (N,): `side` is +1 for v > 0 (L2), -1 for v < 0 (L1).

    `brightens` (N,) bool: brighter inwards, as before a dark background. Before something brighter than the metal the
    edge darkens inwards, and its steepest place lies up to half a pixel elsewhere.
    """

    u_px: Floats
    v_px: Floats
    side: Floats
    brightens: NDArray[np.bool_]
    offered: int

    def where(self, keep: NDArray[np.bool_], offered: int) -> EdgePoints:
        """Return the points for which `keep` (N,) holds, of `offered` calipers."""
        return EdgePoints(self.u_px[keep], self.v_px[keep], self.side[keep], self.brightens[keep], offered)


@dataclass(frozen=True, slots=True)
class Axis:
    """Hold the fitted bisector v = a + b u with covariance (2, 2), the change of half widths, the edge support."""

    a_px: float
    b: float
    covariance: Floats
    taper_wider_px: float
    taper_slope_change: float
    cylinder_wider_px: float
    support: float
    scale_px: float

    def v_px(self, u_px: float) -> float:
        """Return the axis' place across the strip at `u_px`."""
        return self.a_px + self.b * u_px


@dataclass(frozen=True, slots=True)
class Rim:
    """Hold a marking rim: u of its taught shape's zero, its 1-sigma, the columns that agree (0..1), its strength."""

    u_px: float
    sigma_px: float
    agreement: float
    strength: float


def straighten(
    plane: Plane, at_px: tuple[float, float], angle_rad: float, u_from_px: int, u_to_px: int, reach_px: int
) -> Strip:
    """Resample `plane` (H, W) float32 so that the line through `at_px` along `angle_rad` becomes a column."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    matrix = np.array(
        [
            [-s, c, at_px[0] + u_from_px * c + reach_px * s],
            [c, s, at_px[1] + u_from_px * s - reach_px * c],
        ]
    )
    size = (2 * reach_px + 1, u_to_px - u_from_px + 1)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    pixels = cv2.warpAffine(plane, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    laid = np.asarray(pixels, dtype=np.float32)
    low, high = quantiles(laid[::6, ::5], 0.05, 0.99)
    level = max(0.05 * (high - low), 2.0)
    return Strip(laid, at_px[0], at_px[1], angle_rad, u_from_px, reach_px, level)


def quantiles(values: Plane, low: float, high: float) -> tuple[float, float]:
    """Return two quantiles (0..1) of all values; the nearest ranks, not interpolated."""
    at_low, at_high = int(low * (values.size - 1)), int(high * (values.size - 1))
    ordered = np.partition(values.ravel(), (at_low, at_high))
    return float(ordered[at_low]), float(ordered[at_high])


def caliper_rows(shape: NeedleShape) -> tuple[Floats, Floats]:
    """Return the u of the calipers on the taper and on the cylinder, px."""
    taper = np.arange(-shape.end_to_rim_px + RIM_CLEARANCE_PX / 2, -END_CLEARANCE_PX, CALIPER_STEP_PX)
    top = -shape.end_to_rim_px - shape.marking_px - RIM_CLEARANCE_PX
    return taper, np.arange(top - CYLINDER_LENGTH_PX, top, CALIPER_STEP_PX)


def across_slope(strip: Strip) -> Plane:
    """Return d/dv of the strip, averaged along u over a caliper's own rows, levels per px."""
    return derivative(np.asarray(cv2.blur(strip.pixels, (1, CALIPER_STEP_PX + 1)), dtype=np.float32), EDGE_SIGMA_PX)


def vote_axis(strip: Strip, slope: Plane, shape: NeedleShape, reach_px: int) -> tuple[float, float, float]:
    """Return (a, b, support 0..1) of the axis whose taught silhouette has the most edge under both its sides.

    Only edges that brighten inwards count, each at most once: a strong pad edge weighs no more than a weak needle
    edge, and highlights inside do not lie on the silhouette.
    """
    taper, cylinder = caliper_rows(shape)
    u = np.concatenate([taper, cylinder])
    rows = np.rint(u).astype(np.intp) - strip.u_from_px
    inside = (rows >= 0) & (rows < slope.shape[0])
    u, rows = u[inside], rows[inside]
    cap = strip.edge_level
    grow = np.ones((1, 3), dtype=np.uint8)
    rising = cv2.dilate(np.clip(slope[rows] / cap, 0.0, 1.0), grow)
    falling = cv2.dilate(np.clip(-slope[rows] / cap, 0.0, 1.0), grow)
    shifts = np.arange(-reach_px, reach_px + 1, 1.0)
    tilts = np.tan(np.radians(np.arange(-3.0, 3.01, 0.3)))
    axis = shifts[:, None, None] + tilts[None, :, None] * (u + 100.0)
    half = shape.half_width(u)
    index = np.arange(u.size)
    last = slope.shape[1] - 1
    right = np.clip(np.rint(axis - half).astype(np.intp) + strip.reach_px, 0, last)
    left = np.clip(np.rint(axis + half).astype(np.intp) + strip.reach_px, 0, last)
    score = np.mean(rising[index, right] + falling[index, left], axis=2) / 2.0
    best = np.unravel_index(int(np.argmax(score)), score.shape)
    tilt = float(tilts[best[1]])
    return float(shifts[best[0]]) + 100.0 * tilt, tilt, float(score[best])


def edge_points(
    strip: Strip,
    slope: Plane,
    shape: NeedleShape,
    axis: tuple[float, float],
    u_px: Floats,
    reach_px: int,
    *,
    either_way: bool = False,
) -> EdgePoints:
    """Return the sub-pixel outer edge points near the silhouette placed on `axis` (a, b), at rows `u_px`.

    Edges that brighten inwards, or, `either_way`, edges of both signs (a bright pad may lie behind the needle).
    """
    rows = np.rint(u_px).astype(np.intp) - strip.u_from_px
    inside = (rows >= 0) & (rows < slope.shape[0])
    rows, u = rows[inside], np.rint(u_px[inside])
    least = 0.4 * strip.edge_level
    window = np.arange(-reach_px, reach_px + 1)
    found: list[tuple[Floats, Floats, Floats, NDArray[np.bool_]]] = []
    for side in (-1.0, 1.0):
        inwards = -side * slope[rows]
        # Before a pad brighter than the metal the same edge darkens inwards; it counts, but less.
        wanted = np.maximum(inwards, -0.7 * inwards) if either_way else inwards
        expected = axis[0] + axis[1] * u + side * shape.half_width(u)
        # Inner edges may not be taken for the outer one where the needle is thin: never look past its middle.
        centre = np.clip(
            np.rint(expected).astype(np.intp) + strip.reach_px, reach_px + 1, slope.shape[1] - reach_px - 2
        )
        columns = centre[:, None] + window[None, :]
        part = np.take_along_axis(wanted, columns, axis=1)
        peak = np.argmax(part, axis=1)
        at = centre + peak - reach_px
        strength = part[np.arange(rows.size), peak]
        good = (strength > least) & (peak > 0) & (peak < 2 * reach_px)
        v = refine_peaks(wanted[good], at[good]) - strip.reach_px
        brightens = inwards[np.arange(rows.size), at] > 0.0
        found.append((u[good], v, np.full(v.shape, side), brightens[good]))
    u_all, v_all, sides, bright = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return EdgePoints(u_all, v_all, sides, bright, 2 * rows.size)


def fit_axis(points: EdgePoints, shape: NeedleShape, *, free_width: bool = False) -> Axis | None:
    """Fit bisector and half widths to edge points at once; None when too few agree.

    The six parameters are the axis (a, b), the taper's half width and slope, the cylinder's half width and slope, the
    last four as changes against what was taught; `free_width` drops the belief that they are small. The fit starts
    from all points, from the taper's and from the cylinder's, and the start most points agree with wins: clutter
    behind one part of the needle does not draw the axis away from the other.
    """
    if points.u_px.size < 10:
        return None
    on_taper = (points.u_px > -shape.end_to_rim_px).astype(np.float64)
    design = _axis_design(points, on_taper)
    target = points.v_px - points.side * shape.half_width(points.u_px)
    wide = 1e3 if free_width else 1.0
    prior = np.array([np.inf, np.inf, 0.5 * wide, 0.3 * wide, 0.7 * wide, 0.2])
    best: Fit | None = None
    for start in (np.ones_like(on_taper), on_taper + 1e-3, 1.001 - on_taper):
        fit = robust_fit(design, target, prior, start, ceiling=0.35)
        if best is None or np.sum(fit.weights) > np.sum(best.weights) + 1.0:
            best = fit
        if np.mean(fit.weights > 0.3) > 0.8:
            break
    if best is None or np.count_nonzero(best.weights > 0.3) < 8:
        return None
    return _axis_of(best, points)


def _axis_design(points: EdgePoints, on_taper: Floats) -> Floats:
    hundreds, side, above = points.u_px / 100.0, points.side, 1.0 - on_taper
    return np.stack(
        [
            np.ones_like(hundreds),
            hundreds,
            side * on_taper,
            side * on_taper * (-hundreds - 0.6),
            side * above,
            side * above * (-hundreds - 2.5),
        ],
        axis=1,
    )


def _axis_of(fit: Fit, points: EdgePoints) -> Axis:
    scaling = np.diag([1.0, 0.01])
    a, b, taper, taper_slope, cylinder, _ = (float(number) for number in fit.parameters)
    return Axis(
        a,
        b / 100.0,
        np.asarray(scaling @ fit.covariance[:2, :2] @ scaling),
        taper,
        taper_slope / 100.0,
        cylinder,
        float(np.count_nonzero(fit.weights > 0.3)) / max(points.offered, 1),
        fit.scale,
    )


def rim_columns(shape: NeedleShape) -> NDArray[np.intp]:
    """Return the columns v over which a rim is measured: the middle of the needle, where it faces the camera."""
    reach = max(3, int(0.3 * 2 * shape.cylinder_half_px))
    return np.arange(-reach, reach + 1)


def rim_places(
    strip: Strip, axis: tuple[float, float], columns: NDArray[np.intp], around_u_px: Floats, reach_px: int, sign: float
) -> tuple[Floats, Floats]:
    """Return (u of the rim, strength) per column: where brightness rises (sign +1) or falls (-1) fastest along u.

    around_u_px: (columns,) where to look, +-reach_px. The strip must hold those rows.
    """
    middle = float(np.mean(around_u_px))
    offset = int(np.rint(axis[0] + axis[1] * middle)) + strip.reach_px
    picked = np.clip(columns + offset, 0, strip.pixels.shape[1] - 1)
    profiles = np.ascontiguousarray(strip.pixels[:, picked].T)
    wanted = sign * derivative(profiles, RIM_SIGMA_PX)
    last = wanted.shape[1] - reach_px - 2
    centre = np.clip(np.rint(around_u_px).astype(np.intp) - strip.u_from_px, reach_px + 1, last)
    window = centre[:, None] + np.arange(-reach_px, reach_px + 1)[None, :]
    part = np.take_along_axis(wanted, window, axis=1)
    peak = np.argmax(part, axis=1)
    at = centre + peak - reach_px
    u = refine_peaks(wanted, at) + strip.u_from_px
    return u, part[np.arange(peak.size), peak].astype(np.float64)


def join_rim(u_px: Floats, strength: Floats, shape_px: Floats) -> Rim:
    """Reduce a rim's columns to one place, `shape_px` being the rim's taught form (0 at the axis)."""
    residual = u_px - shape_px
    fit = robust_fit(np.ones((residual.size, 1)), residual - float(np.median(residual)), floor=0.05)
    place = float(np.median(residual) + fit.parameters[0])
    agree = float(np.mean(np.abs(residual - place) < 1.5))
    # The blur makes neighbours share part of their noise: half of the columns count as independent.
    sigma = fit.scale * float(np.sqrt(2.0 / max(np.sum(fit.weights), 1.0)))
    return Rim(place, sigma, agree, float(np.median(strength)))


def middle_profile(strip: Strip, axis: tuple[float, float], half_px: int) -> Plane:
    """Return the median brightness of the needle's middle (+-half_px) along u, one value per row of the strip."""
    u = np.arange(strip.pixels.shape[0]) + strip.u_from_px
    centre = np.rint(axis[0] + axis[1] * u).astype(np.intp) + strip.reach_px
    columns = np.clip(centre[:, None] + np.arange(-half_px, half_px + 1)[None, :], 0, strip.pixels.shape[1] - 1)
    return np.asarray(np.median(np.take_along_axis(strip.pixels, columns, axis=1), axis=1), dtype=np.float32)
