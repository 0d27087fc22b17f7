"""Dim flank of a probe lit from one side: which it is, and where on it the light is down to half.

The probe hides what lies behind it, so the place where its brightness falls to a share of its own metal's does not
depend on the background; the flank's edge does, up to being lost before a board as bright as the flank.
"""

from __future__ import annotations

import cv2
import numpy as np

from vision.core import Floats
from vision.tip.silhouette import Silhouette
from vision.tip.strip import CALIPER_STEP_PX, ProbeStrip, across_slope

DIM_SHARE = 0.6
"""One side is the dim one when its edge is so much weaker than the other's."""
HALF_LIGHT = 0.5
"""The level, of the metal's about the axis, that is looked for."""
MIDDLE_SHARE = 0.5
LEAST_SHADE = 0.7
"""Share of rows that must show the level for a probe to be taught."""


def dim_side(strip: ProbeStrip, outline: Silhouette) -> int:
    """Return the side (-1 or +1) with the weaker edge; ValueError when they are alike."""
    slope = across_slope(strip)
    rows = np.clip(np.rint(outline.u_px).astype(np.intp) - strip.u_from_px, 0, slope.shape[0] - 1)
    strengths = []
    for side, edge in ((-1.0, outline.left_px), (1.0, outline.right_px)):
        columns = np.rint(edge).astype(np.intp) + strip.reach_px
        near = np.clip(columns[:, None] + np.arange(-1, 2), 0, slope.shape[1] - 1)
        strengths.append(float(np.median(np.max(-side * slope[rows[:, None], near], axis=1))))
    left, right = strengths
    if min(left, right) > DIM_SHARE * max(left, right):
        raise ValueError(
            "the light ends on the needle itself and its edges cannot be told apart from that: light the needle more "
            "evenly"
        )
    return -1 if left < right else 1


def taught_shade_px(strip: ProbeStrip, outline: Silhouette, side: int) -> Floats:
    """Return v (N,) where the light on the dim side is down to half; ValueError when that is not seen."""
    shade = _crossing_px(strip, (0.0, 0.0), outline, side)
    seen = np.isfinite(shade)
    for part in (outline.on_taper, ~outline.on_taper):
        if np.mean(seen[part]) < LEAST_SHADE:
            raise ValueError("the needle is lit from one side too weakly: give it more light, or from both sides")
    return np.interp(outline.u_px, outline.u_px[seen], shade[seen])


def shade_px(strip: ProbeStrip, axis: tuple[float, float], outline: Silhouette) -> Floats:
    """Return v (N,) from the axis (a, b) where the light on the dim side is down to half, NaN where it is not."""
    return _crossing_px(strip, axis, outline, outline.dim_side)


def _crossing_px(strip: ProbeStrip, axis: tuple[float, float], outline: Silhouette, side: int) -> Floats:
    """Return the first place from the axis to the dim side that is darker than half the metal about the axis."""
    levels = cv2.blur(strip.pixels, (3, CALIPER_STEP_PX + 1))
    rows = np.rint(outline.u_px).astype(np.intp) - strip.u_from_px
    inside = (rows >= 0) & (rows < levels.shape[0])
    rows = np.clip(rows, 0, levels.shape[0] - 1)[:, None]
    at = axis[0] + axis[1] * outline.u_px + strip.reach_px

    def read(off_axis: Floats) -> Floats:
        columns = np.rint(at[:, None] + off_axis).astype(np.intp)
        return np.asarray(levels[rows, np.clip(columns, 0, levels.shape[1] - 1)], dtype=np.float64)

    share = np.linspace(-MIDDLE_SHARE, MIDDLE_SHARE, 9)
    metal = np.median(read(outline.half_px[:, None] * share), axis=1)
    steps = np.arange(0.0, float(outline.half_px.max()) + 6.0)
    dark = read(np.broadcast_to(side * steps, (at.size, steps.size))) < HALF_LIGHT * metal[:, None]
    # Rounding to whole pixels is made good: the column read, not the one asked for, is what was dark.
    first = np.argmax(dark, axis=1)
    place = np.rint(at + side * steps[first]) - at
    return np.where(inside & dark.any(axis=1), place, np.nan)
