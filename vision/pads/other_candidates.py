"""Bright objects that are not round: strokes, rectangles, lettering, for the rules to throw by name."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from vision.core import Component, components, multi_otsu, quantile
from vision.pads.round_candidates import blackened
from vision.pads.rules import SeenObject
from vision.pads.window import Window

CLASSES = 4
LEAST_STEP = 25.0
"""Brightness classes this little above the board are solder mask and what lies under it."""
PEAK_SHARE = 0.93
"""A thin stroke is as bright as it is only along its middle, and the brightest pixels of all are noise."""
LEAST_LISTED_PX = 9
"""Objects smaller than this are noise and not even listed."""


def other_objects(window: Window, explained: Iterable[SeenObject]) -> list[SeenObject]:
    """Return the bright objects that `explained` circles leave over, by brightness class from the top, in the image."""
    done = blackened(window, explained)
    if not np.any(window.smooth[done == 0] > window.board_level + LEAST_STEP):
        return []
    levels = multi_otsu(window.smooth, CLASSES, ~window.hidden)
    found: list[SeenObject] = []
    for threshold in sorted({level for level in levels if level >= window.board_level + LEAST_STEP}, reverse=True):
        mask = ((window.smooth > threshold) & (done == 0)).astype(np.uint8)
        found += [_describe(window, region) for region in components(mask, LEAST_LISTED_PX)]
        done |= np.asarray(cv2.dilate(mask, np.ones((5, 5), dtype=np.uint8)), dtype=np.uint8)
    return found


def _describe(window: Window, region: Component) -> SeenObject:
    """Return the features of a connected region, its holes filled, as it is on the board."""
    x, y, width, height = region.box
    contours, _ = cv2.findContours(region.mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    linear = window.view.flattening().astype(np.float32)
    outline = np.ascontiguousarray(max(contours, key=len)[:, 0, :].astype(np.float32) @ linear.T)
    area = float(cv2.contourArea(outline)) + 0.5 * float(len(outline)) + 1.0
    perimeter = float(cv2.arcLength(outline, closed=True)) + 3.0
    (_, (side1, side2), _) = cv2.minAreaRect(outline)
    length, thickness = max(side1, side2) + 1.0, min(side1, side2) + 1.0
    mask = region.mask > 0
    rows, columns = np.nonzero(mask)
    at = x + float(np.mean(columns)), y + float(np.mean(rows))
    level = quantile(window.smooth[y : y + height, x : x + width][mask])
    peak = quantile(window.clean[y : y + height, x : x + width][mask], PEAK_SHARE)
    floor, cut = _surroundings(window, region)
    in_needle = float(np.mean(window.maybe_hidden[y : y + height, x : x + width][mask]))
    return SeenObject(
        x_px=at[0] + window.x_px,
        y_px=at[1] + window.y_px,
        area_px=area,
        length_px=length,
        thickness_px=thickness,
        circularity=perimeter / (2.0 * float(np.sqrt(np.pi * area))),
        boxed=area / (length * thickness),
        fill=1.0,
        level=level,
        contrast=level - floor,
        neck=0.0,
        touches_border=cut,
        in_needle=in_needle,
        ring=False,
        dark_middle=False,
        circle=None,
        hole=None,
        distance_px=window.distance_px(*at),
        peak=peak,
    )


def _surroundings(window: Window, region: Component) -> tuple[float, bool]:
    """Return (brightness just around a region, whether the window's border cuts it off)."""
    x, y, width, height = region.box
    y1, x1 = max(y - 4, 0), max(x - 4, 0)
    y2, x2 = min(y + height + 4, window.shape[0]), min(x + width + 4, window.shape[1])
    inner = np.zeros((y2 - y1, x2 - x1), dtype=np.uint8)
    inner[y - y1 : y - y1 + height, x - x1 : x - x1 + width] = region.mask
    ring = (cv2.dilate(inner, np.ones((7, 7), dtype=np.uint8)) > 0) & (inner == 0)
    hidden = window.hidden[y1:y2, x1:x2]
    near = window.smooth[y1:y2, x1:x2][ring & ~hidden]
    floor = quantile(near, 1.0 / 3.0) if near.size else window.board_level
    at_border = x <= 1 or y <= 1 or x + width >= window.shape[1] - 1 or y + height >= window.shape[0] - 1
    return floor, at_border
