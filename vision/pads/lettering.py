"""Ink that looks like a pad: a disc as even as print, and as bright as the lettering round it.

A search window just holds the largest pad within reach, and the lettering that tells what this print looks like mostly
lies beyond it. Strokes are thin: the lens makes them duller than their ink, by more than their own width can tell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import erf, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Bgr, CircleFit, Component, Plane, components, despike, quantile, red_signal
from vision.pads.rules import LEAST_VISIBLE, SeenObject
from vision.pads.window import Window

REACH_PX = 130
"""So far from the tip lettering is looked for: some 1.5 mm, the print of one part and of its neighbours."""
ALONE_NECK = 0.15
"""A dot stands alone: a trace that goes on from a pad is as bright as it and no lettering."""
EVEN_SLOPE, EVEN_RELIEF = 0.055, 0.05
"""Ink is matt, metal mirrors the lamp unevenly: along its radius, and in hills of some px, the light of a dot of ink
changes by no more than these shares of its contrast."""
SMALL_RADIUS_PX, SMALL_SLOPE = 9.0, 0.16
"""Of a smaller disc hills cannot be told from its blur, and its slope is known this badly."""
HILL_PX, RIM_PX = 1.5, 3.5
DULLER, BRIGHTER = 0.12, 0.06
"""Ink of one print is equally bright: strokes seem duller or brighter than a dot by these shares of its contrast."""
LEAST_AREA_PX, WIDEST_PEN_PX, LEAST_SLENDER = 25, 13.0, 6.0
"""A pen is no wider than this, px. A stroke four times as long as wide has 6.2 times the area of its width squared, a
land twice as long 4.5."""
STRAIGHT_FILL = 0.78
"""What fills more than this of the smallest rectangle round it is one bar, which may be a land; letters do not."""
LEAST_BARS = 2
BLUR_PX = 1.1
"""Gaussian sigma of a lens in focus."""
CREST_SHARE = 0.93
OUTLINE_SHARE, DULLEST_SHARE = 0.35, 0.6
"""The outline of the thinnest stroke of a dot's ink, half as bright as its crest, and that crest: shares of the dot's
contrast."""

MayBeInk = Callable[[SeenObject], bool]


@dataclass(frozen=True, slots=True)
class _Stroke:
    """How bright the ink of a stroke may be, in levels (lowest, highest), and whether it is one straight bar."""

    dullest: float
    brightest: float
    bar: bool


@dataclass(frozen=True, slots=True)
class _Surroundings:
    level: Plane
    hidden: NDArray[np.bool_]


def ink_beside(image: Bgr, window: Window, *, sized: bool = False) -> MayBeInk:
    """Return a function that tells whether an object of a window may be a dot of ink of a red image's print.

    sized: CAD gave the radius; a small disc of a pad's very radius is then not thought to be ink, for its evenness
    hardly shows.
    """

    @cache
    def surroundings() -> _Surroundings:
        return _look_round(image, window)

    def may_be_ink(seen: SeenObject) -> bool:
        circle = seen.circle
        if circle is None or circle.visible < LEAST_VISIBLE or seen.hole is not None or seen.dark_middle:
            return False
        if sized and circle.radius_px < SMALL_RADIUS_PX:
            return False
        if seen.neck > ALONE_NECK or not _even(window, circle, seen):
            return False
        strokes = [stroke for stroke in _strokes(surroundings(), seen) if _alike(stroke, seen)]
        return len(strokes) >= LEAST_BARS or any(not stroke.bar for stroke in strokes)

    return may_be_ink


def _even(window: Window, circle: CircleFit, seen: SeenObject) -> bool:
    """Tell whether a disc is lit as evenly as ink."""
    if circle.radius_px < SMALL_RADIUS_PX:
        return seen.slope < SMALL_SLOPE
    if seen.slope > EVEN_SLOPE:
        return False
    reach = int(circle.radius_px) + 2
    top, left = max(int(circle.y_px) - reach, 0), max(int(circle.x_px) - reach, 0)
    part = window.raw[top : int(circle.y_px) + reach + 1, left : int(circle.x_px) + reach + 1]
    hidden = (window.hidden | window.maybe_hidden)[top : top + part.shape[0], left : left + part.shape[1]]
    linear = window.view.flattening()
    dx = np.arange(part.shape[1])[None, :] + left - circle.x_px
    dy = np.arange(part.shape[0])[:, None] + top - circle.y_px
    off = np.hypot(linear[0, 0] * dx + linear[0, 1] * dy, linear[1, 0] * dx + linear[1, 1] * dy)
    inner = (off < min(0.95 * circle.radius_px, circle.radius_px - RIM_PX)) & ~hidden
    if np.count_nonzero(inner) < LEAST_AREA_PX:
        return True
    hills = cv2.GaussianBlur(part, (0, 0), HILL_PX)[inner]
    return float(hills.std()) < EVEN_RELIEF * seen.contrast


def _look_round(image: Bgr, window: Window) -> _Surroundings:
    x, y = int(window.around_px[0]) + window.x_px, int(window.around_px[1]) + window.y_px
    top, left = max(y - REACH_PX, 0), max(x - REACH_PX, 0)
    red = red_signal(image[top : y + REACH_PX + 1, left : x + REACH_PX + 1])
    level = despike(np.ascontiguousarray(red)).astype(np.float32)
    hidden = np.zeros(level.shape, dtype=np.bool_)
    row, column = max(window.y_px - top, 0), max(window.x_px - left, 0)
    covered = (window.hidden | window.maybe_hidden)[max(top - window.y_px, 0) :, max(left - window.x_px, 0) :]
    part = hidden[row : row + covered.shape[0], column : column + covered.shape[1]]
    part |= covered[: part.shape[0], : part.shape[1]]
    return _Surroundings(level, hidden)


def _strokes(round_it: _Surroundings, seen: SeenObject) -> list[_Stroke]:
    """Return what may be strokes of a pen, drawn with a disc's ink or with others."""
    floor = seen.level - seen.contrast
    bright = round_it.level > floor + OUTLINE_SHARE * seen.contrast
    _, labels = cv2.connectedComponents((bright | round_it.hidden).astype(np.uint8), connectivity=8)
    # The probe goes on beyond the window, and is a bright stroke as well: what hangs together with it is left out.
    bright &= ~np.isin(labels, np.unique(labels[round_it.hidden]))
    found = (_stroke(round_it.level, region, floor) for region in components(bright.astype(np.uint8), LEAST_AREA_PX))
    return [stroke for stroke in found if stroke is not None]


def _stroke(level: Plane, region: Component, floor: float) -> _Stroke | None:
    contours, _ = cv2.findContours(region.mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    width = 2.0 * region.area_px / max(sum(cv2.arcLength(line, closed=True) for line in contours), 1.0)
    if width > WIDEST_PEN_PX or region.area_px < LEAST_SLENDER * width**2:
        return None
    x, y, across, down = region.box
    crest = quantile(level[y : y + down, x : x + across][region.mask > 0], CREST_SHARE)
    _, (one, other), _ = cv2.minAreaRect(max(contours, key=len))
    bar = region.area_px > STRAIGHT_FILL * (one + 1.0) * (other + 1.0)
    return _Stroke(crest, floor + (crest - floor) / erf(width / (2.0 * sqrt(2.0) * BLUR_PX)), bar)


def _alike(stroke: _Stroke, seen: SeenObject) -> bool:
    """Tell whether a disc may be of the ink of a stroke."""
    least = seen.level - (1.0 - DULLEST_SHARE) * seen.contrast
    not_too_bright = least < stroke.dullest < seen.level + BRIGHTER * seen.contrast
    return not_too_bright and stroke.brightest > seen.level - DULLER * seen.contrast
