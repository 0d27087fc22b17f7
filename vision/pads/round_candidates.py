"""Round objects of the window, with what the rules ask about them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import CircleFit, Contour, Edgels, View, fit_circle
from vision.pads.features import describe_disc
from vision.pads.hough_seeds import seeds
from vision.pads.rules import (
    DOUBTFUL_RATIO,
    LEAST_FILL,
    LEAST_RATIO,
    LEAST_VISIBLE,
    STROKE_NECK,
    WHOLE_VISIBLE,
    WIDEST_TRACE,
    SeenObject,
    Wanted,
    is_round,
)
from vision.pads.window import Window

LISTED_COVERAGE = 0.45
"""A circle with edge on less than this of its visible contour is not even a doubtful one."""
LARGER_SHARE = 1.6
"""A doubtful circle in a region this many times its own area belongs to that region."""
REFERENCE_SIGMA, TOLD_COVERAGE = 0.015, 0.9
"""A whole circle tells the shape of the others beside it to this share of the radius, if as much edge lies on it."""
AGREE_PX = 0.1
"""Two measurements of one circle agree to this, px, and three sigma."""
NEARLY_ROUND = 0.62
"""A circle with edge on this share of its visible contour is not thrown with the region it lies in."""
MUCH_LARGER = 1.6
"""A circle so much larger than another is not the same thing once more."""
TOUCH_SHARE = 1.25
"""Circles touch whose centres are nearer than this share of the sum of their radii."""
TOUCHING_PX = 2
"""What lies this near a whole circle is the other's blur."""


def round_objects(
    window: Window, edgels: Edgels, wanted: Wanted, proposed: Iterable[Contour] | None = None
) -> list[SeenObject]:
    """Return the circles found in the window with their features, each thing once.

    proposed: where to look; None for wherever the edge points say.

    This is the thesis' "place a circle, blacken, repeat" (5.4.3): touching pads and pads with a trace come apart, and
    what is inside a whole disc is not asked about again.
    """
    if proposed is None:
        proposed = _proposed(window, edgels, wanted)
    found: list[SeenObject] = []
    for seed in proposed:
        if any(_within((seed.x_px, seed.y_px), whole.circle) for whole in found if _whole(whole)):
            continue
        circle = _fit(window, edgels, seed)
        if circle is None or circle.coverage < LISTED_COVERAGE or any(_same(circle, other.circle) for other in found):
            continue
        seen = describe_disc(window, edgels, circle)
        if _whole(seen):
            found = [other for other in found if other.circle and not _within(_centre(other.circle), circle)]
        found.append(seen)
    if window.maybe_hidden.any():
        found = [_without_doubt(window, edgels, seen) for seen in found]
    found = _again(window, edgels, found)
    done = blackened(window, [seen for seen in found if _whole(seen)])
    kept = [seen for seen in found if _whole(seen) or _nearly_round(seen) or not _part_of_larger(window, seen, done)]
    return [_in_frame(seen, window) for seen in kept]


def _proposed(window: Window, edgels: Edgels, wanted: Wanted) -> list[Contour]:
    bands = [(max(0.8 * low, 3.5), 1.25 * high) for low, high in wanted.radii_px]
    found = seeds(edgels, window.shape, bands, window.view, window.around_px, window.reach_px)
    return [Contour(seed.x_px, seed.y_px, seed.radius_px) for seed in found]


def blackened(window: Window, discs: Iterable[SeenObject], margin_px: int = 3) -> NDArray[np.uint8]:
    """Return a mask (0/1) of what needs no further look: the probe and the given discs (in the window's pixels)."""
    done = window.hidden.astype(np.uint8)
    for seen in discs:
        if seen.circle is not None:
            circle = seen.circle
            axes = round(circle.radius_px * circle.ratio) + margin_px, round(circle.radius_px) + margin_px
            at = round(circle.x_px), round(circle.y_px)
            cv2.ellipse(done, at, axes, float(np.degrees(circle.minor_rad)), 0.0, 360.0, (1,), -1)
    return done


def _without_doubt(window: Window, edgels: Edgels, seen: SeenObject) -> SeenObject:
    """Return a circle as it is where nothing can stand before it, unless what may be hidden says the same.

    The edge of a probe across a pad lies near the pad's own: where they disagree, the pad's is the one far from it.
    """
    circle = seen.circle
    if circle is None:
        return seen
    reach = circle.radius_px + 2.0
    box = tuple(slice(max(int(v - reach), 0), int(v + reach) + 1) for v in (circle.y_px, circle.x_px))
    if not window.maybe_hidden[box].any():
        return seen
    clear = replace(window, hidden=window.hidden | window.maybe_hidden, maybe_hidden=np.zeros_like(window.maybe_hidden))
    points = edgels.outside(clear.hidden)
    other = _fit(clear, points, Contour(circle.x_px, circle.y_px, circle.radius_px))
    if other is None or other.visible < LEAST_VISIBLE or other.coverage < circle.coverage:
        return seen
    strict = describe_disc(clear, points, other)
    if strict.circle is None:
        return seen
    apart = np.hypot(strict.circle.x_px - circle.x_px, strict.circle.y_px - circle.y_px)
    return strict if apart > AGREE_PX + 3.0 * strict.circle.sigma_px else seen


def _again(window: Window, edgels: Edgels, found: list[SeenObject]) -> list[SeenObject]:
    """Measure once more what is not whole, knowing the whole circles beside it (thesis 5.4.3: blacken, and repeat).

    They tell how obliquely the board is seen, and where they touch another its contour cannot show.
    """
    whole = [seen for seen in found if _whole(seen) and seen.circle and seen.circle.ratio > LEAST_RATIO]
    best = max((seen.circle for seen in whole if seen.circle), key=lambda c: c.visible * c.radius_px, default=None)
    if best is None:
        return found
    known = window
    if best.visible > WHOLE_VISIBLE:
        known = replace(window, view=View(best.ratio, best.minor_rad, REFERENCE_SIGMA))
    again: list[SeenObject] = []
    for seen in found:
        circle, others = seen.circle, [other for other in whole if other is not seen]
        half_hidden = circle is not None and circle.visible <= WHOLE_VISIBLE
        if circle is None or not others or not (half_hidden or (seen not in whole and _touches(circle, others))):
            again.append(seen)
            continue
        behind = replace(known, hidden=blackened(window, others, TOUCHING_PX) > 0)
        left_over = edgels.outside(behind.hidden)
        better = _fit(behind, left_over, Contour(circle.x_px, circle.y_px, circle.radius_px))
        told = better is not None and better.coverage > TOLD_COVERAGE * circle.coverage
        again.append(describe_disc(behind, left_over, better) if better and told else seen)
    return again


def _touches(circle: CircleFit, whole: list[SeenObject]) -> bool:
    """Tell whether a circle reaches a whole one, or nearly."""
    return any(
        np.hypot(circle.x_px - other.x_px, circle.y_px - other.y_px)
        < TOUCH_SHARE * (circle.radius_px + 0.5 * other.length_px)
        for other in whole
    )


def _fit(window: Window, edgels: Edgels, seed: Contour) -> CircleFit | None:
    return fit_circle(
        edgels,
        seed,
        window.view,
        shape=window.shape,
        reach_px=max(2.5, 0.22 * seed.radius_px),
        hidden=window.hidden,
        maybe_hidden=window.maybe_hidden,
    )


def _nearly_round(seen: SeenObject) -> bool:
    """Tell whether a circle lacks only a little to be one: it may be a pad with something across it."""
    circle = seen.circle
    if circle is None or circle.coverage < NEARLY_ROUND or seen.fill < LEAST_FILL:
        return False
    return circle.ratio > DOUBTFUL_RATIO and seen.neck < WIDEST_TRACE


def _part_of_larger(window: Window, seen: SeenObject, done: NDArray[np.uint8]) -> bool:
    """Tell whether a doubtful circle is only the corner or the end of something larger, judged as a whole later."""
    if seen.circle is None:
        return False
    column, row = round(seen.circle.x_px), round(seen.circle.y_px)
    if not (0 <= row < window.shape[0] and 0 <= column < window.shape[1]):
        return True
    bright = ((window.smooth > seen.level - 0.5 * seen.contrast) & (done == 0)).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(bright, connectivity=8)
    label = int(labels[row, column])
    area = seen.area_px * seen.circle.ratio
    return label > 0 and float(stats[label, cv2.CC_STAT_AREA]) > LARGER_SHARE * area


def _whole(seen: SeenObject) -> bool:
    """Tell whether an object is a disc to its rim: what goes on all round it is only the middle of one."""
    return is_round(seen) and seen.fill >= LEAST_FILL and (seen.neck < STROKE_NECK or seen.hole is not None)


def _centre(circle: CircleFit) -> tuple[float, float]:
    return circle.x_px, circle.y_px


def _within(at_px: tuple[float, float], circle: CircleFit | None) -> bool:
    return circle is not None and np.hypot(at_px[0] - circle.x_px, at_px[1] - circle.y_px) < 0.9 * circle.radius_px


def _same(one: CircleFit, other: CircleFit | None) -> bool:
    """Tell whether a new circle is only another found one once more."""
    if other is None:
        return False
    # A glint lies on its pad: the pad is asked about all the same, and ends what was found inside of it.
    if one.radius_px > MUCH_LARGER * other.radius_px:
        return False
    apart = float(np.hypot(one.x_px - other.x_px, one.y_px - other.y_px))
    return apart < 0.6 * max(one.radius_px, other.radius_px)


def _in_frame(seen: SeenObject, window: Window) -> SeenObject:
    """Return an object in the image's pixels, its circle and hole still in the window's."""
    return replace(seen, x_px=seen.x_px + window.x_px, y_px=seen.y_px + window.y_px)
