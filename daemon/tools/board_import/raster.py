"""Pictures of CAD layers in small windows: polygons painted in order, so that no polygon is ever clipped.

A window's pixel (column, row) covers the board from `x0 + column * pitch` to one pitch further, y up with the rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.tools.board_import.frame import Box, Hole, Painted, Points, SideCad

Picture = NDArray[np.uint8]
_FRACTION_BITS = 4


@dataclass(frozen=True, slots=True)
class Window:
    """A rectangle of the board at `pitch` um per pixel."""

    x0: float
    y0: float
    columns: int
    rows: int
    pitch: float

    @classmethod
    def over(cls, box: Box, pitch: float) -> Window:
        """Make the window that covers a box."""
        columns, rows = (max(1, int(np.ceil((high - low) / pitch))) for low, high in zip(box[:2], box[2:], strict=True))
        return cls(box[0], box[1], columns, rows, pitch)

    @property
    def box(self) -> Box:
        """What it covers, um."""
        return self.x0, self.y0, self.x0 + self.columns * self.pitch, self.y0 + self.rows * self.pitch

    def blank(self) -> Picture:
        """Return an empty picture of it."""
        return np.zeros((self.rows, self.columns), np.uint8)

    def pixels(self, points: Points) -> NDArray[np.float64]:
        """Return where points (N, 2) um lie; pixel centres at integers."""
        moved: NDArray[np.float64] = (np.asarray(points) - (self.x0, self.y0)) / self.pitch - 0.5
        return moved

    def um(self, pixels: NDArray[Any]) -> Points:
        """Return the places (N, 2) um of pixels (column, row)."""
        moved: Points = (np.asarray(pixels, dtype=np.float64) + 0.5) * self.pitch + (self.x0, self.y0)
        return moved

    def at(self, x: float, y: float) -> tuple[int, int] | None:
        """Return row and column of a place, None outside."""
        column, row = int((x - self.x0) // self.pitch), int((y - self.y0) // self.pitch)
        return (row, column) if 0 <= row < self.rows and 0 <= column < self.columns else None

    def fill(self, picture: Picture, polygon: Points, value: int) -> None:
        """Fill a polygon."""
        fixed = np.rint(self.pixels(polygon) * (1 << _FRACTION_BITS)).astype(np.int32)
        cv2.fillPoly(picture, [fixed], value, shift=_FRACTION_BITS)

    def paint(self, layer: Painted) -> Picture:
        """Paint a layer in its order: 1 where it ends up dark."""
        picture = self.blank()
        for i in layer.within(self.box):
            self.fill(picture, layer.polygons[i], int(layer.dark[i]))
        return picture

    def drill(self, picture: Picture, holes: list[Hole], value: int = 0) -> None:
        """Put `value` where holes and slots are."""
        for hole in holes:
            (ax, ay), (bx, by) = np.rint(
                self.pixels(np.array([(hole.x, hole.y), (hole.end_x, hole.end_y)])) * (1 << _FRACTION_BITS)
            ).astype(int)
            radius = hole.diameter / 2 / self.pitch
            if (ax, ay) != (bx, by):
                self.fill(picture, _slot(hole), value)
            cv2.circle(picture, (int(ax), int(ay)), round(radius * (1 << _FRACTION_BITS)), value, -1, cv2.LINE_8,
                       _FRACTION_BITS)  # fmt: skip
            cv2.circle(picture, (int(bx), int(by)), round(radius * (1 << _FRACTION_BITS)), value, -1, cv2.LINE_8,
                       _FRACTION_BITS)  # fmt: skip

    def bare_metal(self, side: SideCad) -> Picture:
        """Paint what is bare: copper in an opening, less the holes that are open."""
        metal = self.paint(side.mask)
        if metal.any():
            metal &= self.paint(side.copper)
            self.drill(metal, [h for h in side.holes_within(self.box) if not h.filled])
        return metal


def _slot(hole: Hole) -> Points:
    """Return the rectangle between a slot's round ends."""
    along = np.array((hole.end_x - hole.x, hole.end_y - hole.y))
    across = np.array((-along[1], along[0])) / np.hypot(*along) * hole.diameter / 2
    a, b = np.array((hole.x, hole.y)), np.array((hole.end_x, hole.end_y))
    return np.array((a + across, b + across, b - across, a - across))


def flat_outlines(contours: Sequence[NDArray[Any]], window: Window, tolerance_um: float) -> tuple[tuple[int, ...], ...]:
    """Return contours of a window's picture as flat whole um, simplified to `tolerance_um`."""
    flat = []
    for contour in contours:
        simple = cv2.approxPolyDP(contour, tolerance_um / window.pitch, closed=True).reshape(-1, 2)
        if len(simple) >= 3:
            flat.append(tuple(np.rint(window.um(simple)).astype(int).ravel().tolist()))
    return tuple(flat)
