"""Image quality: focus, exposure, contrast and noise, as numbers that maintenance can follow over months.

A number is useful there if it moves when its cause moves and at nothing else. So focus is an inverse length, the
narrowness of edges, which no gain and no contrast enters, and what noise adds to it is measured and taken off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core.image import SATURATED_LEVEL, Bgr, Gray, Plane, check_bgr, red_signal

BLACK_LEVEL = 5
"""At this level or below, an 8-bit pixel tells nothing about the dark."""
SCALE_PX = 1.5
"""Derivatives are taken on this Gaussian, px. Narrower, noise and rounding show at 8 px of blur; wider, the difference
between 0.5 and 1 px of blur fades."""
EDGE_SIGMAS, EDGE_SHARE, STRONG_PERCENTILE = 6.0, 0.2, 99.5
"""An edge is where the slope exceeds this many sigma of its noise, and this share of the strong slopes in the
image."""
FLANK_PX = 9
"""The flanks of an edge belong to it: this many px round it are measured as well."""
NOISE_KERNEL = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32) / 6.0
"""Immerkaer's kernel answers to no slope and no straight edge along an axis; its answer to noise is 6 sigma."""
MEDIAN_OF_NORMAL = 0.6745
"""The median of |x| of a normal distribution in its sigma."""
LEAST_SIDE_PX = 32


@dataclass(frozen=True, slots=True)
class ImageQuality:
    """Hold what an image, or a part of it, is worth.

    focus_per_px: 1 over the blur of its edges (sigma of a Gaussian, px, the 1.5 px of the measure itself included), 0
    where no edge stands out of the noise. It is true for straight steps: 0.66 for a blur of 0.3 px, 0.55 for 1, 0.40
    for 2, 0.23 for 4. Other detail gives a number a little higher, which falls with blur as well: compare like scenes.
    edge_share: share of the pixels that focus was measured on, 0..1. under_share, over_share: share of the pixels that
    are black (no channel above 5) or clipped (a channel at 250 or more), 0..1. dark_level, middle_level, bright_level:
    1st, 50th, 99th percentile, 0..255. contrast: (bright - dark) / (bright + dark), 0..1. noise_levels: sigma of the
    noise, 0..255.
    """

    focus_per_px: float
    edge_share: float
    under_share: float
    over_share: float
    dark_level: float
    middle_level: float
    bright_level: float
    contrast: float
    noise_levels: float

    @property
    def blur_px(self) -> float:
        """Return the blur of straight steps, sigma in px, without the measure's own; infinite if there is no edge."""
        if self.focus_per_px == 0.0:
            return math.inf
        return math.sqrt(max(self.focus_per_px**-2 - SCALE_PX**2, 0.0))


def measure_quality(bgr: Any, area_px: tuple[int, int, int, int] | None = None) -> ImageQuality:
    """Measure an image (H, W, 3) uint8, or the part (x, y, width, height) px of it.

    Levels, contrast, noise and focus are of the red channel where red leads (a red-lit image), else of the channels'
    mean. Raises ValueError for an array of another shape or type and for an area that is smaller than 32 x 32 px,
    not of whole pixels, or leaves the image.
    """
    part = _part(check_bgr(bgr), area_px)
    signal = red_signal(part)
    brightest = np.maximum(np.maximum(part[..., 0], part[..., 1]), part[..., 2])
    dark, middle, bright = (float(level) for level in np.percentile(signal[::2, ::2], (1.0, 50.0, 99.0)))
    usable = cv2.erode(((signal > BLACK_LEVEL) & (brightest < SATURATED_LEVEL)).astype(np.uint8), np.ones((3, 3)))
    noise = _noise(signal, usable > 0)
    focus, share = _focus(signal, brightest >= SATURATED_LEVEL, noise)
    return ImageQuality(
        focus_per_px=focus,
        edge_share=share,
        under_share=float(np.mean(brightest <= BLACK_LEVEL)),
        over_share=float(np.mean(brightest >= SATURATED_LEVEL)),
        dark_level=dark,
        middle_level=middle,
        bright_level=bright,
        contrast=(bright - dark) / max(bright + dark, 1.0),
        noise_levels=noise,
    )


def _part(image: Bgr, area_px: tuple[int, int, int, int] | None) -> Bgr:
    asked = area_px if area_px is not None else (0, 0, image.shape[1], image.shape[0])
    if not all(float(number).is_integer() for number in asked):
        raise ValueError(f"area {area_px} is not of whole pixels; round it")
    x, y, width, height = (int(number) for number in asked)
    if not (x >= 0 and y >= 0 and x + width <= image.shape[1] and y + height <= image.shape[0]):
        raise ValueError(f"area {area_px} leaves the frame of {image.shape[1]} x {image.shape[0]} px")
    if width < LEAST_SIDE_PX or height < LEAST_SIDE_PX:
        raise ValueError(f"{width} x {height} px are too few to measure; at least {LEAST_SIDE_PX} x {LEAST_SIDE_PX}")
    return np.ascontiguousarray(image[y : y + height, x : x + width])


def _noise(signal: Gray, usable: NDArray[np.bool_]) -> float:
    """Return sigma of the noise: Immerkaer's kernel, by the median, on the flatter half of the usable pixels."""
    if np.count_nonzero(usable[::2, ::2]) < LEAST_SIDE_PX:
        return 0.0
    answer = np.abs(cv2.filter2D(signal, cv2.CV_32F, NOISE_KERNEL, borderType=cv2.BORDER_REFLECT_101))
    slope = _slope2(_slopes(signal))
    flat = usable & (slope <= np.median(slope[::2, ::2][usable[::2, ::2]]))
    return _median(answer[flat], 1.0 / 6.0) / MEDIAN_OF_NORMAL


def _median(values: Plane, step: float) -> float:
    """Return the median of the absolute of values on a grid of `step`, as if each were spread over its cell.

    8-bit noise of less than one level has few different answers, and a plain median would jump from one to the next.
    """
    counts = np.bincount(np.rint(values / step).astype(np.int64))
    below = np.cumsum(counts)
    cell = int(np.searchsorted(below, 0.5 * values.size))
    if len(counts) == 1:
        return 0.0
    if cell == 0:
        return 0.5 * step * 0.5 * values.size / float(counts[0])
    return step * (cell - 0.5 + (0.5 * values.size - float(below[cell - 1])) / float(counts[cell]))


@lru_cache(maxsize=1)
def _kernels() -> tuple[Plane, Plane, Plane]:
    """Return the Gaussian of SCALE_PX and its first two derivatives, (1, N) each; exact on 1, x and x^2 / 2."""
    reach = math.ceil(4.0 * SCALE_PX)
    at = np.arange(-reach, reach + 1, dtype=np.float64)
    g = np.exp(-0.5 * (at / SCALE_PX) ** 2)
    g /= g.sum()
    g1 = at * g / np.sum(at**2 * g)
    g2 = (at**2 - np.sum(at**2 * g)) * g
    g2 /= np.sum(g2 * at**2) / 2.0
    return g.astype(np.float32), g1.astype(np.float32), g2.astype(np.float32)


def _filter(plane: Plane | Gray, along_x: Plane, along_y: Plane) -> Plane:
    answer = cv2.sepFilter2D(plane, cv2.CV_32F, along_x, along_y, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(answer, dtype=np.float32)


def _slopes(signal: Gray) -> tuple[Plane, Plane]:
    """Return the slopes in x and y, levels per px."""
    g, g1, _ = _kernels()
    return _filter(signal, g1, g), _filter(signal, g, g1)


def _slope2(slopes: tuple[Plane, Plane]) -> Plane:
    return slopes[0] ** 2 + slopes[1] ** 2


def _focus(signal: Gray, clipped: NDArray[np.bool_], noise: float) -> tuple[float, float]:
    """Return 1 over the blur in px, SCALE_PX included, and the share of pixels measured.

    Across a step blurred by sigma the slope is a Gaussian: its square sums up to 2 sigma^2 times the square of the
    curvature, whatever the step's height. White noise adds to both what it adds anywhere.
    """
    g, g1, g2 = _kernels()
    slope2 = _slope2(_slopes(signal))
    noise_slope2 = 2.0 * float((g**2).sum() * (g1**2).sum()) * noise**2
    strong = float(np.percentile(slope2[::2, ::2], STRONG_PERCENTILE))
    edge = slope2 > max(EDGE_SIGMAS**2 * noise_slope2, EDGE_SHARE**2 * strong, 1e-3)
    flank = np.ones((2 * FLANK_PX + 1, 2 * FLANK_PX + 1), dtype=np.uint8)
    where = cv2.dilate(edge.astype(np.uint8), flank) > 0
    where &= cv2.dilate(clipped.astype(np.uint8), flank) == 0
    count = int(np.count_nonzero(where))
    if count == 0:
        return 0.0, 0.0
    curvature = _filter(signal, g2, g) + _filter(signal, g, g2)
    cross = float((g * g2).sum())
    noise_curvature2 = 2.0 * (float((g**2).sum() * (g2**2).sum()) + cross**2) * noise**2
    slope_sum = float(slope2[where].sum(dtype=np.float64)) - count * noise_slope2
    curvature_sum = float((curvature[where] ** 2).sum(dtype=np.float64)) - count * noise_curvature2
    if slope_sum <= 0.0 or curvature_sum <= 0.0:
        return 0.0, 0.0
    return math.sqrt(2.0 * curvature_sum / slope_sum), count / where.size
