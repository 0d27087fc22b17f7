"""Second witness for a pad whose place is known: is there a round pad of CAD's radius, and where exactly.

Nothing is searched and nothing is proposed: one circle is fitted where it must be and run through the same rules as
any other. Whoever knows the place from elsewhere (the board registered to the picture) asks here whether the picture
alone says the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vision.core import Contour, NotFound, Reason, View, check_bgr, check_point
from vision.pads.find import check_hole, check_radius, free_edges, prepare
from vision.pads.round_candidates import round_objects
from vision.pads.rules import Verdict, Wanted, decide
from vision.pads.seen import TestPoint, distance_px, point_of
from vision.tip import Tip

REACH_PX = 6.0
BESIDE_SHARE, BESIDE_PX = 1.45, 6.0
"""The window holds the pad and what lies beside it: this many radii and px."""


def confirm_pad(
    red_bgr: Any,
    at_px: tuple[float, float],
    expected_radius_px: float,
    expected_hole_radius_px: float | None = None,
    needle: Tip | None = None,
    view: View | None = None,
    reach_px: float = REACH_PX,
) -> TestPoint | NotFound:
    """Measure the round pad expected at `at_px` (x, y) in a red image (H, W, 3) uint8 BGR; search for none.

    expected_radius_px, expected_hole_radius_px: semi-major radii by CAD (0: no hole, None: not known). needle, view: as
    in `find_test_points`. reach_px: how far from `at_px` the pad's target may lie. NotFound with one of too_dark,
    saturated, out_of_frame, no_test_point (nothing round of that size is there), undecided (something is, but it is not
    clearly a pad). ValueError for a wrong array or number.
    """
    image, at = check_bgr(red_bgr), check_point(at_px, "at_px")
    radius = check_radius(expected_radius_px)
    hole_radius = check_hole(expected_hole_radius_px, radius)
    if not (np.isfinite(reach_px) and 1.0 <= reach_px <= 1000.0):
        raise ValueError(f"reach_px must be 1..1000 px, got {reach_px}")
    half = int(np.ceil(reach_px + BESIDE_SHARE * radius + BESIDE_PX))
    window = prepare(image, at, half, reach_px, needle, view, hole_radius)
    if isinstance(window, NotFound):
        return window
    window, edgels = free_edges(window, needle)
    wanted = Wanted(radius, 0.0, 0.0, window.board_level)
    expected = Contour(*window.around_px, radius)
    decided = [decide(seen, wanted) for seen in round_objects(window, edgels, wanted, [expected])]
    taken = [point_of(item, (window.x_px, window.y_px)) for item in decided if item.verdict is Verdict.TAKE]
    near = [point for point in taken if distance_px(point, at) <= reach_px]
    if near:
        return near[0]
    if taken:
        away = distance_px(taken[0], at)
        return NotFound(Reason.NO_TEST_POINT, f"the pad lies {away:.1f} px from where it is expected: align again")
    if any(item.verdict is Verdict.PASS for item in decided):
        return NotFound(
            Reason.UNDECIDED, "what lies at the expected place is not clearly a pad: clean it and look again"
        )
    return NotFound(
        Reason.NO_TEST_POINT,
        f"nothing round of {radius:.1f} px radius is seen at ({at[0]:.0f}, {at[1]:.0f}) px: is the board in its place?",
    )
