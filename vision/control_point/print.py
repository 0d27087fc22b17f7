"""Checks of a control point: whether two measured lines are its arms.

What is measured must be a print: arms of one width and one darkness on paper, straight, not tapered, not dashed, and
none of them missing where the paper is bare. A crossing of which this cannot be said is none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.control_point.proposals import LEAST_DEPTH
from vision.control_point.strip import ArmStrip, axis_levels
from vision.core import Fit, Floats, Plane, mad_sigma, robust_fit

Flags = NDArray[np.bool_]
Sides = tuple[bool, bool]
Point = tuple[float, float]
EXPECTED = (0.15, 0.85)
"""Where arms are expected whatever their length."""
LARGEST_WIDTH_RATIO, LARGEST_STEP_RATIO = 1.3, 1.45
"""Widths differ by foreshortening (cos 33 deg and some scatter), darkness by the fall-off of light."""
LARGEST_TAPER = 0.03
"""A probe widens by a tenth and more."""
TAPER_STATIONS = 25
"""A taper shows on no fewer stations."""
LARGEST_SCATTER_PX = 0.6
LEAST_CONTRAST = 0.35
"""Toner is darker than paper by at least this share of the paper's level."""
BARE_SHARE = 0.06
"""Paper is bare where its level is that of the paper round the arms, to this share of the step from toner to paper."""
MOST_BARE = 0.4
STUB_PX = (2.0, 6.0)
"""An arm that begins, and is then cut off, is no missing one: seen so far beyond the other arm's edge, px."""
MOST_BROKEN = 0.15
"""So much of an arm may look bare between its first and its last station, for dirt and glints."""


@dataclass(frozen=True, slots=True)
class PrintedLine:
    """Hold a line through the centre: a point on it, direction (rad), width of its arms, which of the two are measured.

    whole: nothing that was seen of the line is left out.
    """

    foot: Point
    angle: float
    width: float
    sides: Sides
    whole: bool


@dataclass(frozen=True, slots=True)
class Fitted:
    """Hold a line's stations, the fit of their middle (offset, slant), and which stations it stands on."""

    strip: ArmStrip
    fit: Fit
    used: Flags


def why_no_print(
    raw: Plane, at: Point, lines: tuple[PrintedLine, PrintedLine], fitted: tuple[Fitted, Fitted], arm_px: float
) -> str:
    """Say what shows that two lines through `at` are no control point's; empty where nothing does."""
    return _not_printed(lines, fitted) or _bare(raw, at, lines, fitted, arm_px)


def _not_printed(lines: tuple[PrintedLine, PrintedLine], fitted: tuple[Fitted, Fitted]) -> str:
    """Say what of the measured arms no print has; empty where they look printed."""
    widths = [line.width for line in lines]
    steps = [one.strip.step for one in fitted]
    if max(widths) > LARGEST_WIDTH_RATIO * min(widths):
        return f"its arms are {widths[0]:.1f} and {widths[1]:.1f} px wide"
    if min(steps) < LEAST_DEPTH or max(steps) > LARGEST_STEP_RATIO * min(steps):
        return f"its arms are {steps[0]:.0f} and {steps[1]:.0f} levels darker than what they lie on"
    papers = [float(np.median(one.strip.paper[one.used])) for one in fitted]
    if min(step / paper for step, paper in zip(steps, papers, strict=True)) < LEAST_CONTRAST:
        return f"its arms are {steps[0]:.0f} and {steps[1]:.0f} levels darker than their ground of {papers[0]:.0f}"
    for one in fitted:
        if one.fit.scale > LARGEST_SCATTER_PX:
            return f"its arms are not straight to {LARGEST_SCATTER_PX} px"
        for way in (1.0, -1.0):
            mine = one.used & (one.strip.along * way > 0.0)
            if np.count_nonzero(mine) >= TAPER_STATIONS and abs(_taper(one.strip, mine)) > LARGEST_TAPER:
                return "one of its arms tapers as a needle does"
    return ""


def _taper(strip: ArmStrip, mine: Flags) -> float:
    """Return how much the strip widens from the centre outwards, px per px."""
    away = np.abs(strip.along[mine])
    fit = robust_fit(np.stack([np.ones_like(away), away], axis=1), strip.width[mine], ceiling=0.7, rounds=4)
    return float(fit.parameters[1])


def _bare(
    raw: Plane, at: Point, lines: tuple[PrintedLine, PrintedLine], fitted: tuple[Fitted, Fitted], arm_px: float
) -> str:
    """Say which arm is missing, or broken, where nothing hides it; empty where none is."""
    paper, noise = _paper(lines, fitted)
    step = min(one.strip.step for one in fitted)
    slack = max(BARE_SHARE * step, 2.5 * noise)
    for line, one in zip(lines, fitted, strict=True):
        for way in (1.0, -1.0):
            seen = one.strip.along[one.used] * way
            last = max(float(seen.max()), EXPECTED[1] * arm_px)
            away = np.arange(0.0, last, 1.5)
            c, s = way * float(np.cos(line.angle)), way * float(np.sin(line.angle))
            angle = float(np.arctan2(s, c))
            off = axis_levels(raw, at, angle, away) - (paper[0] + away * (paper[1] * c + paper[2] * s))
            bare = np.abs(off) < slack
            near = (away > line.width / 2.0 + STUB_PX[0]) & (away < line.width / 2.0 + STUB_PX[1])
            goes_on = float(np.mean(off[near])) < -0.5 * step
            expected = (away > EXPECTED[0] * arm_px) & (away < EXPECTED[1] * arm_px)
            if float(np.mean(bare[expected])) > MOST_BARE and not goes_on:
                return f"the arm towards {np.degrees(angle) % 360.0:.0f} degrees is missing though nothing hides it"
            mine = seen[seen > 0.0]
            within = (away > mine.min()) & (away < mine.max()) if mine.size else away < 0.0
            if within.any() and float(np.mean(bare[within])) > MOST_BROKEN:
                return f"the arm towards {np.degrees(angle) % 360.0:.0f} degrees is broken though nothing hides it"
    return ""


def _paper(lines: tuple[PrintedLine, PrintedLine], fitted: tuple[Fitted, Fitted]) -> tuple[Floats, float]:
    """Return the paper's level as a plane (constant, along x, along y; from the centre), and the scatter about it."""
    places, levels = [], []
    for line, one in zip(lines, fitted, strict=True):
        along = one.strip.along[one.used]
        places.append(np.stack([np.ones_like(along), along * np.cos(line.angle), along * np.sin(line.angle)], axis=1))
        levels.append(one.strip.paper[one.used])
    place, level = np.concatenate(places), np.concatenate(levels)
    plane = np.asarray(np.linalg.lstsq(place, level, rcond=None)[0], dtype=np.float64)
    return plane, mad_sigma(level - place @ plane, 0.5)
