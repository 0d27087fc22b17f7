"""The picture on the board's grid: reduced by area averages, then one warp to cells that lie on the board.

What cannot be seen (out of the frame, behind the needle) is hidden, not dark.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Gray, Plane
from vision.registration.drawing import Grid

Matrix = NDArray[np.float64]
Mask = NDArray[np.bool_]
HIDDEN_MARGIN_PX = 4
_SEEN = 254
_SPARE_PX = 12
"""A part of the picture is cut so much wider than asked, for the next asks for a little beside it."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the board lies against what was assumed: turned by `turn_deg` about (about_um), then shifted, um."""

    x_um: float = 0.0
    y_um: float = 0.0
    turn_deg: float = 0.0
    about_um: tuple[float, float] = (0.0, 0.0)

    @property
    def matrix(self) -> Matrix:
        """The map (3, 3) from CAD to the board frame as assumed."""
        turn = math.radians(self.turn_deg)
        c, s = math.cos(turn), math.sin(turn)
        ax, ay = self.about_um
        return np.array(
            [
                [c, -s, ax - c * ax + s * ay + self.x_um],
                [s, c, ay - s * ax - c * ay + self.y_um],
                [0.0, 0.0, 1.0],
            ]
        )

    def apply(self, x_um: float, y_um: float) -> tuple[float, float]:
        """Return where a place of CAD lies in the board frame as assumed."""
        x, y, _ = self.matrix @ (x_um, y_um, 1.0)
        return float(x), float(y)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """A part of the reduced picture: its corner, columns and rows left of and above it, levels, what is seen (255)."""

    left: int
    top: int
    levels: Plane
    seen: Gray

    def holds(self, box: tuple[int, int, int, int]) -> bool:
        height, width = self.levels.shape
        return (
            box[0] >= self.left and box[1] >= self.top and box[2] <= self.left + width and box[3] <= self.top + height
        )


@dataclass(slots=True, eq=False)
class Picture:
    """A red picture, reduced on demand, with what is hidden; not for use by two threads at once.

    plane: (H, W) uint8. board_to_px: (3, 3) from the board frame as assumed, um. hidden_px: polygons (N, 2).
    """

    plane: Gray
    board_to_px: Matrix
    hidden_px: tuple[NDArray[np.float64], ...]
    _reduced: dict[int, Gray] = field(default_factory=dict)
    _parts: dict[int, _Part] = field(default_factory=dict)
    _clear: dict[int, Gray] | None = None
    """What is seen of the whole, where several maps share it."""

    @classmethod
    def of(cls, plane: Gray, board_to_px: Matrix, hidden_px: Sequence[NDArray[np.float64]]) -> Picture:
        """Take a picture; polygons (N, 2), px, and a margin about them are hidden."""
        polygons = tuple(np.asarray(p, dtype=np.float64).reshape(-1, 2) for p in hidden_px if len(p))
        return cls(plane, np.asarray(board_to_px, dtype=np.float64), polygons)

    def under(self, board_to_px: Matrix) -> Picture:
        """Return the same picture by another map; what is reduced and what is hidden is worked out once for all."""
        if self._clear is None:
            self._clear = {}
        return replace(self, board_to_px=np.asarray(board_to_px, dtype=np.float64), _parts={})

    def um_per_px(self, x_um: float, y_um: float) -> float:
        """Return the size of a pixel on the board at a place (the root of its area)."""
        return float(1.0 / np.sqrt(abs(np.linalg.det(self.slope(x_um, y_um)))))

    def to_px(self, x_um: float, y_um: float) -> tuple[float, float]:
        """Return the pixel of a place of the board frame as assumed."""
        x, y, w = self.board_to_px @ (x_um, y_um, 1.0)
        return float(x / w), float(y / w)

    def slope(self, x_um: float, y_um: float) -> Matrix:
        """Return the (2, 2) derivative of the pixel by the place, px/um."""
        h = self.board_to_px
        q = h @ (x_um, y_um, 1.0)
        return np.asarray((h[:2, :2] - np.outer(q[:2] / q[2], h[2, :2])) / q[2])

    def on(self, grid: Grid, pose: Pose, px_per_cell: float) -> tuple[Plane, Mask]:
        """Return the picture (rows, columns) on cells of CAD as it lies by `pose`, and which of them are seen."""
        # Averages over a power of two, at most the cell and a third: what is averaged once serves several cells.
        factor = 1 << max(0, math.floor(math.log2(max(px_per_cell, 1.0)) + 0.42))
        matrix = _shrink(factor) @ self.board_to_px @ pose.matrix @ grid.to_um
        part = self._part(factor, _box(matrix, grid))
        matrix = np.array([[1.0, 0.0, -part.left], [0.0, 1.0, -part.top], [0.0, 0.0, 1.0]]) @ matrix
        size = (grid.columns, grid.rows)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        warped = cv2.warpPerspective(part.levels, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        seen = cv2.warpPerspective(part.seen, matrix, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        return np.asarray(warped, dtype=np.float32), np.asarray(seen) >= _SEEN

    def _part(self, factor: int, box: tuple[int, int, int, int]) -> _Part:
        whole = self._whole(factor)
        height, width = whole.shape
        inside = (max(0, box[0]), max(0, box[1]), min(width, box[2]), min(height, box[3]))
        kept = self._parts.get(factor)
        if kept is not None and kept.holds(inside):
            return kept
        left, top = min(max(0, box[0] - _SPARE_PX), width - 1), min(max(0, box[1] - _SPARE_PX), height - 1)
        right, bottom = max(left + 1, min(width, box[2] + _SPARE_PX)), max(top + 1, min(height, box[3] + _SPARE_PX))
        levels = whole[top:bottom, left:right].astype(np.float32)
        if self._clear is None:
            seen = self._seen(factor, (left, top), levels.shape)
        else:
            seen = self._seen_of_whole(factor)[top:bottom, left:right]
        part = _Part(left, top, levels, seen)
        self._parts[factor] = part
        return part

    def _seen_of_whole(self, factor: int) -> Gray:
        kept = {} if self._clear is None else self._clear
        if factor not in kept:
            kept[factor] = self._seen(factor, (0, 0), self._whole(factor).shape)
        return kept[factor]

    def _whole(self, factor: int) -> Gray:
        """Return the whole picture reduced; half the next finer one's size."""
        if factor == 1:
            return self.plane
        if factor not in self._reduced:
            # Halves of halves: averages of four are ten times as fast as those of sixteen.
            finer = self._whole(factor // 2)
            height, width = max(1, finer.shape[0] // 2), max(1, finer.shape[1] // 2)
            cut = np.ascontiguousarray(finer[: height * 2, : width * 2])
            self._reduced[factor] = np.asarray(
                cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8
            )
        return self._reduced[factor]

    def _seen(self, factor: int, corner: tuple[int, int], shape: tuple[int, ...]) -> Gray:
        seen = np.full(shape, 255, dtype=np.uint8)
        if not self.hidden_px:
            return seen
        for polygon in self.hidden_px:
            small = (polygon + 0.5) / factor - 0.5 - np.asarray(corner)
            corners = np.round(np.clip(small, -1e5, 1e5) * 16.0).astype(np.int32)
            cv2.fillPoly(seen, [corners], 0, cv2.LINE_8, 4)
        width = 2 * math.ceil(HIDDEN_MARGIN_PX / factor) + 1
        return np.asarray(cv2.erode(seen, np.ones((width, width), dtype=np.uint8)), dtype=np.uint8)


def _shrink(factor: int) -> Matrix:
    aside = 0.5 / factor - 0.5
    return np.array([[1.0 / factor, 0.0, aside], [0.0, 1.0 / factor, aside], [0.0, 0.0, 1.0]])


def _box(matrix: Matrix, grid: Grid) -> tuple[int, int, int, int]:
    """Return the box (left, top, right, bottom) of what the grid takes of the reduced picture."""
    last = np.array([[0, 0], [grid.columns, 0], [grid.columns, grid.rows], [0, grid.rows]]) - 0.5
    mapped = np.column_stack((last, np.ones(4))) @ matrix.T
    points = mapped[:, :2] / mapped[:, 2:]
    low, high = np.floor(points.min(axis=0)) - 1, np.ceil(points.max(axis=0)) + 2
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])
