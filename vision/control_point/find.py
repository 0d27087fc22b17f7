"""Search for the control point: the middle of four thin arms printed crosswise (thesis appendix C).

Each arm is a dark line with two parallel edges; halfway between them runs the arm. Arms that cross at 72..95 degrees
(perspective bends the right angle) meet at the centre. Two arms are enough: the probe may hide the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vision.control_point.cross import FARTHEST, Cross, measure_crosses
from vision.control_point.proposals import propose_crossings
from vision.core import Gray, NotFound, Reason, check_bgr, check_exposure, check_point, despike, gray

SAME_PX = 1.0
"""Two answers nearer than this are the same one, px."""
KNOWN_PX = 10.0
"""A proposal this near to a measured centre is that one again, px."""
WORSE_STATIONS, WORSE_SIGMA = 0.9, 2.0
"""A probe's edge beside a hidden arm can pass for it: such an answer has fewer stations and a larger sigma by
these."""


@dataclass(frozen=True, slots=True)
class Arm:
    """Hold one arm: a point on its middle line, its direction away from the centre, its width, the share seen."""

    x_px: float
    y_px: float
    angle_rad: float
    width_px: float
    share: float


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """Hold the centre (x_px, y_px), 1-sigma of each coordinate, and the arms it was made from."""

    x_px: float
    y_px: float
    sigma_px: float
    arms: tuple[Arm, ...]


def find_control_point(
    white_bgr: Any, around_px: tuple[float, float], reach_px: float = 60.0, arm_px: float = 60.0
) -> ControlPoint | NotFound:
    """Find a four-arm control point whose centre lies within `reach_px` of `around_px` (x, y).

    white_bgr: (H, W, 3) uint8 BGR. arm_px: length of an arm from the centre, in px; what an arm is longer is used too.
    Good to about 0.1 px. An arm that is not seen must be hidden: where bare paper lies in its place, this is no control
    point. NotFound with too_dark, saturated, out_of_frame, ambiguous or no_control_point; ValueError for a wrong array
    or number.
    """
    image = check_bgr(white_bgr)
    around = check_point(around_px, "around_px")
    if not (5.0 <= reach_px <= 500.0 and 15.0 <= arm_px <= 500.0):
        raise ValueError(f"reach_px must be 5..500 and arm_px 15..500 px, got {reach_px} and {arm_px}")
    half = int(reach_px + arm_px) + 2
    column, row = int(np.rint(around[0])), int(np.rint(around[1]))
    height, width = image.shape[:2]
    if column < half or row < half or column + half >= width or row + half >= height:
        fact = f"the window x {column - half}..{column + half}, y {row - half}..{row + half} px leaves the picture"
        return NotFound(Reason.OUT_OF_FRAME, f"{fact}: bring the control point nearer to the tip")
    # Longer arms are followed as far as the image goes.
    more = half + int((FARTHEST - 1.0) * arm_px) + 1
    x, y = max(column - more, 0), max(row - more, 0)
    plane = gray(image[y : row + more + 1, x : column + more + 1])
    left, top = column - half - x, row - half - y
    middle = plane[top : top + 2 * half + 1, left : left + 2 * half + 1]
    problem = check_exposure(middle, dark_level=40.0, dark_percentile=90.0, clipped_share=0.7)
    if problem is not None:
        return problem
    found = _search(despike(plane), (left, top, half), reach_px, arm_px)
    if isinstance(found, NotFound):
        return found
    return ControlPoint(found.x_px + x, found.y_px + y, found.sigma_px, _arms(found, x, y, arm_px))


def _search(plane: Gray, window: tuple[int, int, int], reach_px: float, arm_px: float) -> Cross | NotFound:
    """Find the one control point of `plane` about the middle of a window (left, top, half side)."""
    left, top, half = window
    raw = plane.astype(np.float32)
    found: list[Cross] = []
    fact = ""
    for crossing in propose_crossings(plane[top : top + 2 * half + 1, left : left + 2 * half + 1], reach_px, arm_px):
        crossing = crossing.moved(left, top)
        if any(np.hypot(one.x_px - crossing.x_px, one.y_px - crossing.y_px) < KNOWN_PX for one in found):
            continue
        result = measure_crosses(raw, crossing, arm_px)
        if isinstance(result, str):
            fact = fact or result
        else:
            found += result
    found = [one for one in found if np.hypot(one.x_px - left - half, one.y_px - top - half) <= reach_px + 1.0]
    if not found:
        return _none(fact or "no two dark lines cross there")
    best = max(found, key=lambda one: one.stations)
    if any(_rivals(one, best) for one in found):
        return NotFound(
            Reason.AMBIGUOUS, "more than one crossing looks like a control point: bring the right one nearer, alone"
        )
    return best


def _rivals(other: Cross, best: Cross) -> bool:
    """Tell whether another answer contradicts the best, and is not just the same crossing measured much worse."""
    apart = np.hypot(other.x_px - best.x_px, other.y_px - best.y_px)
    worse = other.stations < WORSE_STATIONS * best.stations and other.sigma_px > WORSE_SIGMA * best.sigma_px
    return bool(apart > SAME_PX and not (worse and apart < KNOWN_PX))


def _none(fact: str) -> NotFound:
    return NotFound(Reason.NO_CONTROL_POINT, f"{fact}: is the printed cross in view, flat, clean and in focus?")


def _arms(found: Cross, x: int, y: int, arm_px: float) -> tuple[Arm, ...]:
    """Return the arms in the image's coordinates, each at the middle of its length."""
    arms = []
    for arm in found.arms:
        c, s = np.cos(arm.angle_rad), np.sin(arm.angle_rad)
        at = found.x_px + x + 0.5 * arm_px * c, found.y_px + y + 0.5 * arm_px * s
        arms.append(Arm(float(at[0]), float(at[1]), arm.angle_rad, arm.width_px, arm.share))
    return tuple(arms)
