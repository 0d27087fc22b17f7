"""Edge points of a whole image at once: where brightness changes fastest, to a fraction of a pixel (Canny's maxima).

They propose and judge circles; what is taken is measured on the pixels themselves (`disc`).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core.image import Gray

Floats = NDArray[np.float32]
SMOOTH_PX = 1.0
"""The image is smoothed by this before slopes are taken, px."""
LEAST_SLOPE = 6.0
"""Slope of an edge worth a look, levels per px (after smoothing)."""


@dataclass(frozen=True, slots=True)
class Edgels:
    """Hold N edge points: place in px, unit direction towards the bright side, slope in levels per px; each (N,)."""

    x_px: Floats
    y_px: Floats
    toward_x: Floats
    toward_y: Floats
    slope: Floats

    def where(self, chosen: NDArray[np.bool_]) -> Edgels:
        """Return the chosen ones."""
        parts = (self.x_px, self.y_px, self.toward_x, self.toward_y, self.slope)
        return Edgels(*(part[chosen] for part in parts))

    def outside(self, mask: NDArray[np.bool_]) -> Edgels:
        """Return those that do not lie on a mask (H, W) of the image they were found in."""
        rows, columns = np.rint(self.y_px).astype(np.intp), np.rint(self.x_px).astype(np.intp)
        return self.where(~mask[rows, columns])


def find_edgels(plane: Gray, least_slope: float = LEAST_SLOPE) -> Edgels:
    """Return the edge points of (H, W) uint8, without those at the image's border."""
    smooth = cv2.GaussianBlur(plane, (7, 7), SMOOTH_PX)
    slope_x = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125), dtype=np.float32)
    slope_y = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125), dtype=np.float32)
    size = np.asarray(cv2.magnitude(slope_x, slope_y), dtype=np.float32)
    # Neighbours are asked, and the border has none.
    size[:2] = size[-2:] = 0.0
    size[:, :2] = size[:, -2:] = 0.0
    at = np.flatnonzero(size > least_slope)
    flat = size.ravel()
    here = flat[at]
    x, y = slope_x.ravel()[at] / here, slope_y.ravel()[at] / here
    step_x, step_y = np.rint(x), np.rint(y)
    step = (step_y * size.shape[1] + step_x).astype(np.intp)
    before, after = flat[at - step], flat[at + step]
    peak = (here >= before) & (here > after)
    at, here, before, after, x, y = (part[peak] for part in (at, here, before, after, x, y))
    shift = 0.5 * (before - after) / (before - 2.0 * here + after)
    # The parabola lies along the step to a neighbour; the edge lies across the slope.
    along = shift * (step_x[peak] * x + step_y[peak] * y)
    rows, columns = np.divmod(at, size.shape[1])
    return Edgels((columns + along * x).astype(np.float32), (rows + along * y).astype(np.float32), x, y, here)
