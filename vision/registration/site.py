"""Sites on bare metal: the place to touch with the most room to mask, holes, parts and earlier marks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
CENTRE_SHARE = 0.9
"""The middle of the metal is taken where it has so much of the most room there is."""
_TEXELS = 400
"""Across the metal's longer side; the finest texel is 2 um."""
_FINEST_UM = 2.0
_FRACTION_BITS = 4


@dataclass(frozen=True, slots=True)
class Site:
    """A place on bare metal, board frame, and how far everything else is from it; `fits`: at least the clearance."""

    x_um: float
    y_um: float
    room_um: float
    fits: bool


def free_site(
    metal_um: Sequence[Points] | Points,
    obstacles_um: Sequence[Points],
    clearance_um: float,
    away_um: tuple[float, float] | None = None,
) -> Site | None:
    """Return where on the metal the needle has most room; None where there is no free metal at all.

    metal_um: outline (N, 2), or several, of one pad's bare metal. obstacles_um: outlines of what must not be touched
    (holes, parts' bodies, solder, earlier marks); what is not metal is in the way too. clearance_um: the landing error
    to be expected and the tip's radius; it decides `fits`, and how far the middle or `away_um` (a direction the site
    should lie in, as away from the needle's shaft) may be followed.
    """
    outlines = [metal_um] if isinstance(metal_um, np.ndarray) else list(metal_um)
    outlines = [np.asarray(outline, dtype=np.float64).reshape(-1, 2) for outline in outlines]
    if not outlines:
        return None
    low = np.min([outline.min(axis=0) for outline in outlines], axis=0)
    high = np.max([outline.max(axis=0) for outline in outlines], axis=0)
    texel_um = max(_FINEST_UM, float((high - low).max()) / _TEXELS)
    room = _room(outlines, obstacles_um, low, high, texel_um)
    most = float(room.max())
    if most <= 0.0:
        return None
    row, column = _choose(room, (low + high) / 2.0, low, texel_um, clearance_um, away_um)
    # Texel centres: a texel beyond the border lies around the metal.
    x_um, y_um = (float(v) for v in low + (np.array((column, row)) - 0.5) * texel_um)
    found = float(room[row, column])
    return Site(x_um, y_um, found, found >= clearance_um)


def _room(
    outlines: list[Points], obstacles: Sequence[Points], low: Points, high: Points, texel_um: float
) -> NDArray[np.float64]:
    """Return the distance (rows, columns), um, of each texel to what is not free metal; one texel of border."""
    columns, rows = (int(v) for v in np.ceil((high - low) / texel_um))
    free = np.zeros((rows + 2, columns + 2), dtype=np.uint8)
    for value, polygons in ((255, outlines), (0, obstacles)):
        for polygon in polygons:
            corners = (np.asarray(polygon, dtype=np.float64) - low) / texel_um + 0.5
            fixed = np.clip(np.round(corners * (1 << _FRACTION_BITS)), -(1 << 28), 1 << 28).astype(np.int32)
            cv2.fillPoly(free, [fixed], value, cv2.LINE_8, _FRACTION_BITS)
    free[[0, -1], :] = 0
    free[:, [0, -1]] = 0
    # To the nearest texel's centre, whose border is half a texel nearer; and `fillPoly` paints the texels that the
    # border passes, up to half a texel too much. So there is never less room than is told.
    distance = np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), dtype=np.float64)
    return np.asarray(np.maximum(distance - 1.0, 0.0) * texel_um)


def _choose(
    room: NDArray[np.float64],
    middle: Points,
    low: Points,
    texel_um: float,
    clearance_um: float,
    away: tuple[float, float] | None,
) -> tuple[int, int]:
    most = float(room.max())
    enough = min(CENTRE_SHARE * most, max(clearance_um, 0.5 * most)) if away else CENTRE_SHARE * most
    rows, columns = np.nonzero(room >= enough)
    x, y = low[0] + (columns - 0.5) * texel_um, low[1] + (rows - 0.5) * texel_um
    if away is None:
        off = np.hypot(x - middle[0], y - middle[1])
        # The middle itself, else the roomiest place; of equals the one nearest the middle.
        best = int(np.argmin(off)) if float(off.min()) <= texel_um else _roomiest(room[rows, columns], off)
    else:
        best = int(np.argmax((x - middle[0]) * away[0] + (y - middle[1]) * away[1]))
    return int(rows[best]), int(columns[best])


def _roomiest(room: NDArray[np.float64], off: NDArray[np.float64]) -> int:
    top = np.flatnonzero(room >= float(room.max()) * 0.995)
    return int(top[np.argmin(off[top])])
