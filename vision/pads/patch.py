"""Pixels in and round a disc, laid out by their distance from its centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vision.core import CircleFit, Floats, Plane
from vision.pads.window import Flags, Window


@dataclass(frozen=True, slots=True)
class Patch:
    """The pixels round a disc: brightness, distance from its centre in radii, what can be seen; each (h, w)."""

    x_px: int
    y_px: int
    level: Plane
    rho: Floats
    free: Flags

    @property
    def box(self) -> tuple[slice, slice]:
        """Where the patch lies in its window."""
        height, width = self.level.shape
        return slice(self.y_px, self.y_px + height), slice(self.x_px, self.x_px + width)

    def distance_px(self, x_px: float, y_px: float) -> Floats:
        """Return every pixel's distance from a point of the window, px."""
        rows, columns = np.ogrid[: self.level.shape[0], : self.level.shape[1]]
        return np.asarray(np.hypot(columns + self.x_px - x_px, rows + self.y_px - y_px))


def cut_patch(window: Window, circle: CircleFit) -> Patch:
    """Cut out the pixels to 1.4 radii and a little from a circle's centre."""
    contour = circle.contour
    height, width = window.shape
    reach = int(circle.radius_px * 1.4) + 4
    x1, y1 = max(int(contour.x_px) - reach, 0), max(int(contour.y_px) - reach, 0)
    x2, y2 = min(int(contour.x_px) + reach + 1, width), min(int(contour.y_px) + reach + 1, height)
    linear = window.view.flattening()
    dx, dy = np.arange(x1, x2)[None, :] - contour.x_px, np.arange(y1, y2)[:, None] - contour.y_px
    u, v = linear[0, 0] * dx + linear[0, 1] * dy, linear[1, 0] * dx + linear[1, 1] * dy
    square = np.maximum(u * u + v * v, 1e-6)
    harmonic = (contour.cos2_px * (u * u - v * v) + contour.sin2_px * 2.0 * u * v) / square
    rho = np.sqrt(square) / (contour.radius_px + harmonic)
    return Patch(x1, y1, window.raw[y1:y2, x1:x2], rho, ~window.hidden[y1:y2, x1:x2])
