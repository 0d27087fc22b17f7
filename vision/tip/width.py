"""Width of a probe that is taught: a streak of light on a wide one is no probe of its own.

A streak has two edges about one axis, as a probe has, and the marking crosses it. But it crosses the metal beside the
streak as well, and nothing beside a probe.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vision.tip.strip import ProbeStrip

BESIDE_PX: Final = (3, 10)
"""The columns looked at begin and end so far outside of the outline: beyond its blur, but still on a wide needle."""
RIM_PX: Final = (4, 12)
"""Rows on either side of a rim: beyond its blur, and its bow."""
STEP_SHARE, LEAST_STEP_LEVELS = 0.25, 4.0
"""A step beside the outline is the marking's where it is so much of the step within, and so many levels: beside
a probe up to 0.07 was seen, beside a streak from 0.6 on."""


def check_width(strip: ProbeStrip, half_px: float, rim1_u_px: float, rim2_u_px: float) -> None:
    """Raise ValueError where both rims of the marking go on beside an outline that is `half_px` wide to each side."""
    middle = strip.reach_px
    within = _marking_step(
        strip, slice(middle - round(half_px / 2), middle + round(half_px / 2) + 1), rim1_u_px, rim2_u_px
    )
    near, far = (round(half_px) + beside for beside in BESIDE_PX)
    for columns in (slice(max(middle - far, 0), middle - near), slice(middle + near + 1, middle + far + 1)):
        if _marking_step(strip, columns, rim1_u_px, rim2_u_px) > max(STEP_SHARE * within, LEAST_STEP_LEVELS):
            raise ValueError(
                f"the needle is wider than what was taken for it ({2.0 * half_px:.0f} px): its marking goes on beside "
                "that, which is a streak of light on it; click its very end, in the middle of its width"
            )


def _marking_step(strip: ProbeStrip, columns: slice, rim1_u_px: float, rim2_u_px: float) -> float:
    """Return by how much the marking is darker than the metal above and below it, the lesser of both, in columns."""
    rim1, rim2 = (round(u_px) - strip.u_from_px for u_px in (rim1_u_px, rim2_u_px))
    from_px, to_px = RIM_PX
    pairs = ((rim1 - to_px, rim1 + from_px), (rim2 + from_px, rim2 - to_px))
    steps = []
    for metal, dark in pairs:
        lit, black = (
            float(np.median(strip.pixels[max(at, 0) : at + to_px - from_px, columns])) for at in (metal, dark)
        )
        steps.append(lit - black)
    return min(steps)
