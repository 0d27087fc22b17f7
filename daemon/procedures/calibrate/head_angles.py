"""Head angles of a rotational calibration, in the order in which the axis turns. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from daemon.domain.errors import Fault, FaultCode

STEP_DEG = 1.8 / 32
"""The motor's finest step (thesis 6.2)."""
FIRST_AXIS_DEG, LAST_AXIS_DEG = -220.0, 100.0
"""Head angles 140..360 and 0..100 as the axis counts them; between lies the forbidden band."""
DEFAULT_ANGLES = 32
"""Half as many again as a smooth model needs."""
_HALF_STEP_DEG = STEP_DEG / 2


def plan_angles(angles: int | None, every_deg: float | None, minimum_deg: float, maximum_deg: float) -> list[float]:
    """Return head angles 0..360, each one the motor can stand at, from one end of the axis' range to the other.

    `angles`: so many, evenly spread; `every_deg`: one at each multiple of it. The range is the configuration's, never
    the forbidden band's. Raises `Fault` if fewer than six angles are left.
    """
    low, high = max(FIRST_AXIS_DEG, minimum_deg), min(LAST_AXIS_DEG, maximum_deg)
    if every_deg is not None:
        first, last = math.ceil(low / every_deg), math.floor(high / every_deg)
        axis = [k * every_deg for k in range(first, last + 1)]
    else:
        count = angles or DEFAULT_ANGLES
        axis = [low + (high - low) * k / (count - 1) for k in range(count)]
    # A whole turn closes on itself, should an axis ever have that range.
    found = list(dict.fromkeys(_standable(a, low, high) for a in axis))
    if len(found) < 6:
        raise Fault(FaultCode.INVALID_REQUEST, f"that leaves {len(found)} head angles; at least 6 are needed")
    return found


def between(angles: Sequence[float], count: int) -> list[float]:
    """Return up to `count` angles halfway between neighbours, spread over the whole range."""
    axis = [_axis(a) for a in angles]
    gaps = [(a + b) / 2 for a, b in pairwise(axis)]
    chosen = gaps[:: max(1, math.ceil(len(gaps) / count))]
    return [_standable(a, min(axis), max(axis)) for a in chosen]


def _axis(head_deg: float) -> float:
    """Return the axis' coordinate of a head angle."""
    return head_deg - 360.0 if head_deg > LAST_AXIS_DEG + _HALF_STEP_DEG else head_deg


def _standable(axis_deg: float, low: float, high: float) -> float:
    """Return the nearest angle the motor can stand at, as head angle 0..360."""
    steps = round(axis_deg / STEP_DEG)
    if steps * STEP_DEG < low - 1e-9:
        steps += 1
    if steps * STEP_DEG > high + 1e-9:
        steps -= 1
    return steps * STEP_DEG % 360.0
