"""Search for the test points near the tip in a red-lit image, by taking and throwing (TDEA, thesis 5.4).

Circles are proposed, measured on raw pixels and run through the rules together with everything else that is bright.
What is taken is a test point, what is thrown is not, and an undecided object near the tip is a fault, never a guess.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vision.core import (
    LEAST_SLOPE,
    UNKNOWN_VIEW,
    Bgr,
    Edgels,
    Gray,
    NotFound,
    Reason,
    View,
    check_bgr,
    check_exposure,
    check_point,
    find_edgels,
    median,
    quantile,
    red_signal,
)
from vision.pads.comparison import angular_after_all, apart, drawn_after_all, is_inside
from vision.pads.lettering import ink_beside
from vision.pads.occluding_probe import LEAST_SLOPE as PROBE_SLOPE
from vision.pads.occluding_probe import find_probe
from vision.pads.other_candidates import other_objects
from vision.pads.round_candidates import round_objects
from vision.pads.rules import (
    FAINT_CONTRAST,
    RULES,
    SITE_RADIUS_PX,
    Decided,
    Rule,
    SeenObject,
    Verdict,
    Wanted,
    decide,
    is_clear,
)
from vision.pads.seen import Seen, TestPoint, distance_px, point_of
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
BRIGHT_PIXELS = 40
"""So many pixels of a dark window must stand out from it to be worth a look: half of the smallest via."""
LARGEST_RADIUS_PX = 200.0


def find_test_points(
    red_bgr: Any,
    around_px: tuple[float, float],
    reach_px: float = 30,
    expected_radius_px: float | None = None,
    needle: Tip | None = None,
    view: View | None = None,
    rules: tuple[Rule, ...] = RULES,
    expected_hole_radius_px: float | None = None,
) -> Seen:
    """Find test points within `reach_px` of `around_px` (x, y) in a red image (H, W, 3) uint8 BGR.

    expected_radius_px: the semi-major radius CAD expects, which replaces the thesis' classes (via 5..8 px, site
    14..21 px) and widens the window. needle: where the probe is in this image; what it hides is left out. view: how
    obliquely the board is seen (default: the probe's direction and a ratio of 0.87; without a probe anything between
    square and that). expected_hole_radius_px: the semi-major radius of the pad's hole by CAD, 0 for a pad without one;
    None when it is not known, and then every dark round place in a pad is a hole. Good to
    about 0.05 px on whole pads, 0.3 px on half-hidden ones. `nearest` is NotFound with one of
    too_dark, saturated, out_of_frame, no_test_point, ambiguous, undecided. ValueError for a wrong array, a point or
    number that is not finite.
    """
    image = check_bgr(red_bgr)
    around = check_point(around_px, "around_px")
    radius = None if expected_radius_px is None else check_radius(expected_radius_px)
    hole_radius = check_hole(expected_hole_radius_px, radius)
    if not (np.isfinite(reach_px) and 1.0 <= reach_px <= 1000.0):
        raise ValueError(f"reach_px must be 1..1000 px, got {reach_px}")
    half = int(np.ceil(reach_px + (SITE_RADIUS_PX[1] if radius is None else radius) + MARGIN_PX))
    window = prepare(image, around, half, reach_px, needle, view, hole_radius)
    if isinstance(window, NotFound):
        return _nothing(window, _area(around, half))
    return _look(image, window, _area(around, half), radius, needle, rules)


def prepare(
    image: Bgr,
    around: tuple[float, float],
    half_px: int,
    reach_px: float,
    needle: Tip | None,
    view: View | None,
    hole_radius_px: float | None,
) -> Window | NotFound:
    """Return the square window of `half_px` on either side of a point, or why it cannot be worked with."""
    x, y, width, height = _area(around, half_px)
    if x < 0 or y < 0 or x + width > image.shape[1] or y + height > image.shape[0]:
        size = f"{image.shape[1]} x {image.shape[0]}"
        fact = f"the window x {x}..{x + width}, y {y}..{y + height} px does not lie in the picture of {size} px"
        return NotFound(Reason.OUT_OF_FRAME, f"{fact}: is the tip where it was taught?")
    plane = red_signal(image[y : y + height, x : x + width])
    problem = check_exposure(plane, dark_level=DARK_LEVEL, dark_percentile=50.0, clipped_share=0.6)
    if problem is not None and not (problem.reason is Reason.TOO_DARK and _stands_out(plane)):
        return problem
    if view is None:
        view = UNKNOWN_VIEW if needle is None else View(minor_rad=needle.angle_rad)
    return open_window(plane, (x, y), around, reach_px, view, hole_radius_px)


def _area(around: tuple[float, float], half_px: int) -> tuple[int, int, int, int]:
    """Return (x, y, width, height) of the window round a point."""
    return int(np.rint(around[0])) - half_px, int(np.rint(around[1])) - half_px, 2 * half_px + 1, 2 * half_px + 1


def _stands_out(plane: Gray) -> bool:
    """Tell whether something as large as a pad is bright before a dark board: black mask reflects hardly any light."""
    smooth = median(plane, 3).ravel()
    bright = np.partition(smooth, smooth.size - BRIGHT_PIXELS)[-BRIGHT_PIXELS]
    return float(bright) - quantile(smooth) >= FAINT_CONTRAST


def _look(
    image: Bgr,
    window: Window,
    area: tuple[int, int, int, int],
    radius: float | None,
    needle: Tip | None,
    rules: tuple[Rule, ...],
) -> Seen:
    window, strong = free_edges(window, needle)
    circles = round_objects(window, strong, Wanted(radius, 0.0))
    decided = [decide(seen, _wanted(seen, circles, radius, window.board_level), rules) for seen in circles]
    rest = other_objects(window, [item.object for item in decided if item.verdict is Verdict.TAKE])
    regions = [decide(seen, Wanted(radius, 0.0), rules) for seen in rest]
    decided = drawn_after_all(
        angular_after_all(decided, regions), regions, ink_beside(image, window, sized=radius is not None)
    )
    decided += [item for item in regions if not is_inside(item.object.x_px, item.object.y_px, decided)]
    decided = apart(decided)
    decided.sort(key=lambda item: item.object.distance_px)
    points = [point_of(item, (area[0], area[1])) for item in decided if item.verdict is Verdict.TAKE]
    around = window.around_px[0] + window.x_px, window.around_px[1] + window.y_px
    taken = tuple(sorted(points, key=lambda point: distance_px(point, around)))
    thrown = tuple(item for item in decided if item.verdict is Verdict.THROW)
    undecided = tuple(item for item in decided if item.verdict is Verdict.PASS)
    return Seen(_nearest(taken, undecided, around, window.reach_px), taken, thrown, undecided, area)


def free_edges(window: Window, needle: Tip | None) -> tuple[Window, Edgels]:
    """Return the window with the probe hidden, and the edge points that are not the probe's."""
    edgels = find_edgels(window.clean, LEAST_SLOPE if needle else PROBE_SLOPE)
    window = _behind_probe(window, edgels, needle)
    return window, edgels.where(edgels.slope > LEAST_SLOPE).outside(window.hidden)


def _wanted(seen: SeenObject, circles: list[SeenObject], radius: float | None, board: float) -> Wanted:
    """Return what an object is held against: CAD's radius, and the brightest clear pad of its size or larger.

    Bright lettering has round counters and dots too; they say nothing of how bright a larger pad should be.
    """
    clear = [other for other in circles if is_clear(other) and other.length_px > LIKE_SIZE * seen.length_px]
    brightest = max(clear, key=lambda other: other.level, default=None)
    level, contrast = (brightest.level, brightest.contrast) if brightest else (0.0, 0.0)
    return Wanted(radius, level, contrast, board)


def _behind_probe(window: Window, edgels: Edgels, needle: Tip | None) -> Window:
    """Return the window with what the probe covers hidden: the given probe, or the one that shows in this image."""
    if needle is not None:
        corner = np.array([window.x_px, window.y_px])
        outline = probe_outline((needle.x_px, needle.y_px), needle.angle_rad, needle.shape, PROBE_MARGIN_PX)
        return hide(window, outline - corner, certain=True)
    seen = find_probe(edgels, window.around_px, UNKNOWN_VIEW.minor_rad, SEEN_PROBE_MARGIN_PX)
    return window if seen is None else hide(window, seen.outline_px, certain=seen.certain)


def check_radius(radius: float) -> float:
    """Return CAD's radius if it is one, else raise ValueError."""
    if not (np.isfinite(radius) and 3.0 <= radius <= LARGEST_RADIUS_PX):
        raise ValueError(f"expected_radius_px must be 3..{LARGEST_RADIUS_PX:.0f} px, got {radius}")
    return float(radius)


def check_hole(hole: float | None, radius: float | None) -> float | None:
    """Return CAD's radius of the hole if it is one, else raise ValueError."""
    if hole is None:
        return None
    largest = LARGEST_RADIUS_PX if radius is None else radius
    if not (np.isfinite(hole) and 0.0 <= hole < largest):
        raise ValueError(f"expected_hole_radius_px must be 0..{largest:.0f} px and less than the pad's, got {hole}")
    return float(hole)


def _nothing(reason: NotFound, area: tuple[int, int, int, int]) -> Seen:
    return Seen(reason, (), (), (), area)


def _nearest(
    taken: tuple[TestPoint, ...], undecided: tuple[Decided, ...], around: tuple[float, float], reach: float
) -> TestPoint | NotFound:
    """Return the nearest test point (eq. 5.12), or why none may be chosen."""
    distances = [distance_px(point, around) for point in taken]
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
