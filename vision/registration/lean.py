"""Parts that stand before the board: in an oblique view each hides what lies behind it, as far as it is tall.

Heights are in no file that registration reads. What a part may hide is taken from its outline: the wider, the taller.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.registration.drawing import Grid, Material, Planes
from vision.registration.rectify import Picture
from vision.registration.reference import Reference
from vision.registration.sheet import Sheet, without
from vision.registration.spectra import transform

HEIGHTS_UM = ((0.0, 1200.0), (1500.0, 1800.0), (3000.0, 3000.0))
"""A part as wide as the first, the shorter way across, is taken to be as tall as the second."""
LEAST_TILT = 0.05
"""Tangent of the view's tilt; below it nothing leans by more than parts' outlines are uncertain."""
LEAST_PERSPECTIVE = 0.005
"""Change of scale over 6 mm, below which it does not say which way the view is tilted: then both are hidden."""
SPAN_UM = 6000.0

Mask = NDArray[np.bool_]


def beside_parts(reference: Reference, picture: Picture) -> Reference:
    """Return the reference with what parts may hide in this picture as not known; the same one for a bare board."""
    parts = reference.wide.planes.cover[Material.UNKNOWN]
    if not reference.has_parts:
        return reference
    ways = lean(picture, reference.about_um)
    grid = reference.wide.planes.grid
    hidden = np.zeros(parts.shape, dtype=np.uint8)
    standing = (parts > 0.5).astype(np.uint8)
    for wide_um, tall_um in HEIGHTS_UM:
        cells = round(wide_um / grid.cell_um)
        some = cv2.morphologyEx(standing, cv2.MORPH_OPEN, np.ones((cells, cells), np.uint8)) if cells > 1 else standing
        for x, y in ways:
            hidden |= _swept(np.asarray(some, dtype=np.uint8), (x * tall_um / grid.cell_um, y * tall_um / grid.cell_um))
    return replace(
        reference,
        fine=_hide(reference.fine, hidden, grid),
        middle=_hide(reference.middle, hidden, grid),
        wide=without(reference.wide, hidden > 0),
        spectra=transform(_unknown(reference.wide.planes, hidden > 0), reference.about_um),
    )


def _unknown(planes: Planes, hidden: Mask) -> Planes:
    """Return planes of which CAD cannot say what some cells show."""
    cover = planes.cover * ~hidden
    cover[Material.UNKNOWN][hidden] = 1.0
    return replace(planes, cover=cover)


def lean(picture: Picture, place_um: tuple[float, float]) -> list[tuple[float, float]]:
    """Return where the top of something upright is seen, board um for each um of its height: a way, or two that may be.

    A view that is tilted is foreshortened along the tilt, and shrinks with the distance.
    """
    slope = picture.slope(*place_um)
    _, (long, short), axes = np.linalg.svd(slope)
    tilt = math.sqrt(max(0.0, float(long / short) ** 2 - 1.0))
    if tilt < LEAST_TILT:
        return []
    way = axes[1] * tilt
    h = picture.board_to_px
    depth = float(h[2] @ (*place_um, 1.0))
    farther = float(h[2, :2] @ axes[1]) / depth * SPAN_UM
    x, y = float(way[0]), float(way[1])
    if abs(farther) < LEAST_PERSPECTIVE:
        return [(x, y), (-x, -y)]
    return [(x, y)] if farther > 0.0 else [(-x, -y)]


def _swept(standing: NDArray[np.uint8], way: tuple[float, float]) -> NDArray[np.uint8]:
    """Return what a mask passes over when it is moved by so many cells."""
    steps = max(1, math.ceil(math.log2(max(math.hypot(*way), 1.0)))) + 1
    x, y = (value / (1 << steps) for value in way)
    # Each shift is twice the one before, the first of half a cell at most.
    passed: NDArray[np.uint8] = standing
    rows, columns = standing.shape
    for k in range(steps):
        moved = np.array([[1.0, 0.0, x * (1 << k)], [0.0, 1.0, y * (1 << k)]])
        shifted = cv2.warpAffine(passed, moved, (columns, rows), flags=cv2.INTER_NEAREST)
        passed = np.asarray(cv2.bitwise_or(passed, shifted), dtype=np.uint8)
    return passed


def _hide(sheet: Sheet, hidden: NDArray[np.uint8], grid: Grid) -> Sheet:
    """Return a sheet without what is hidden, which is told in cells of another grid."""
    own = sheet.planes.grid
    to_hidden = np.linalg.inv(grid.to_um) @ own.to_um
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    laid = cv2.warpAffine(hidden * np.uint8(255), to_hidden[:2], (own.columns, own.rows), flags=flags)
    return without(sheet, np.asarray(laid) > 127)
