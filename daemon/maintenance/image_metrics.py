"""Metrics of a look's images: lamps, lens and probe. Pure: arrays in, numbers out; for a worker thread.

The scene below the needle changes with every touch; the needle itself rides with camera and lamps and looks the same
in every picture of a healthy station. So brightness and noise are measured on it and beside it, never on the board.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from vision import ProbeModel, Tip
from vision.core import Bgr, gray, measure_quality, red_signal
from vision.tip import probe_outline, straighten

# The needle's own flanks are blurred: this much of them is left out.
INSET_PX = 3.0
# From here to there along the needle is looked at; 0 is where its end was taught, positive is beyond it. Far from there
# lies only the edge of something on the board.
END_FROM_PX, END_TO_PX = -28, 16
# Half width of the needle's middle, and where beside its edge the ground is looked at.
MIDDLE_PX, BESIDE_FROM_PX, BESIDE_TO_PX = 1, 3, 7
LEAST_RUN_PX = 8
LEAST_METAL_PX = 100
# An end stands out if needle and ground differ before it by so many levels more than behind it.
LEAST_STEP_LEVELS = 12.0
REACH_PX = 40
NEEDLE_LENGTH_PX = 260


def measure_pictures(white: Bgr, red: Bgr | None, tip: Tip, model: ProbeModel) -> Mapping[str, float]:
    """Return name -> number of what can be measured in a look's frames (H, W, 3) uint8; what cannot is left out.

    light_white, light_red: brightness of the needle under each lamp, 0..255. noise: sigma of the white picture's noise
    there, levels. tip_length: how far beyond its taught place the needle ends, px along the needle.
    """
    numbers: dict[str, float] = {}
    if _window(white, tip) is None:
        return numbers
    for name, frame in (("light_white", white), ("light_red", red)):
        window = None if frame is None else _window(frame, tip)
        if frame is None or window is None:
            continue
        x, y, width, height = window
        part = np.ascontiguousarray(frame[y : y + height, x : x + width])
        plane = gray(part) if name == "light_white" else red_signal(part)
        metal = np.sort(plane[_inside(tip, window)])
        if metal.size >= LEAST_METAL_PX:
            # The middle half: neither the marking nor a glint, and finer than a level, which a median is not.
            numbers[name] = float(metal[metal.size // 4 : -(metal.size // 4)].mean())
        if name == "light_white":
            numbers["noise"] = measure_quality(part).noise_levels
    end_px = end_offset_px(white, tip, model)
    if end_px is not None:
        numbers["tip_length"] = end_px
    return numbers


def _window(frame: Bgr, tip: Tip) -> tuple[int, int, int, int] | None:
    """Return the part (x, y, width, height) of the frame that holds the needle's end; None if it is too small."""
    height, width = frame.shape[:2]
    away_x, away_y = -math.cos(tip.angle_rad) * NEEDLE_LENGTH_PX, -math.sin(tip.angle_rad) * NEEDLE_LENGTH_PX
    xs, ys = sorted((tip.x_px, tip.x_px + away_x)), sorted((tip.y_px, tip.y_px + away_y))
    left, right = max(0, int(xs[0]) - REACH_PX), min(width, int(xs[1]) + REACH_PX)
    top, bottom = max(0, int(ys[0]) - 8), min(height, int(ys[1]) + 8)
    if right - left < REACH_PX or bottom - top < REACH_PX:
        return None
    return left, top, right - left, bottom - top


def _inside(tip: Tip, window: tuple[int, int, int, int]) -> NDArray[np.bool_]:
    """Return where in the window the needle is, well inside its edges."""
    x, y, width, height = window
    outline = probe_outline((tip.x_px - x, tip.y_px - y), tip.angle_rad, tip.shape, -INSET_PX)
    mask = np.zeros((height, width), dtype=np.uint8)
    cv2.fillPoly(mask, [np.rint(outline).astype(np.int32)], (1,))
    return mask > 0


def end_offset_px(white: Bgr, tip: Tip, model: ProbeModel) -> float | None:
    """Return how far beyond the taught place the needle ends, px along the needle; None where it does not stand out.

    TEDA puts the end where it was taught from the marking, and so cannot see that it wears. Here it is seen itself: up
    to it the needle's middle differs from the ground beside it, behind it there is nothing but ground. One picture is
    good to 4 px (1 sigma) before a board, and some grounds hide the end: only the middle of many says something.
    """
    x, y = round(tip.x_px), round(tip.y_px)
    top, left = max(0, y - 64), max(0, x - 64)
    plane = gray(np.ascontiguousarray(white[top : y + 64, left : x + 64])).astype(np.float32)
    at = tip.x_px - left, tip.y_px - top
    strip = straighten(plane, at, tip.angle_rad, END_FROM_PX, END_TO_PX, 24)
    u = np.arange(END_FROM_PX, END_TO_PX + 1, dtype=np.float64)
    half = np.maximum(model.shape.half_width(np.minimum(u, 0.0)), 1.0)
    middle = strip.pixels[:, strip.reach_px - MIDDLE_PX : strip.reach_px + MIDDLE_PX + 1].mean(axis=1)
    sides = []
    for side in (-1, 1):
        columns = strip.reach_px + side * np.rint(half[:, None] + np.arange(BESIDE_FROM_PX, BESIDE_TO_PX)).astype(int)
        sides.append(np.take_along_axis(strip.pixels, columns, axis=1).mean(axis=1))
    # The side that is more like the needle decides: a pad on one side alone must not look like an end.
    return _step_at(u, np.minimum(*(np.abs(middle - side) for side in sides)))


def _step_at(u: NDArray[np.float64], differs: NDArray[np.float64]) -> float | None:
    """Return where a course steps down for good, by least squares; None if it does not clearly."""
    n = len(differs)
    total, total2 = np.cumsum(differs), np.cumsum(differs**2)
    k = np.arange(LEAST_RUN_PX, n - LEAST_RUN_PX)
    before, after = total[k - 1] / k, (total[-1] - total[k - 1]) / (n - k)
    left = total2[-1] - k * before**2 - (n - k) * after**2
    best = int(np.argmin(np.where(before > after, left, np.inf)))
    if best in (0, len(k) - 1):  # the step, if there is one, lies outside
        return None
    step = before[best] - after[best]
    if step < LEAST_STEP_LEVELS or step < 2.0 * math.sqrt(max(left[best], 0.0) / n):
        return None
    return float(u[k[best]] - 0.5)
