"""Measurement of a dark strip with two parallel edges, station by station, and of the line in the middle of the two.

Coordinates are those of the line: `along` it from a point given, `across` it to the right as seen (x towards y).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.control_point.proposals import WIDEST_ARM_PX
from vision.core import Floats, Plane, derivative, mad_sigma, quantile, refine_peaks, robust_fit, sample

Flags = NDArray[np.bool_]
NARROWEST_ARM_PX = 1.5
EDGE_SIGMA_PX = 1.2
FLANK_PX = (3.0, 5.0)
"""Paper is judged this far outside an edge, where the edge's blur has ended, px."""
MARGIN_PX = 9
SEARCH_PX = 2.0
"""An edge of a station is sought this far from where the strip should have it, px."""
LEAST_STRENGTH, LEAST_STEP = 0.45, 0.75
"""Shares of the typical strength of an edge, and of the typical step from strip to paper, that a station must have."""
WIDTH_SLACK_PX = 0.5
"""Widths scatter by toner and noise; what lies further off than three scales, and this, is something else, px."""
LEAST_STATIONS = 10


@dataclass(frozen=True, slots=True)
class ArmStrip:
    """Hold a strip's stations, each array (N,): along, middle and width (px), levels, and which stations are good.

    axis: level on the middle line. paper: level beside the strip, the darker of its two sides. step: typical rise from
    strip to paper.
    """

    along: Floats
    middle: Floats
    width: Floats
    axis: Floats
    paper: Floats
    good: Flags
    width_px: float
    step: float


@dataclass(frozen=True, slots=True)
class RoughArm:
    """Hold a first idea of an arm: offset (px) at its foot, slant against the direction given, width (px)."""

    offset_px: float
    slant: float
    width_px: float


def _rows(raw: Plane, at: tuple[float, float], angle: float, along: Floats, across: Floats) -> Plane:
    """Return brightness (stations, across), smoothed over three stations."""
    c, s = np.cos(angle), np.sin(angle)
    xs = at[0] + along[:, None] * c - across[None, :] * s
    ys = at[1] + along[:, None] * s + across[None, :] * c
    return np.asarray(cv2.blur(sample(raw, xs, ys), (1, 3)), dtype=np.float32)


def axis_levels(raw: Plane, at: tuple[float, float], angle: float, along: Floats) -> Floats:
    """Return the level on a line (N,), each the mean of three by three places."""
    return np.asarray(_rows(raw, at, angle, along, np.array([-1.0, 0.0, 1.0])).mean(axis=1), dtype=np.float64)


def rough_arms(raw: Plane, at: tuple[float, float], angles: tuple[float, ...], arm_px: float) -> list[RoughArm | None]:
    """Find arms that run from about `at` along each of `angles` (rad), roughly; None where none does.

    All are looked for at once, which is what makes it fast.
    """
    along = np.arange(0.15 * arm_px, 0.95 * arm_px, max(2.0, arm_px / 40.0))
    reach = int(WIDEST_ARM_PX) + 6
    across = np.arange(-reach, reach + 1, dtype=np.float64)
    rows = np.concatenate([_rows(raw, at, angle, along, across) for angle in angles])
    places, widths, strength = _strongest_pairs(derivative(rows, EDGE_SIGMA_PX))
    parts = [slice(k * along.size, (k + 1) * along.size) for k in range(len(angles))]
    return [_rough(along, places[part] - reach, widths[part], strength[part]) for part in parts]


def _rough(along: Floats, places: Floats, widths: Floats, strength: Floats) -> RoughArm | None:
    good = (widths > NARROWEST_ARM_PX) & (strength > max(0.3 * quantile(strength, 0.8), 2.0))
    least = max(0.3 * along.size, 6.0)
    if np.count_nonzero(good) < least:
        return None
    typical = quantile(widths[good])
    good &= np.abs(widths - typical) < 1.5
    if np.count_nonzero(good) < least:
        return None
    design = np.stack([np.ones(np.count_nonzero(good)), along[good]], axis=1)
    fit = robust_fit(design, places[good], ceiling=0.5, rounds=4)
    if np.count_nonzero(fit.weights > 0.3) < least:
        return None
    return RoughArm(float(fit.parameters[0]), float(fit.parameters[1]), typical)


def _strongest_pairs(slope: Plane) -> tuple[Floats, Floats, Floats]:
    """Return middle, width and strength of the strongest dark line on each row: a falling edge, then a rising one."""
    centre = slope.shape[1] // 2
    falls, rises = np.maximum(-slope, 0.0), np.maximum(slope, 0.0)
    count = slope.shape[0]
    best, at_fall, gaps = np.zeros(count), np.zeros(count, dtype=np.intp), np.zeros(count, dtype=np.intp)
    index = np.arange(count)
    off = int(WIDEST_ARM_PX) // 2 + 2
    for gap in range(2, int(WIDEST_ARM_PX) + 1):
        low, high = max(centre - gap // 2 - off, 1), min(centre - gap // 2 + off, slope.shape[1] - gap - 1)
        pair = np.minimum(falls[:, low:high], rises[:, low + gap : high + gap])
        peak = np.argmax(pair, axis=1)
        strength = pair[index, peak]
        better = strength > best
        best[better], at_fall[better], gaps[better] = strength[better], low + peak[better], gap
    last = slope.shape[1] - 2
    first = refine_peaks(falls, np.clip(at_fall, 1, last))
    second = refine_peaks(rises, np.clip(at_fall + gaps, 1, last))
    return (first + second) / 2.0, second - first, best


def measure_strip(raw: Plane, at: tuple[float, float], angle: float, width_px: float, along: Floats) -> ArmStrip | None:
    """Measure the strip of about `width_px` whose middle runs through `at` along `angle`; None where there is none."""
    height, width = raw.shape
    x, y = at[0] + along * np.cos(angle), at[1] + along * np.sin(angle)
    reach = int(np.ceil(width_px / 2.0)) + MARGIN_PX
    edge = reach - 1.0
    along = along[(x > edge) & (y > edge) & (x < width - 1 - edge) & (y < height - 1 - edge)]
    if along.size < LEAST_STATIONS:
        return None
    across = np.arange(-reach, reach + 1, dtype=np.float64)
    rows = _rows(raw, at, angle, along, across)
    slope = derivative(rows, EDGE_SIGMA_PX)
    left, fall = _edge(-slope, reach - width_px / 2.0)
    right, rise = _edge(slope, reach + width_px / 2.0)
    axis = rows[:, reach - 1 : reach + 2].mean(axis=1)
    inside = rows[:, np.abs(across) <= max(width_px / 2.0 - 2.0, 0.5)].mean(axis=1)
    flank = (np.abs(across) >= width_px / 2.0 + FLANK_PX[0]) & (np.abs(across) <= width_px / 2.0 + FLANK_PX[1])
    paper = np.minimum(rows[:, flank & (across < 0)].mean(axis=1), rows[:, flank & (across > 0)].mean(axis=1))
    weakest = np.minimum(fall, rise)
    good = weakest > max(LEAST_STRENGTH * quantile(weakest, 0.7), 2.0)
    if np.count_nonzero(good) < LEAST_STATIONS:
        return None
    step = quantile((paper - inside)[good], 0.6)
    good &= paper - inside > LEAST_STEP * step
    widths = right - left
    if np.count_nonzero(good) < LEAST_STATIONS:
        return None
    typical = quantile(widths[good])
    slack = max(3.0 * mad_sigma(widths[good] - typical, 0.05), WIDTH_SLACK_PX)
    good &= np.abs(widths - typical) < min(slack, 1.5)
    if np.count_nonzero(good) < LEAST_STATIONS:
        return None
    return ArmStrip(
        along=along,
        middle=(left + right) / 2.0 - reach,
        width=widths,
        axis=axis,
        paper=paper,
        good=good,
        width_px=typical,
        step=step,
    )


def _edge(rows: Plane, about: float) -> tuple[Floats, Floats]:
    """Return place and strength of the strongest rise of each row near column `about`."""
    low = max(int(np.floor(about - SEARCH_PX)), 1)
    high = min(int(np.ceil(about + SEARCH_PX)) + 1, rows.shape[1] - 1)
    peak = np.argmax(rows[:, low:high], axis=1) + low
    return refine_peaks(rows, peak), rows[np.arange(rows.shape[0]), peak].astype(np.float64)
