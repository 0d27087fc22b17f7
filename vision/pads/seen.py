"""What is seen near the tip: test points, and every other object with what decided about it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vision.core import CircleFit, NotFound
from vision.pads.comparison import is_drilled
from vision.pads.rule_name import RuleName
from vision.pads.rules import DOUBTFUL_RATIO, OVAL_RATIO, ROUND_COVERAGE, Decided, Wanted, is_via

NEARLY_WHOLE = 0.8
"""An undecided circle of which this share of the contour is free may be a pad, should a pad be known to lie there."""
POSSIBLE_SHARE, POSSIBLE_SLACK_PX = 0.08, 0.5
"""It meets CAD's radius within this share (but at least this many px): the end of a trace is narrower than its pad."""


@dataclass(frozen=True, slots=True)
class TestPoint:
    """Hold a taken pad: (x_px, y_px) is the target, the hole's centre where it is seen, else the pad's.

    radius_px: the pad's semi-major radius; pad_px: its centre; hole_px: the hole's (x, y, radius) or None; sigma_px:
    1-sigma of each coordinate of the target; visible: share of its contour that nothing hides; rule: what took it;
    ratio, minor_rad: minor over major axis of its ellipse, and the minor axis' direction.
    """

    __test__ = False  # the name would make pytest collect it

    x_px: float
    y_px: float
    radius_px: float
    kind: Literal["via", "site"]
    pad_px: tuple[float, float]
    hole_px: tuple[float, float, float] | None
    sigma_px: float
    visible: float
    rule: str
    ratio: float
    minor_rad: float


@dataclass(frozen=True, slots=True)
class Seen:
    """Hold everything seen near the tip; false when there is no nearest test point.

    nearest: the answer or why there is none; taken: all test points, nearest first; thrown, undecided: the other
    objects, nearest first, with the rule that decided; window_px: (x, y, width, height) looked at.
    """

    nearest: TestPoint | NotFound
    taken: tuple[TestPoint, ...]
    thrown: tuple[Decided, ...]
    undecided: tuple[Decided, ...]
    window_px: tuple[int, int, int, int]

    def __bool__(self) -> bool:
        return bool(self.nearest)

    def possible(self, expected_radius_px: float, *, followed: bool = False) -> tuple[TestPoint, ...]:
        """Return the undecided round things of that semi-major radius, seen nearly whole and not too oval.

        A pad whose trace shows in the same opening of the mask may be one; with a hole in its middle, also if the trace
        makes it look wider or more oval than it is. Of a pad that is `followed` from an earlier look so may what was
        thrown for going on like a stroke. None of them is a test point by its looks; who knows from elsewhere that a
        pad lies just there may still take it (`constellation.match_near`).
        """
        corner = self.window_px[0], self.window_px[1]
        strokes = [item for item in self.thrown if followed and item.rule == RuleName.STROKE_END]
        return tuple(
            replace(point_of(item, corner), rule=RuleName.AT_KNOWN_PLACE)
            for item in (*self.undecided, *strokes)
            if (circle := item.object.circle) is not None
            and circle.visible >= NEARLY_WHOLE
            and circle.coverage >= ROUND_COVERAGE
            and _fits(circle, expected_radius_px, drilled=is_drilled(item.object))
        )


def _fits(circle: CircleFit, expected_radius_px: float, *, drilled: bool) -> bool:
    """Tell whether a circle may be a pad of that radius; one that is `drilled` is no trace: less is asked of it."""
    if drilled:
        return circle.ratio >= OVAL_RATIO and Wanted(expected_radius_px, 0.0).is_sized(circle.radius_px)
    slack = max(POSSIBLE_SHARE * expected_radius_px, POSSIBLE_SLACK_PX)
    return circle.ratio >= DOUBTFUL_RATIO and abs(circle.radius_px - expected_radius_px) <= slack


def point_of(item: Decided, corner: tuple[int, int]) -> TestPoint:
    """Return a decided object as a test point of the image whose window begins at `corner`, px."""
    circle, hole = item.object.circle, item.object.hole
    if circle is None:
        raise ValueError(f"the rule {item.rule} took an object without a circle: it has no centre to land on")
    pad = circle.x_px + corner[0], circle.y_px + corner[1]
    kind: Literal["via", "site"] = "via" if is_via(item.object) else "site"
    at = pad if hole is None else (hole.x_px + corner[0], hole.y_px + corner[1])
    return TestPoint(
        x_px=at[0],
        y_px=at[1],
        radius_px=circle.radius_px,
        kind=kind,
        pad_px=pad,
        hole_px=None if hole is None else (*at, hole.radius_px),
        sigma_px=circle.sigma_px if hole is None else hole.sigma_px,
        visible=circle.visible,
        rule=item.rule,
        ratio=circle.ratio,
        minor_rad=circle.minor_rad,
    )


def distance_px(point: TestPoint, around: tuple[float, float]) -> float:
    """Return how far the target lies from a point of the image."""
    return float(np.hypot(point.x_px - around[0], point.y_px - around[1]))
