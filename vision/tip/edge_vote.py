"""Vote for the probe's axis: the line that has the most edge where the taught outline puts the two edges.

Each caliper votes at most once, however strong its edge: a bright pad weighs no more than a dull probe.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vision.core import Floats, Plane
from vision.tip.silhouette import Silhouette
from vision.tip.strip import ProbeStrip, edge_maps, upper_median

SHIFTS_PX: Floats = np.arange(-12.0, 12.1)
TILTS: Floats = np.tan(np.radians(np.arange(-2.5, 2.51, 0.5)))
DARKENING_WORTH = np.float32(0.7)
"""An edge that darkens inwards is one before something brighter than the metal: it counts, but less."""
AWAY_WORTH = 0.04
"""The template knows the probe to a few px: a place so much further away has to show so much more (0..1) of its
edges."""
LEAST_OF_STEEPEST = 0.6
"""Where only one edge votes, a highlight's border must not pass for it: so much of the usual steepest slope is
asked."""


@dataclass(frozen=True, slots=True)
class Vote:
    """Hold the line v = a + b u with the most votes and the share (0..1) of the calipers' edges that lie on it."""

    a_px: float
    b: float
    share: float


def vote(strip: ProbeStrip, slope: Plane, outline: Silhouette, pivot_u_px: float) -> Vote:
    """Return the line with the most votes within +-12 px, at u = `pivot_u_px`, and +-2.5 degrees of the strip's own.

    slope: d/dv of the strip, by ratio when the outline has a dim side, which then has no vote. Rows of the outline that
    the strip does not hold have none either.
    """
    rows = np.rint(outline.u_px).astype(np.intp) - strip.u_from_px
    inside = (rows >= 0) & (rows < slope.shape[0])
    u = outline.u_px[inside] - pivot_u_px
    own = slope[rows[inside]]
    rising, falling = edge_maps(own, _least_slope(own, strip, outline))
    on_left = np.maximum(rising, DARKENING_WORTH * falling)
    on_right = np.maximum(falling, DARKENING_WORTH * rising)
    axis = SHIFTS_PX[:, None, None] + TILTS[None, :, None] * u + strip.reach_px
    index, last = np.arange(u.size), slope.shape[1] - 1
    left = on_left[index, np.clip(np.rint(axis + outline.left_px[inside]).astype(np.intp), 0, last)]
    right = on_right[index, np.clip(np.rint(axis + outline.right_px[inside]).astype(np.intp), 0, last)]
    if outline.dim_side:
        left = right = right if outline.dim_side < 0 else left
    shares = (left + right).mean(axis=2) / 2.0
    worth = shares - AWAY_WORTH * np.abs(SHIFTS_PX)[:, None]
    row, column = (int(at) for at in np.unravel_index(int(np.argmax(worth)), worth.shape))
    tilt = float(TILTS[column])
    return Vote(float(SHIFTS_PX[row]) - tilt * pivot_u_px, tilt, float(shares[row, column]))


def _least_slope(slope: Plane, strip: ProbeStrip, outline: Silhouette) -> float:
    """Return the slope from which an edge votes."""
    if not outline.dim_side:
        return strip.edge_level
    steepest = np.max(outline.dim_side * slope, axis=1)
    return max(strip.edge_level, LEAST_OF_STEEPEST * upper_median(steepest))
