"""Where the needle goes on a piece of bare metal: the place with the most free room, the middle where that is as good.

Sizes are judgement from 12 um to the pixel and the landing numbers of a station, not measured; they are what an
import asks for. A station's own landing numbers decide again when a point is placed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.domain.board import Form
from daemon.tools.board_import.pads import Pad
from daemon.tools.board_import.raster import Picture, flat_outlines

LEAST_ROUND_UM = 250.0
"""Diameter of a round pad without a hole."""
LEAST_VIA_UM = 300.0
"""Diameter of an open via that is touched in its middle."""
LARGEST_HOLE = 0.6
"""Share of a via's diameter that its hole may take for the needle to be put on its middle."""
LARGEST_MIDDLE_HOLE_UM = 400.0
"""Over a larger hole the needle finds no metal."""
LEAST_RING_UM = 200.0
"""Width of the metal beside a hole."""
LEAST_SIDE_UM = 240.0
"""Width of the metal of a pad of any shape about the target: 0.12 mm clear on each side."""
LEAST_TOE_UM = 200.0
"""Width of the metal of a part's pad beyond the part."""
LEAST_NAMED_UM = 100.0
"""Width of a named test point's metal: its maker meant it to be touched; less is not seen at 12 um to the pixel."""
ENOUGH_ROOM_UM = 250.0
"""With this room a part's pad is touched as far out as it goes, and no point of its class is better than it."""
ROUND_SHARE = 0.88
"""Share of a round thing's area that the largest disc in it fills; a square's is 0.79, an octagon's 0.95."""
RECTANGLE_FILL, OBLONG_FILL = 0.92, 0.75
"""Share of its smallest box that a shape fills: more than the first, with corners; more than the second, with ends."""
SLIM = 1.1
"""A pad longer than wide by this has a long axis."""
MIDDLE_SHARE, NEAR_MOST = 0.9, 0.97
"""Share of the most room with which the middle is taken, and with which any place counts as having the most."""
SMALL_PIXELS = 15_000
"""In larger pictures distances are taken to 2 %, which is five times as fast."""
OUTLINE_TOLERANCE_UM = 4.0


@dataclass(frozen=True, slots=True)
class Form2D:
    """Shape of a piece of bare metal. diameter, centre: of the round or ring, um."""

    form: Form
    diameter: float | None
    centre: tuple[float, float]
    long_axis: tuple[float, float] | None
    width: float
    """Of its smallest box, the short side."""
    outlines: tuple[tuple[int, ...], ...] = ()
    """Of the bare metal, flat whole um."""


@dataclass(frozen=True, slots=True)
class Target:
    """The best place of one pad for the needle."""

    x: float
    y: float
    room: float


def form_of(pad: Pad) -> Form2D:
    """Tell the shape of a pad's bare metal."""
    contours, _ = cv2.findContours(pad.metal, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    contour = max(contours, key=cv2.contourArea)
    outlines = flat_outlines(contours, pad.window, OUTLINE_TOLERANCE_UM)
    filled = np.zeros_like(pad.metal)
    cv2.drawContours(filled, [contour], 0, 1, -1)
    pitch = pad.window.pitch
    area = float(cv2.countNonZero(filled)) * pitch**2
    drilled = pad.hole is not None and not pad.hole.filled
    (cx, cy), (width, height), angle = cv2.minAreaRect(contour)
    fill = area / max((width + 1) * (height + 1) * pitch**2, 1.0)
    if fill <= RECTANGLE_FILL:
        room = _room(filled, pitch)
        radius = float(room.max()) + 0.3 * pitch
        if math.pi * radius**2 >= ROUND_SHARE * area:
            x, y = pad.window.um(np.array([_ridge(room)]))[0]
            form: Form = "ring" if drilled else "round"
            return Form2D(form, 2 * radius, (float(x), float(y)), None, 2 * radius, outlines)
    x, y = pad.window.um(np.array([(cx, cy)]))[0]
    turned = math.radians(angle + (0.0 if width >= height else 90.0))
    slim = max(width, height) >= SLIM * max(min(width, height), 1e-9)
    axis = (math.cos(turned), math.sin(turned)) if slim else None
    form = (
        "ring" if drilled else "rectangle" if fill > RECTANGLE_FILL else "oblong" if fill > OBLONG_FILL else "polygon"
    )
    return Form2D(form, None, (float(x), float(y)), axis, min(width, height) * pitch, outlines)


def _ridge(room: NDArray[np.float32]) -> tuple[float, float]:
    """Return the middle (column, row) of the places with the most room."""
    columns, rows = cv2.findNonZero((room >= room.max() - 0.5).astype(np.uint8)).reshape(-1, 2).T
    return float(columns.mean()), float(rows.mean())


def middle_target(shape: Form2D) -> Target | None:
    """Return the middle of round metal with its radius as room: for pads without a hole, and vias with a small one."""
    if shape.diameter is None:
        return None
    return Target(*shape.centre, shape.diameter / 2)


def best_target(pad: Pad, shape: Form2D, forbidden: Picture, outward: tuple[float, float] | None) -> Target | None:
    """Return the place with the most room on the metal that is not `forbidden`; None where nothing is left.

    outward: for a part's pad, the direction away from the part, in which it goes as far as the room is enough.
    """
    free = (pad.metal & ~forbidden & 1).astype(np.uint8)
    if not free.any():
        return None
    room = _room(free, pad.window.pitch)
    most = float(room.max())
    if most <= 0.0:
        return None
    if outward is not None:
        row, column = _outermost(room, min(most, ENOUGH_ROOM_UM), outward)
    else:
        for x, y in ((pad.x, pad.y), shape.centre):
            where = pad.window.at(x, y)
            if where is not None and room[where] >= MIDDLE_SHARE * most:
                return Target(x, y, float(room[where]))
        row, column = _most_room(pad, room, forbidden)
    x, y = pad.window.um(np.array([(column, row)]))[0]
    return Target(float(x), float(y), float(room[row, column]))


def _room(free: Picture, pitch: float) -> NDArray[np.float32]:
    """Return, for each pixel, how far it is to the edge of what is free, um; the window's edge is an edge, too."""
    room = np.zeros(free.shape, np.float32)
    column, row, columns, rows = cv2.boundingRect(free)
    cut = np.s_[row : row + rows, column : column + columns]
    bordered = cv2.copyMakeBorder(free[cut], 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    # Filling takes edge pixels in: the nearest pixel that is not free lies 0.2 (disc) to 1 pixel beyond the edge.
    exactness = cv2.DIST_MASK_PRECISE if free[cut].size < SMALL_PIXELS else cv2.DIST_MASK_5
    away = cv2.distanceTransform(bordered, cv2.DIST_L2, exactness)[1:-1, 1:-1]
    room[cut] = np.maximum(away - 0.5, 0.0) * pitch
    return room


def _most_room(pad: Pad, room: NDArray[np.float32], forbidden: Picture) -> tuple[int, int]:
    """Return row and column of the most room, of several the one farthest from other metal and bodies."""
    most = float(room.max())
    blocked = (pad.others | forbidden) & 1
    columns, rows = cv2.findNonZero((room >= NEAR_MOST * most).astype(np.uint8)).reshape(-1, 2).T
    if not blocked.any():
        nearest = np.hypot(*(pad.window.um(np.column_stack((columns, rows))) - (pad.x, pad.y)).T)
        i = int(nearest.argmin())
        return int(rows[i]), int(columns[i])
    away = cv2.distanceTransform(1 - blocked, cv2.DIST_L2, cv2.DIST_MASK_5)
    i = int(away[rows, columns].argmax())
    return int(rows[i]), int(columns[i])


def _outermost(room: NDArray[np.float32], wanted: float, outward: tuple[float, float]) -> tuple[int, int]:
    """Return row and column of the outermost place whose room is wanted, in the middle of those as far out."""
    columns, rows = cv2.findNonZero((room >= NEAR_MOST * wanted).astype(np.uint8)).reshape(-1, 2).T
    out = columns * outward[0] + rows * outward[1]
    edge = out >= out.max() - 1.0
    rows, columns = rows[edge], columns[edge]
    middle = int(np.hypot(rows - rows.mean(), columns - columns.mean()).argmin())
    return int(rows[middle]), int(columns[middle])
