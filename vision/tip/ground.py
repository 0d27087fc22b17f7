"""Ground that a probe is taught before: whether it is dark and quiet. Pure."""

from __future__ import annotations

from typing import Final

import numpy as np

from vision.tip.strip import ProbeStrip

NEAR_END_PX: Final = 160
"""So much of the strip before the end is looked at: further up a probe that stands slanted may be in it."""
BESIDE_PX: Final = 75
"""Farther from the strip's middle lies no probe there."""
DARK_LEVEL, QUIET_LEVELS = 90.0, 45.0
"""Of 255: darker, and with less between its 2 % and 98 %, a ground is no reason not to be taught."""
ADVICE: Final = "use a dark, quiet background"


def ground_advice(strip: ProbeStrip) -> str:
    """Return what to do about the ground beside the end of a strip's probe, empty where it is dark and quiet."""
    rows = strip.pixels[max(-NEAR_END_PX - strip.u_from_px, 0) :]
    beside = np.concatenate([rows[:, : strip.reach_px - BESIDE_PX], rows[:, strip.reach_px + BESIDE_PX + 1 :]], axis=1)
    low, high = (float(level) for level in np.quantile(beside, (0.02, 0.98)))
    return "" if high < DARK_LEVEL and high - low < QUIET_LEVELS else ADVICE
