"""A patch of the image as a fine raster: polygons are filled on it and areas averaged down to pixels.

Image convention: x right, y down, pixel centres at integers. An outline is (N, 2) in px; one that runs with a positive
shoelace area is solid, one that runs the other way round is a void in the solid it is painted with.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]
Level = npt.NDArray[np.float32]
Shade = Callable[[Level, Level, Level], Level]
"""New level from the level below and the x and y (px) of the fine cells: arrays that broadcast."""

SHIFT = 6
"""Binary places that cv2.fillPoly is told a vertex with."""

FILL_GROWTH_CELLS = 0.46
"""cv2.fillPoly also fills every cell that the outline passes through; measured on discs of 4..20 px radius."""


class Canvas:
    """Square patch of ``2 * half_px`` pixels round a point, ``scale`` x ``scale`` cells a pixel."""

    def __init__(self, around_px: tuple[float, float], *, half_px: int = 150, scale: int = 8, ground: float) -> None:
        self.x0_px = round(around_px[0]) - half_px
        self.y0_px = round(around_px[1]) - half_px
        self.scale = scale
        self.cells: Level = np.full((2 * half_px * scale,) * 2, ground, np.float32)

    def paint(self, outlines_px: Sequence[Points], shade: Shade) -> None:
        """Give every cell inside the outlines (voids left out) its new level."""
        rings = [shrunk(to_cells(ring, self.x0_px, self.y0_px, self.scale), FILL_GROWTH_CELLS) for ring in outlines_px]
        low = np.maximum(np.floor(np.min([ring.min(axis=0) for ring in rings], axis=0)) - 1, 0).astype(int)
        high = np.minimum(np.ceil(np.max([ring.max(axis=0) for ring in rings], axis=0)) + 2, self.cells.shape[0])
        (u0, v0), (u1, v1) = low, high.astype(int)
        if u1 <= u0 or v1 <= v0:
            return
        inside = filled([ring - low for ring in rings], (v1 - v0, u1 - u0))
        x = (self.x0_px + (np.arange(u0, u1, dtype=np.float32) + 0.5) / self.scale - 0.5)[None, :]
        y = (self.y0_px + (np.arange(v0, v1, dtype=np.float32) + 0.5) / self.scale - 0.5)[:, None]
        under = self.cells[v0:v1, u0:u1]
        np.copyto(under, shade(under, x, y), where=inside > 0)

    def pixels(self) -> Level:
        """Return the area averages, (2 half_px, 2 half_px)."""
        side = self.cells.shape[0] // self.scale
        return cv2.resize(self.cells, (side, side), interpolation=cv2.INTER_AREA)

    def laid_into(self, frame: Level) -> None:
        """Write the patch to its place in ``frame``; what lies outside the frame is lost."""
        patch = self.pixels()
        height, width = frame.shape
        x0, y0 = max(self.x0_px, 0), max(self.y0_px, 0)
        x1, y1 = min(self.x0_px + patch.shape[1], width), min(self.y0_px + patch.shape[0], height)
        frame[y0:y1, x0:x1] = patch[y0 - self.y0_px : y1 - self.y0_px, x0 - self.x0_px : x1 - self.x0_px]


def to_cells(points_px: Points, x0_px: int, y0_px: int, scale: int) -> Points:
    """Return cell coordinates (cell centres at integers) of points in px; the raster's first pixel is (x0, y0)."""
    return (points_px - (x0_px, y0_px) + 0.5) * scale - 0.5


def shrunk(ring: Points, distance: float) -> Points:
    """Move each vertex inwards (outwards for a void) along the mean normal of its two sides."""
    side = np.roll(ring, -1, axis=0) - ring
    normal = np.column_stack((-side[:, 1], side[:, 0])) / np.maximum(np.hypot(side[:, 0], side[:, 1]), 1e-9)[:, None]
    mean = normal + np.roll(normal, 1, axis=0)
    length2 = np.maximum((mean**2).sum(axis=1), 0.5)
    return ring + mean * (2.0 * distance / length2)[:, None]


def filled(rings: Sequence[Points], shape: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Return 255 inside the rings (cell coordinates), 0 outside; crossings of rings cancel."""
    inside = np.zeros(shape, np.uint8)
    fixed = [np.rint(ring * 2**SHIFT).astype(np.int32) for ring in rings]
    cv2.fillPoly(inside, fixed, (255,), cv2.LINE_8, SHIFT)
    return inside


def coverage(outline_px: Points, shape: tuple[int, int], *, scale: int = 4) -> tuple[Level, int, int]:
    """Return (share covered, 0..1, of each pixel of the outline's box, x0_px, y0_px); the box is cut to the frame."""
    x0, y0 = (int(v) for v in np.clip(np.floor(outline_px.min(axis=0)) - 1, 0, None))
    x1 = min(int(np.ceil(outline_px[:, 0].max())) + 2, shape[1])
    y1 = min(int(np.ceil(outline_px[:, 1].max())) + 2, shape[0])
    ring = shrunk(to_cells(outline_px, x0, y0, scale), FILL_GROWTH_CELLS)
    fine = filled([ring], ((y1 - y0) * scale, (x1 - x0) * scale))
    share = cv2.resize(fine, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
    return share.astype(np.float32) / np.float32(255), x0, y0


def flat(level: float) -> Shade:
    """One level everywhere."""
    return lambda under, _x, _y: np.full_like(under, level)


def ramp(level: float, centre_px: tuple[float, float], slope: tuple[float, float]) -> Shade:
    """Return ``level`` at the centre, changing by the share ``slope`` (x, y) of it per px."""
    return lambda _under, x, y: level * (1.0 + slope[0] * (x - centre_px[0]) + slope[1] * (y - centre_px[1]))


def lifted(levels: float) -> Shade:
    """Return what is below, brighter by so many grey levels."""
    return lambda under, _x, _y: under + np.float32(levels)


def scaled(factor: float) -> Shade:
    """Return what is below times a factor."""
    return lambda under, _x, _y: under * np.float32(factor)


def capped(level: float) -> Shade:
    """Return what is below, but nowhere brighter than ``level``: wear over wear is no darker than the deeper one."""
    return lambda under, _x, _y: np.minimum(under, np.float32(level))
