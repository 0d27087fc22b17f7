"""Glint on the black marking: what the columns it spares still show of the rims and of the levels.

A soft bright blob lifts the marking's brightness, or draws a rim away, over part of the probe's width. This is tried
only where the whole width has been refused, and what it returns has to pass every check again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vision.core import Floats
from vision.tip.marking_rim import join_rim, rim_places
from vision.tip.measure import RIM1_REACH_PX, MeasuredTip
from vision.tip.probe_model import ProbeModel
from vision.tip.strip import upper_median

SPARED_PX = 2.0
"""A column is spared when its two rims are as far apart as taught, but for how ragged they are."""
LEAST_SPARED, LEAST_SPARED_COLUMNS = 0.35, 7
CLEAR_PX, BESIDE_PX = 6, 24
"""Rows of metal beside the marking, clear of its rims, that its darkness is compared with."""
FREE_SHARE = 0.25
"""Of a column of marking the darker quarter is free of a glint, and so is the better quarter of the columns."""


def without_glint(probe: MeasuredTip, model: ProbeModel) -> MeasuredTip | None:
    """Return the measured probe with rims and levels from the columns a glint may have spared; None if too few are."""
    form = model.rim_form_px
    reach = form.size // 2
    columns = np.arange(-reach, reach + 1)
    line, marking = (probe.axis.a_px, probe.axis.b), model.shape.marking_px
    lower = np.full(columns.size, -model.h_px) + form
    u2, strength2 = rim_places(probe.strip, line, columns, lower, RIM1_REACH_PX, 1.0)
    u1, strength1 = rim_places(probe.strip, line, columns, lower - marking, RIM1_REACH_PX, -1.0)
    spared = np.abs(u2 - u1 - marking) < SPARED_PX
    if np.count_nonzero(spared) < max(LEAST_SPARED * columns.size, LEAST_SPARED_COLUMNS):
        return None
    half = model.outline.rim_half_px(-model.h_px)
    rim2 = join_rim(columns[spared], half, u2[spared], strength2[spared], form[spared])
    rim1_u = upper_median((u1 - form)[spared])
    metal, dark = _spared_levels(probe, columns, rim1_u, rim2.u_px)
    return replace(
        probe, rim1_u_px=rim1_u, rim1_strength=upper_median(strength1[spared]), rim2=rim2, metal=metal, dark=dark
    )


def _spared_levels(
    probe: MeasuredTip, columns: NDArray[np.intp], rim1_u_px: float, rim2_u_px: float
) -> tuple[float, float]:
    """Return the brightness of metal and marking of the column that stands for the better ones, levels.

    Each column is compared with its own metal, on the darker side of the marking: a dim flank is no marking, and a
    glint beside a probe without one does not make its metal dark.
    """
    strip = probe.strip
    offset = int(np.rint(probe.axis.v_px((rim1_u_px + rim2_u_px) / 2.0))) + strip.reach_px
    picked = strip.pixels[:, np.clip(columns + offset, 0, strip.pixels.shape[1] - 1)].astype(np.float64)
    at1, at2 = int(rim1_u_px) - strip.u_from_px, int(rim2_u_px) - strip.u_from_px
    inside = picked[max(at1 + CLEAR_PX, 0) : max(at2 - CLEAR_PX, 0)]
    above = picked[max(at1 - BESIDE_PX, 0) : max(at1 - CLEAR_PX, 0)]
    below = picked[max(at2 + CLEAR_PX, 0) : max(at2 + BESIDE_PX, 0)]
    if min(inside.shape[0], above.shape[0], below.shape[0]) == 0:
        return 0.0, 0.0
    metal = np.minimum(_quantile(above, 0.5), _quantile(below, 0.5))
    dark = _quantile(inside, FREE_SHARE)
    order = np.argsort(dark / np.maximum(metal, 1.0))
    pick = order[int(FREE_SHARE * (columns.size - 1))]
    return float(metal[pick]), float(dark[pick])


def _quantile(rows: Floats, share: float) -> Floats:
    return np.asarray(np.quantile(rows, share, axis=0), dtype=np.float64)
