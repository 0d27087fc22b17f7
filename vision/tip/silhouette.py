"""Silhouette of the taught probe: where its two edges were seen, row by row, from the axis.

It is measured, not assumed: a taper may be straight or rounded, begin below the marking or right at it, and light from
one side shifts the two edges differently. Whatever was there at teaching is there again when the probe is the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.core import Floats
from vision.tip.strip import (
    CALIPER_STEP_PX,
    CYLINDER_LENGTH_PX,
    END_CLEARANCE_PX,
    RIM_CLEARANCE_PX,
)

TAPERED = 0.75
"""A probe narrower than this share of its cylinder at the marking has no cylinder there: it tapers all along."""


@dataclass(frozen=True, slots=True)
class Silhouette:
    """Hold the calipers' rows `u_px` (N,), integers rising to the end at 0, and each edge's v from the axis (N,), px.

    `left_px` are the edges on the side of negative v, `right_px` those of positive v. The first `cylinder_rows` rows
    are on the cylinder, the others on the taper below the marking; the marking itself has no rows.
    dim_side: of a probe lit from one side the side (-1 or +1) whose flank is so dim that its edge is lost before a
    board; it is not measured, but `shade_px` (N,) tells where on it the light was down to half. 0, and none, of others.
    """

    u_px: Floats
    left_px: Floats
    right_px: Floats
    cylinder_rows: int
    dim_side: int = 0
    shade_px: Floats | None = None

    @property
    def on_taper(self) -> NDArray[np.bool_]:
        """Return which rows (N,) are on the taper."""
        return np.arange(self.u_px.size) >= self.cylinder_rows

    @property
    def half_px(self) -> Floats:
        """Return the half width at each row (N,), px."""
        return np.asarray((self.right_px - self.left_px) / 2.0, dtype=np.float64)

    def rim_half_px(self, u_px: float) -> float:
        """Return the half width a rim at `u_px` goes round, px: the cylinder's, or less where all the probe tapers."""
        cylinder = float(np.mean(self.half_px[: self.cylinder_rows]))
        there = float(np.interp(u_px, self.u_px, self.half_px))
        return there if there < TAPERED * cylinder else cylinder


def caliper_rows(end_to_rim_px: float, marking_px: float) -> tuple[Floats, int]:
    """Return the rows (N,) of the calipers, rising, and how many of them are on the cylinder."""
    top = np.rint(-end_to_rim_px - marking_px - RIM_CLEARANCE_PX)
    cylinder = np.arange(top - CYLINDER_LENGTH_PX, top, CALIPER_STEP_PX)
    taper = np.arange(np.rint(-end_to_rim_px + RIM_CLEARANCE_PX / 2), -END_CLEARANCE_PX, CALIPER_STEP_PX)
    return np.concatenate([cylinder, taper]), cylinder.size
