"""End of a probe that is taught, as the picture shows it: a click that lies elsewhere is refused.

Down from the marking the metal goes on until there is nothing but ground right across the shaft: that is the end, even
where print or a pad is as bright as metal further on. Each column of the shaft then tells where its own light ends, and
the farthest count: the others end at the side of a round end, or in the gap of a crown.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from vision.core import Floats, Plane
from vision.tip.strip import RIM_CLEARANCE_PX, ProbeStrip

BEYOND_PX: Final = 60
"""A strip for the end reaches this far beyond the click."""
OFF_PX: Final = 3.65
"""A click may be this far from the end that is seen: a hand is off by 2.5 px at most, and the end of a turned crown is
seen 1.1 px short."""
WIDTH_SHARE, LEVEL_QUANTILE = 0.6, 0.75
"""The end is looked for within this share of the needle's half width; its level and that beyond are this quantile."""
FARTHEST: Final = 0.9
"""Quantile over the columns: the farthest ends of some are the end, not that of a single one."""
METAL_ROWS, GROUND_ROWS = 15, 5
"""The metal's level is that of so many rows below the marking; so many rows of ground in line are no groove."""
DARK_SHARE, END_SHARE = 0.5, 0.42
"""Shares of the step from ground to metal: where rows count as ground, and where a column's light has ended."""
NEAR_PX: Final = 9
"""A column's end lies this close to the first row of ground."""
LEAST_STEP, LEAST_STEP_LEVELS = 1.15, 6.0
"""So much brighter than the ground, as a ratio and some levels more, metal has to be."""


def check_end(strip: ProbeStrip, click_u_px: float, half_px: float, rim2_u_px: float) -> None:
    """Raise ValueError unless the probe ends where a click has put its end, u in px.

    strip: along the probe's axis, from its marking to BEYOND_PX beyond the click; half_px: how wide the probe is near
    its end; rim2_u_px: roughly where the marking ends.
    """
    end = find_end(strip, half_px, rim2_u_px)
    if end is not None and abs(end - click_u_px) > OFF_PX:
        where = "nearer to its marking" if end < click_u_px else "farther from its marking"
        raise ValueError(
            f"the needle does not end at the given point: the picture shows its end {abs(end - click_u_px):.0f} px "
            f"{where}; click the very end"
        )
    _check_step(strip, click_u_px, half_px)
    if end is None:
        raise ValueError(
            f"the needle does not end at the given point, nor within {BEYOND_PX} px beyond it, or the ground there is "
            "as bright as its metal; click the very end"
        )


def find_end(strip: ProbeStrip, half_px: float, rim2_u_px: float) -> float | None:
    """Return u (px) of the end that is seen below the marking's rim; None where no ground follows the metal."""
    columns = np.asarray(cv2.blur(_middle(strip, half_px), (3, 1)), dtype=np.float32)
    levels = np.asarray(np.quantile(columns, FARTHEST, axis=1), dtype=np.float64)
    first = round(rim2_u_px) + RIM_CLEARANCE_PX - strip.u_from_px
    at = _first_ground(levels, first)
    return None if at is None else _columns_end(columns, levels, at) + strip.u_from_px


def _middle(strip: ProbeStrip, half_px: float) -> Plane:
    """Return the strip's columns (rows, columns) within the shaft."""
    reach = max(round(WIDTH_SHARE * half_px), 1)
    return strip.pixels[:, strip.reach_px - reach : strip.reach_px + reach + 1]


def _first_ground(levels: Floats, first: int) -> int | None:
    """Return the first row from `first` on, at which GROUND_ROWS rows of ground begin, by the rows' levels (N,)."""
    padded = np.pad(levels, 2, mode="edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)[first:]
    if smooth.size < METAL_ROWS + GROUND_ROWS:
        return None
    metal, dark = float(np.median(levels[first : first + METAL_ROWS])), float(np.min(smooth))
    if metal < LEAST_STEP * dark + LEAST_STEP_LEVELS:
        return None
    below = smooth < dark + DARK_SHARE * (metal - dark)
    runs = np.all(np.lib.stride_tricks.sliding_window_view(below, GROUND_ROWS), axis=1)
    return first + int(np.argmax(runs)) if np.any(runs) else None


def _columns_end(columns: Plane, levels: Floats, at: int) -> float:
    """Return the row, with its fraction, at which the light of the farthest columns (rows, columns) ends near `at`."""
    ground = float(np.median(levels[at + 3 : at + NEAR_PX]))
    least = (float(np.median(levels[at - NEAR_PX : at - 3])) - ground) / 2.0
    metal = np.maximum(np.median(columns[at - NEAR_PX : at - 3], axis=0) - ground, least)
    # A gap between teeth is no metal: it ends where the teeth beside it have half of their light.
    lit = columns[at - NEAR_PX : at + NEAR_PX] - (ground + END_SHARE * metal)
    falls = (lit[:-1] >= 0.0) & (lit[1:] < 0.0)
    ends = [_last_fall(lit[:, one], falls[:, one]) for one in np.flatnonzero(falls.any(axis=0))]
    return at - NEAR_PX + float(np.quantile(ends, FARTHEST)) if ends else float(at)


def _last_fall(lit: Floats | Plane, falls: Floats | Plane) -> float:
    """Return where a column (N,) last falls through 0, interpolated between its rows."""
    row = int(np.flatnonzero(falls)[-1])
    return row + float(lit[row] / (lit[row] - lit[row + 1]))


def _check_step(strip: ProbeStrip, end_u_px: float, half_px: float) -> None:
    """Raise ValueError unless it is darker right beyond the click than before it.

    A crown or a cup has a gap on its axis and metal beside it; beyond the end there is none on either. Of a slender
    needle that goes on some px, all of what is beyond may be metal: what lies farther tells the ground.
    """
    at, columns = round(end_u_px) - strip.u_from_px, _middle(strip, half_px)
    parts = ((-16, -6), (6, 16), (4, 9), (14, 24))
    levels = (np.median(columns[at + start : at + stop], axis=0) for start, stop in parts)
    metal, beyond, just_beyond, far = (float(np.quantile(level, LEVEL_QUANTILE)) for level in levels)
    if metal < LEAST_STEP * beyond + LEAST_STEP_LEVELS:
        raise ValueError(
            f"the needle does not end at the given point: it is as bright beyond ({beyond:.0f} of 255) as before it "
            f"({metal:.0f}); click the very end"
        )
    ground = min(beyond, far)
    if just_beyond > (metal + ground) / 2.0:
        raise ValueError(
            f"the needle does not end at the given point: some px beyond it is as bright as before it "
            f"({just_beyond:.0f} of 255, {metal:.0f}), and darker then ({ground:.0f}); click the very end"
        )
