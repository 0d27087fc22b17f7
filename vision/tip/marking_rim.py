"""Rims of the black marking: where, along the probe, its brightness changes fastest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.core import Floats, derivative, mad_sigma, refine_peaks, tukey
from vision.tip.strip import ProbeStrip, middle_profile, upper_median

RIM_SIGMA_PX = 1.5
RIM_SHARE = 0.75
"""The part of the half width a rim is measured over. Painted rims wander round the probe: the more of it is seen the
better it averages, but near the edges the surface turns away and the rim's bow grows steep."""
BLOCK_PX = 5
"""A rim wanders over about this much of the probe's width before it comes back: columns closer than that agree."""


@dataclass(frozen=True, slots=True)
class Rim:
    """Hold a marking rim: u of its taught shape's zero, its 1-sigma, the columns that agree (0..1), its strength."""

    u_px: float
    sigma_px: float
    agreement: float
    strength: float


def rim_columns(cylinder_half_px: float) -> NDArray[np.intp]:
    """Return the columns v over which a rim is taught and measured."""
    reach = max(4, int(RIM_SHARE * cylinder_half_px))
    return np.arange(-reach, reach + 1)


def rim_places(
    strip: ProbeStrip,
    axis: tuple[float, float],
    columns: NDArray[np.intp],
    around_u_px: Floats,
    reach_px: int,
    sign: float,
) -> tuple[Floats, Floats]:
    """Return (u of the rim, strength) per column: where brightness rises (sign +1) or falls (-1) fastest along u.

    around_u_px: (columns,) where to look, +-reach_px. The strip must hold those rows.
    """
    height = strip.pixels.shape[0]
    first = max(int(np.min(around_u_px)) - strip.u_from_px - reach_px - 8, 0)
    last = min(int(np.max(around_u_px)) - strip.u_from_px + reach_px + 9, height)
    offset = int(np.rint(axis[0] + axis[1] * float(np.mean(around_u_px)))) + strip.reach_px
    picked = np.clip(columns + offset, 0, strip.pixels.shape[1] - 1)
    wanted = sign * derivative(np.ascontiguousarray(strip.pixels[first:last, picked].T), RIM_SIGMA_PX)
    centre = np.rint(around_u_px).astype(np.intp) - strip.u_from_px - first
    centre = np.clip(centre, reach_px + 1, wanted.shape[1] - reach_px - 2)
    index = np.arange(columns.size)
    part = wanted[index[:, None], centre[:, None] + np.arange(-reach_px, reach_px + 1)]
    peak = np.argmax(part, axis=1)
    at = centre + peak - reach_px
    return refine_peaks(wanted, at) + strip.u_from_px + first, part[index, peak].astype(np.float64)


def join_rim(columns: NDArray[np.intp], half_px: float, u_px: Floats, strength: Floats, form_px: Floats) -> Rim:
    """Reduce a rim's columns to one place, `form_px` being the rim's taught form (0 at the axis).

    Each column counts for as much of the probe's girth as it shows; torn columns do not count. The 1-sigma comes from
    how much whole blocks of neighbouring columns differ, since what frays a rim frays neighbours together.
    """
    girth = 1.0 / np.sqrt(np.maximum(1.0 - np.square(columns / half_px), 0.2))
    residual = u_px - form_px
    place = upper_median(residual)
    for _ in range(4):
        scale = max(mad_sigma(residual - place, 0.15), 0.15)
        weights = girth * tukey(residual - place, scale)
        place = float(np.sum(weights * residual) / max(np.sum(weights), 1e-9))
    agree = float(np.mean(np.abs(residual - place) < max(1.5, 2.5 * min(scale, 1.0))))
    return Rim(place, _block_sigma(residual - place, weights), agree, upper_median(strength))


def _block_sigma(residual: Floats, weights: Floats) -> float:
    """Return the 1-sigma of the weighted mean of `residual`, neighbours being dependent within blocks."""
    count = max(residual.size // BLOCK_PX, 2)
    block = np.minimum(np.arange(residual.size) * count // residual.size, count - 1)
    total = max(float(np.sum(weights)), 1e-9)
    sums = np.bincount(block, weights * residual, minlength=count) / total
    return float(np.sqrt(np.sum(np.square(sums)) * count / (count - 1)))


def marking_levels(
    strip: ProbeStrip, axis: tuple[float, float], rim1_u_px: float, rim2_u_px: float
) -> tuple[float, float]:
    """Return the brightness of the metal on both sides of the marking, and of the marking itself, levels."""
    values = middle_profile(strip, axis, 6)
    at1, at2 = int(rim1_u_px) - strip.u_from_px, int(rim2_u_px) - strip.u_from_px
    inside = values[max(at1 + 8, 0) : max(at2 - 8, 1)]
    outside = np.concatenate([values[max(at1 - 24, 0) : max(at1 - 6, 0)], values[max(at2 + 6, 0) : max(at2 + 24, 0)]])
    if inside.size == 0 or outside.size == 0:
        return 0.0, 0.0
    return upper_median(outside), upper_median(inside)
