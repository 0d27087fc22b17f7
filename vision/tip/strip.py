"""Straightened strip of the image along the probe, and what can be read off its rows and columns.

Strip coordinates: u runs along the probe towards its end and is 0 where the end is expected, v runs across it,
turned from u as y is from x.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vision.core import Floats, Plane, derivative

CALIPER_STEP_PX = 4
"""Rows between two calipers; the strip is averaged over as many rows plus one, so that neighbours hardly share
noise."""
END_CLEARANCE_PX = 25
"""Clear of the end, of the rims' bow, and as far up the cylinder as the axis needs."""
RIM_CLEARANCE_PX = 22
CYLINDER_LENGTH_PX = 130
EDGE_SIGMA_PX = 0.8
LEAST_TAPER = 0.02
"""A probe that narrows by less, px per px, is blunt."""
GROUND_SHARE, LEAST_GROUND = 0.05, 4.0
"""Levels this far above black, as a share of the brightest, are compared by ratio: below lies noise."""
_NEXT, _BESIDE = np.ones((1, 3), dtype=np.uint8), np.ones((1, 5), dtype=np.uint8)


@dataclass(frozen=True, slots=True)
class ProbeShape:
    """Tell the probe's sizes: half widths grow from `end_half_px` by `taper_slope` px per px up to the marking.

    A summary of the taught `Silhouette` by a straight taper; what is measured is measured against the silhouette. A
    blunt needle (round, flat, cupped, crowned) does not narrow: its slope is 0, or negative where its head is wider.
    """

    end_to_rim_px: float
    marking_px: float
    end_half_px: float
    taper_slope: float
    cylinder_half_px: float

    def half_width(self, u_px: Floats) -> Floats:
        """Return the half width at `u_px` (0 = end, negative towards the barrel), px."""
        taper = self.end_half_px - self.taper_slope * u_px
        return np.where(u_px < -self.end_to_rim_px, self.cylinder_half_px, taper)

    @property
    def tapers(self) -> bool:
        """Whether it narrows enough for its width to tell where along it a place is."""
        return self.taper_slope > LEAST_TAPER

    @property
    def length_px(self) -> float:
        """Return how far above the end the probe is measured, px."""
        return self.end_to_rim_px + self.marking_px + RIM_CLEARANCE_PX + CYLINDER_LENGTH_PX + CALIPER_STEP_PX


@dataclass(frozen=True, slots=True)
class ProbeStrip:
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


def straighten(
    plane: Plane, at_px: tuple[float, float], angle_rad: float, u_from_px: int, u_to_px: int, reach_px: int
) -> ProbeStrip:
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
    laid: Plane = np.asarray(cv2.warpAffine(plane, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE))
    low, high = quantiles(laid[::6, ::5], 0.05, 0.99)
    return ProbeStrip(
        pixels=laid,
        x_px=at_px[0],
        y_px=at_px[1],
        angle_rad=angle_rad,
        u_from_px=u_from_px,
        reach_px=reach_px,
        edge_level=max(0.05 * (high - low), 2.0),
    )


def around(plane: Plane, at_px: tuple[float, float], angle_rad: float, shape: ProbeShape, spare_px: int) -> ProbeStrip:
    """Return the strip that holds the whole measured probe and `spare_px` more on every side."""
    above, aside = int(shape.length_px) + spare_px, int(shape.cylinder_half_px) + 10 + spare_px
    return straighten(plane, at_px, angle_rad, -above, 24 + spare_px, aside)


def quantiles(values: Plane, low: float, high: float) -> tuple[float, float]:
    """Return two quantiles (0..1) of all values; the nearest ranks, not interpolated."""
    at_low, at_high = int(low * (values.size - 1)), int(high * (values.size - 1))
    ordered = np.partition(values.ravel(), (at_low, at_high))
    return float(ordered[at_low]), float(ordered[at_high])


def upper_median(values: Floats | Plane) -> float:
    """Return the median (the upper of two middle values), several times faster than numpy's median on short arrays.

    NaN for none at all: whatever it is compared with, nothing is concluded from it.
    """
    if values.size == 0:
        return float("nan")
    rank = values.size // 2
    return float(np.partition(values.ravel(), rank)[rank])


def across_slope(strip: ProbeStrip, *, by_ratio: bool = False) -> Plane:
    """Return d/dv of the strip, averaged along u over a caliper's own rows, levels per px.

    by_ratio: of the brightness' logarithm instead, scaled to the same range of levels: the dim flank of a probe lit
    from one side then shows more than the end of the light on it.
    """
    averaged: Plane = np.asarray(cv2.blur(strip.pixels, (1, CALIPER_STEP_PX + 1)), dtype=np.float32)
    return derivative(_logarithm(averaged) if by_ratio else averaged, EDGE_SIGMA_PX)


def _logarithm(levels: Plane) -> Plane:
    """Return the logarithm of some levels above their darkness, scaled to the range of levels."""
    low, high = quantiles(levels[::6, ::5], 0.05, 0.99)
    ground = max(GROUND_SHARE * high, LEAST_GROUND)
    scale = (high - low) / max(float(np.log((high + ground) / (low + ground))), 1e-3)
    return np.asarray(scale * np.log(np.maximum(levels, 0.0) + ground), dtype=np.float32)


def edge_maps(slope: Plane, edge_level: float) -> tuple[Plane, Plane]:
    """Return where (rows, columns) an edge brightens towards +v, and towards -v: 0 or 1, with one column to spare.

    Only the steepest place of an edge counts, so that strong and blurred edges are as narrow as weak and sharp ones.
    """
    return _edge_map(slope, edge_level), _edge_map(-slope, edge_level)


def _edge_map(slope: Plane, edge_level: float) -> Plane:
    steepest = (slope >= cv2.dilate(slope, _BESIDE)) & (slope > edge_level)
    return np.asarray(cv2.dilate(steepest.astype(np.float32), _NEXT), dtype=np.float32)


def middle_profile(strip: ProbeStrip, axis: tuple[float, float], half_px: int) -> Plane:
    """Return the median brightness of the probe's middle (+-half_px) along u, one value per row of the strip."""
    u = np.arange(strip.pixels.shape[0]) + strip.u_from_px
    centre = np.rint(axis[0] + axis[1] * u).astype(np.intp) + strip.reach_px
    columns = np.clip(centre[:, None] + np.arange(-half_px, half_px + 1), 0, strip.pixels.shape[1] - 1)
    picked = np.take_along_axis(strip.pixels, columns, axis=1)
    return np.asarray(np.partition(picked, half_px, axis=1)[:, half_px], dtype=np.float32)
