"""Search for the test points near the tip in a red-lit image, by taking and throwing (TDEA, thesis 5.4).

Circles are proposed, measured on raw pixels and run through the rules together with everything else that is bright.
What is taken is a test point, what is thrown is not, and an undecided object near the tip is a fault, never a guess.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from vision.core import (
    LEAST_SLOPE,
    UNKNOWN_VIEW,
    CircleFit,
    Edgels,
    Gray,
    NotFound,
    Reason,
    View,
    check_bgr,
    check_exposure,
    check_point,
    find_edgels,
    red_signal,
)
from vision.pads.comparison import angular_after_all, apart, drawn_after_all, is_drilled, is_inside
from vision.pads.occluding_probe import LEAST_SLOPE as PROBE_SLOPE
from vision.pads.occluding_probe import find_probe
from vision.pads.other_candidates import other_objects
from vision.pads.round_candidates import round_objects
from vision.pads.rule_name import RuleName
from vision.pads.rules import (
    DOUBTFUL_RATIO,
    OVAL_RATIO,
    ROUND_COVERAGE,
    RULES,
    SITE_RADIUS_PX,
    Decided,
    Rule,
    SeenObject,
    Verdict,
    Wanted,
    decide,
    is_clear,
    is_via,
)
from vision.pads.window import Window, hide, open_window
from vision.tip import Tip, probe_outline

MARGIN_PX = 8
"""Room beside the largest pad for its edge and surroundings."""
AMBIGUOUS_PX = 3.0
"""Two candidates whose distances to the tip differ by less than this cannot be told apart by distance."""
LIKE_SIZE = 0.75
"""Of two round things the smaller is compared with the other down to this share of its diameter."""
PROBE_MARGIN_PX = 1.8
"""The probe's outline is trusted to this: its silhouette, its blur, and what it reflects onto."""
SEEN_PROBE_MARGIN_PX = 1.3
"""The same of a probe that was found in the red image itself."""
DARK_LEVEL = 12.0
"""An image taken without light stays below this everywhere; a bare board under red light does not."""
LARGEST_RADIUS_PX = 200.0
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
            replace(_point(item, corner), rule=RuleName.AT_KNOWN_PLACE)
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


def find_test_points(
    red_bgr: Any,
    around_px: tuple[float, float],
    reach_px: float = 30,
    expected_radius_px: float | None = None,
    needle: Tip | None = None,
    view: View | None = None,
    rules: tuple[Rule, ...] = RULES,
) -> Seen:
    """Find test points within `reach_px` of `around_px` (x, y) in a red image (H, W, 3) uint8 BGR.

    expected_radius_px: the semi-major radius CAD expects, which replaces the thesis' classes (via 5..8 px, site
    14..21 px) and widens the window. needle: where the probe is in this image; what it hides is left out. view: how
    obliquely the board is seen (default: the probe's direction and a ratio of 0.87; without a probe anything between
    square and that). Good to about 0.05 px on whole pads, 0.3 px on half-hidden ones. `nearest` is NotFound with one of
    too_dark, saturated, out_of_frame, no_test_point, ambiguous, undecided. ValueError for a wrong array, a point or
    number that is not finite.
    """
    image = check_bgr(red_bgr)
    around = check_point(around_px, "around_px")
    radius = _check_radius(expected_radius_px)
    if not (np.isfinite(reach_px) and 1.0 <= reach_px <= 1000.0):
        raise ValueError(f"reach_px must be 1..1000 px, got {reach_px}")
    half = int(np.ceil(reach_px + (SITE_RADIUS_PX[1] if radius is None else radius) + MARGIN_PX))
    x, y = int(np.rint(around[0])) - half, int(np.rint(around[1])) - half
    area = x, y, 2 * half + 1, 2 * half + 1
    if x < 0 or y < 0 or x + area[2] > image.shape[1] or y + area[3] > image.shape[0]:
        size = f"{image.shape[1]} x {image.shape[0]}"
        fact = f"the window x {x}..{x + area[2]}, y {y}..{y + area[3]} px does not lie in the picture of {size} px"
        return _nothing(NotFound(Reason.OUT_OF_FRAME, f"{fact}: is the tip where it was taught?"), area)
    plane = red_signal(image[y : y + area[3], x : x + area[2]])
    problem = check_exposure(plane, dark_level=DARK_LEVEL, dark_percentile=50.0, clipped_share=0.6)
    if problem is not None:
        return _nothing(problem, area)
    if view is None:
        view = UNKNOWN_VIEW if needle is None else View(minor_rad=needle.angle_rad)
    return _look(plane, area, around, reach_px, radius, needle, view, rules)


def _look(
    plane: Gray,
    area: tuple[int, int, int, int],
    around: tuple[float, float],
    reach: float,
    radius: float | None,
    needle: Tip | None,
    view: View,
    rules: tuple[Rule, ...],
) -> Seen:
    window = open_window(plane, (area[0], area[1]), around, view)
    edgels = find_edgels(window.clean, LEAST_SLOPE if needle else PROBE_SLOPE)
    window = _behind_probe(window, edgels, needle)
    strong = edgels.where(edgels.slope > LEAST_SLOPE).outside(window.hidden)
    circles = round_objects(window, strong, Wanted(radius, 0.0))
    decided = [decide(seen, _wanted(seen, circles, radius), rules) for seen in circles]
    rest = other_objects(window, [item.object for item in decided if item.verdict is Verdict.TAKE])
    regions = [decide(seen, Wanted(radius, 0.0), rules) for seen in rest]
    decided = drawn_after_all(angular_after_all(decided, regions), regions)
    decided += [item for item in regions if not is_inside(item.object.x_px, item.object.y_px, decided)]
    decided = apart(decided)
    decided.sort(key=lambda item: item.object.distance_px)
    points = [_point(item, (area[0], area[1])) for item in decided if item.verdict is Verdict.TAKE]
    taken = tuple(sorted(points, key=lambda point: _distance(point, around)))
    thrown = tuple(item for item in decided if item.verdict is Verdict.THROW)
    undecided = tuple(item for item in decided if item.verdict is Verdict.PASS)
    return Seen(_nearest(taken, undecided, around, reach), taken, thrown, undecided, area)


def _wanted(seen: SeenObject, circles: list[SeenObject], radius: float | None) -> Wanted:
    """Return what an object is held against: CAD's radius, and the brightest clear pad of its size or larger.

    Bright lettering has round counters and dots too; they say nothing of how bright a larger pad should be.
    """
    clear = [other for other in circles if is_clear(other) and other.length_px > LIKE_SIZE * seen.length_px]
    brightest = max(clear, key=lambda other: other.level, default=None)
    return Wanted(radius, brightest.level, brightest.contrast) if brightest else Wanted(radius, 0.0)


def _behind_probe(window: Window, edgels: Edgels, needle: Tip | None) -> Window:
    """Return the window with what the probe covers hidden: the given probe, or the one that shows in this image."""
    if needle is not None:
        corner = np.array([window.x_px, window.y_px])
        outline = probe_outline((needle.x_px, needle.y_px), needle.angle_rad, needle.shape, PROBE_MARGIN_PX)
        return hide(window, outline - corner, certain=True)
    seen = find_probe(edgels, window.around_px, UNKNOWN_VIEW.minor_rad, SEEN_PROBE_MARGIN_PX)
    return window if seen is None else hide(window, seen.outline_px, certain=seen.certain)


def _check_radius(radius: float | None) -> float | None:
    if radius is None:
        return None
    if not (np.isfinite(radius) and 3.0 <= radius <= LARGEST_RADIUS_PX):
        raise ValueError(f"expected_radius_px must be 3..{LARGEST_RADIUS_PX:.0f} px, got {radius}")
    return float(radius)


def _nothing(reason: NotFound, area: tuple[int, int, int, int]) -> Seen:
    return Seen(reason, (), (), (), area)


def _point(item: Decided, corner: tuple[int, int]) -> TestPoint:
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


def _distance(point: TestPoint, around: tuple[float, float]) -> float:
    return float(np.hypot(point.x_px - around[0], point.y_px - around[1]))


def _nearest(
    taken: tuple[TestPoint, ...], undecided: tuple[Decided, ...], around: tuple[float, float], reach: float
) -> TestPoint | NotFound:
    """Return the nearest test point (eq. 5.12), or why none may be chosen."""
    distances = [_distance(point, around) for point in taken]
    limit = min([*distances, reach]) + AMBIGUOUS_PX
    unclear = [item for item in undecided if item.object.distance_px < limit]
    if unclear:
        seen = unclear[0].object
        return NotFound(
            Reason.UNDECIDED,
            f"an object {seen.distance_px:.1f} px from the tip at ({seen.x_px:.0f}, {seen.y_px:.0f}) px is neither a "
            "test point nor clearly none: look at the picture, clean the pad, or give the pad's radius from CAD",
        )
    if not taken or distances[0] > reach:
        away = f"the nearest is {distances[0]:.1f} px away" if taken else "none is in the window"
        return NotFound(
            Reason.NO_TEST_POINT,
            f"no test point within {reach:.0f} px of the tip ({away}): is the board in its place and the lamp red?",
        )
    if len(taken) > 1 and distances[1] - distances[0] < AMBIGUOUS_PX and distances[1] <= reach + AMBIGUOUS_PX:
        return NotFound(
            Reason.AMBIGUOUS,
            f"two test points lie {distances[0]:.1f} and {distances[1]:.1f} px from the tip: distance cannot tell "
            "which is meant; give the pad's radius from CAD or match the constellation",
        )
    return taken[0]
