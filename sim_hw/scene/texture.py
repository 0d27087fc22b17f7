"""Texture of a board from above, drawn from its CAD layers, one image for each light.

Drawn in tiles when first looked at: a class per point (copper? open mask? silk? hole? board?) at twice the
resolution, a reflectance per class, averaged down so that rims are smooth; then relief, tarnish and weave.
Rows run against y: texel (0, 0) is the upper left of the board as it lies in the robot, margin included.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.board.board import Board
from sim_hw.board.finish import Finish
from sim_hw.board.nest import Mark
from sim_hw.board.shapes import Shape
from sim_hw.board.surface import BOARD, COPPER, HOLE, INK, LEAD, OPEN, SOLDER
from sim_hw.scene.blemish import apply_gain, dirt, lay_dent, lay_spot, tarnished, tin_gain
from sim_hw.scene.palette import BENCH_RED, BENCH_WHITE, palette
from sim_hw.scene.tiles import TILE, Tile, TileStore

__all__ = ["BENCH_RED", "BENCH_WHITE", "TILE", "BoardTexture", "Image", "periodic_noise"]

Image = npt.NDArray[np.uint8]
Field = npt.NDArray[np.float32]

TEXEL_UM = 6.0
MARGIN_MM = 1.0
_FINE = 2
"""Class points per texel and direction."""
_SHIFT = 4
"""Fractional bits of polygon corners."""
_BORDER = 40
"""Texels round a tile that domed metal is drawn with, so that domes go on over its borders."""

_BENCH, _COVERED, _BARE = 0, 1, 2
_BITS = np.arange(256)
_IS_BARE = (_BITS & OPEN != 0) & (_BITS & COPPER != 0)
_KIND = np.where(_BITS & BOARD == 0, _BENCH, np.where(_IS_BARE, _BARE, _COVERED)).astype(np.uint8)
"""What surface a class is, for its fine structure."""
_METAL = np.where((_IS_BARE & (_BITS & HOLE == 0) | (_BITS & LEAD != 0)) & (_BITS & BOARD != 0), 255, 0)
_METAL = _METAL.astype(np.uint8)
_SOLDERED = np.where((_METAL > 0) & (_BITS & SOLDER != 0) & (_BITS & LEAD == 0), 255, 0).astype(np.uint8)
_COVERED_COPPER = np.where((_BITS & (COPPER | OPEN)) == COPPER, 255, 0).astype(np.uint8)


def periodic_noise(rng: np.random.Generator, scale_texels: float) -> npt.NDArray[np.float32]:
    """Return a (TILE, TILE) field of mean 0 and variance 1 that continues at its borders."""
    white = rng.standard_normal((TILE, TILE), dtype=np.float32)
    frequency = np.fft.fftfreq(TILE)[:, None] ** 2 + np.fft.rfftfreq(TILE)[None, :] ** 2
    keep = np.exp(-2.0 * np.pi**2 * scale_texels**2 * frequency)
    field = np.fft.irfft2(np.fft.rfft2(white) * keep, s=(TILE, TILE))
    return np.asarray((field - field.mean()) / field.std(), dtype=np.float32)


class BoardTexture:
    """Hold the images of a board side, uint8: `image` (H, W, 4) is `white` (BGR) and `red` in one.

    One array of four channels is warped faster than one of three.
    """

    def __init__(self, board: Board, seed: int, finish: Finish | None = None, marks: Sequence[Mark] = ()) -> None:
        width_mm, height_mm = board.size_mm
        per_mm = 1e3 / TEXEL_UM
        self.width = int((width_mm + 2 * MARGIN_MM) * per_mm)
        self.height = int((height_mm + 2 * MARGIN_MM) * per_mm)
        self._tiles = TileStore(self.width, self.height)
        self.image: Image = self._tiles.image
        self._board, self._marks, self._marks_seen = board, marks, len(marks)
        self._finish = finish = finish or Finish()
        none = (0.0, 0.0)
        self._layers = tuple(
            (bit, [self._placed(shape, board, shift_um) for shape in shapes])
            for bit, shapes, shift_um in (
                (COPPER, board.layers.copper, none),
                (OPEN, board.layers.mask, finish.mask_shift_um),
                (INK, board.layers.silk, finish.ink_shift_um),
                (HOLE, board.layers.holes, none),
                (BOARD, board.layers.outline, none),
                (SOLDER, board.layers.solder, none),
                (LEAD, board.layers.leads, none),
            )
        )
        self._boxes = [np.array([box for _, _, box in shapes]).reshape(-1, 4) for _, shapes in self._layers]
        self._palette = palette(finish)
        rng = np.random.default_rng(seed)
        slow, medium, fine = (periodic_noise(rng, scale) for scale in (170.0, 22.0, 2.5))
        self._mask_look = np.clip(128 + 9 * slow + 5 * medium + 4 * fine, 90, 170).astype(np.uint8)
        specks = np.where(medium * fine > 4.2, 18.0, 0.0)
        self._pad_look = np.clip(128 + 5 * slow + 7 * medium + 5 * fine + specks, 80, 180).astype(np.uint8)
        self._rough: tuple[Field, Field] | None = None
        if finish.metal == "hasl" or board.layers.solder:
            self._rough = (periodic_noise(rng, 14.0), periodic_noise(rng, 14.0))
        self._patches = periodic_noise(rng, 60.0) if finish.oxide > 0.0 else None
        self._spots = dirt((self.width, self.height), TEXEL_UM, finish.dirt_per_cm2, seed)

    @property
    def white(self) -> Image:
        """The look under the white lamp, (H, W, 3) BGR."""
        return self.image[..., :3]

    @property
    def red(self) -> Image:
        """The look under the red lamp, (H, W)."""
        return self.image[..., 3]

    @staticmethod
    def from_mm(board: Board) -> npt.NDArray[np.float64]:
        """Return the (3, 3) map from nominal board mm (u right, v up) to texels, centres at integers."""
        per_mm = 1e3 / TEXEL_UM
        left = MARGIN_MM * per_mm - 0.5
        top = (board.size_mm[1] + MARGIN_MM) * per_mm - 0.5
        return np.array([[per_mm, 0.0, left], [0.0, -per_mm, top], [0.0, 0.0, 1.0]])

    @staticmethod
    def _placed(
        shape: Shape, board: Board, shift_um: tuple[float, float]
    ) -> tuple[npt.NDArray[np.float32], bool, tuple[float, ...]]:
        """Return outline in class points (fine grid), its polarity and its box in texels."""
        x0, _, x1, y1 = board.outline_mm
        u = shape.outline_mm[:, 0] - x0 if board.side == "top" else x1 - shape.outline_mm[:, 0]
        per_mm = 1e3 / TEXEL_UM
        columns = (u + MARGIN_MM) * per_mm + shift_um[0] / TEXEL_UM
        rows = (y1 + MARGIN_MM - shape.outline_mm[:, 1]) * per_mm - shift_um[1] / TEXEL_UM
        box = (float(columns.min()), float(rows.min()), float(columns.max()), float(rows.max()))
        return (np.column_stack((columns, rows)).astype(np.float32), shape.dark, box)

    def ensure(self, x0: int, y0: int, x1: int, y1: int) -> None:
        """Draw the tiles that cover these texels, if they are not drawn yet; what was left long ago may be given up."""
        self._see_marks()
        wanted = self._covering(x0, y0, x1, y1)
        for tile in wanted:
            self._draw_once(tile)
        self._tiles.forget_beyond(wanted)

    def draw_one_more(self, window: tuple[int, int, int, int] | None = None) -> bool:
        """Draw one tile of a window (texels), else one nobody has looked at yet, if there is room; return False if not.

        The nearest to the window's middle comes first.
        """
        self._see_marks()
        if window is not None:
            wanted = self._covering(*window)
            missing = [tile for tile in wanted if not self._tiles.holds(tile)]
            if missing:
                self._draw_once(missing[0])
                self._tiles.forget_beyond(wanted)
                return True
        if self._tiles.full():
            return False
        missing = self._tiles.missing()
        if not missing:
            return False
        row, column = (0.0, 0.0) if window is None else (_middle(window[1::2]), _middle(window[::2]))
        self._draw_once(min(missing, key=lambda tile: (tile[0] - row) ** 2 + (tile[1] - column) ** 2))
        return True

    def _covering(self, x0: int, y0: int, x1: int, y1: int) -> list[Tile]:
        rows = range(max(0, y0) // TILE, (min(self.height, y1) - 1) // TILE + 1)
        return [(i, j) for i in rows for j in range(max(0, x0) // TILE, (min(self.width, x1) - 1) // TILE + 1)]

    def _see_marks(self) -> None:
        """Draw again what got a new dent."""
        fresh = self._marks[self._marks_seen :]
        self._marks_seen += len(fresh)
        for mark in fresh:
            (x, y), reach = self._place_of(mark), 2.0 * mark.radius_um / TEXEL_UM
            for tile in self._covering(int(x - reach), int(y - reach), int(x + reach) + 1, int(y + reach) + 1):
                self._tiles.forget(tile)

    def _place_of(self, mark: Mark) -> tuple[float, float]:
        x0, _, x1, y1 = self._board.outline_mm
        across_mm = mark.x_mm - x0 if self._board.side == "top" else x1 - mark.x_mm
        per_mm = 1e3 / TEXEL_UM
        return (across_mm + MARGIN_MM) * per_mm - 0.5, (y1 + MARGIN_MM - mark.y_mm) * per_mm - 0.5

    def _draw_once(self, tile: Tile) -> None:
        if not self._tiles.holds(tile):
            self._draw_tile(*tile)
        self._tiles.hold(tile)

    def _draw_tile(self, i: int, j: int) -> None:
        left, top = j * TILE, i * TILE
        classes = self._classes(left, top)
        planes = [cv2.LUT(classes, self._palette[:, k]) for k in range(4)]
        look = [cv2.resize(plane, (TILE, TILE), interpolation=cv2.INTER_AREA) for plane in planes]
        small = _at_texels(classes)
        kind = cv2.LUT(small, _KIND)
        variation = np.where(kind == _BARE, self._pad_look, self._mask_look)
        variation[kind == _BENCH] = 128
        relief = self._relief(classes)
        lit = [cv2.add(plane, relief, dtype=cv2.CV_8U) for plane in look]
        fine = [np.asarray(cv2.multiply(plane, variation, scale=1.0 / 128.0), dtype=np.uint8) for plane in lit]
        shaded = self._blemished(fine, small, left, top)
        height, width = min(TILE, self.height - top), min(TILE, self.width - left)
        view = np.s_[top : top + height, left : left + width]
        for k, plane in enumerate(shaded):
            self.image[view][..., k] = cv2.GaussianBlur(plane, (3, 3), 0.7)[:height, :width]

    def _blemished(self, planes: list[Image], small: Image, left: int, top: int) -> list[Image]:
        """Return the planes with what time, tin, dirt and the needle did to the board."""
        if self._patches is not None:
            planes = tarnished(planes, _looked_up(small, _METAL), self._patches, self._finish.oxide)
        if self._rough is not None:
            wide = self._classes(left - _BORDER, top - _BORDER, TILE + 2 * _BORDER)
            tinned = _looked_up(_at_texels(wide), _METAL if self._finish.metal == "hasl" else _SOLDERED)
            if tinned.any():
                planes = apply_gain(planes, tin_gain(tinned, self._rough, TEXEL_UM, _BORDER))
        for spot in self._spots:
            x0, y0, x1, y1 = spot.box
            if x0 <= left + TILE and x1 >= left and y0 <= top + TILE and y1 >= top:
                lay_spot(planes, spot, left, top)
        for mark in self._marks[: self._marks_seen]:
            x, y = self._place_of(mark)
            if left - TILE / 8 <= x <= left + TILE * 9 / 8 and top - TILE / 8 <= y <= top + TILE * 9 / 8:
                lay_dent(planes, (x - left, y - top), mark.radius_um / TEXEL_UM)
        return planes

    @staticmethod
    def _relief(classes: Image) -> npt.NDArray[np.int16]:
        """Return the light and shade (TILE, TILE) at the edges of copper that the mask covers."""
        covered = cv2.LUT(classes, _COVERED_COPPER)
        small = cv2.GaussianBlur(cv2.resize(covered, (TILE, TILE), interpolation=cv2.INTER_AREA), (7, 7), 1.6)
        slope = small.astype(np.int16)
        relief = np.zeros_like(slope)
        relief[2:, 2:] = (slope[2:, 2:] - slope[:-2, :-2]) >> 4
        return relief

    def _classes(self, left: int, top: int, texels: int = TILE) -> Image:
        size = texels * _FINE
        classes = np.zeros((size, size), dtype=np.uint8)
        for (bit, shapes), boxes in zip(self._layers, self._boxes, strict=True):
            layer = np.zeros((size, size), dtype=np.uint8)
            for k in self._touching(boxes, left, top, texels):
                outline, dark, _ = shapes[k]
                corners = (outline - (left, top)) * _FINE - 0.5  # centres of class points at integers
                fixed = np.round(corners * (1 << _SHIFT)).astype(np.int32)
                cv2.fillPoly(layer, [fixed], bit if dark else 0, cv2.LINE_8, _SHIFT)
            cv2.bitwise_or(classes, layer, dst=classes)
        return classes

    @staticmethod
    def _touching(boxes: npt.NDArray[np.float64], left: int, top: int, texels: int) -> Iterator[int]:
        hit = (boxes[:, 0] <= left + texels) & (boxes[:, 2] >= left)
        hit &= (boxes[:, 1] <= top + texels) & (boxes[:, 3] >= top)
        yield from np.flatnonzero(hit).tolist()


def _at_texels(classes: Image) -> Image:
    """Return the class of each texel: of one of its points."""
    size = classes.shape[0] // _FINE
    return np.asarray(cv2.resize(classes, (size, size), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def _looked_up(classes: Image, table: Image) -> Image:
    return np.asarray(cv2.LUT(classes, table), dtype=np.uint8)


def _middle(ends: Sequence[int]) -> float:
    """Return the middle of a span of texels, counted in tiles."""
    return sum(ends) / 2.0 / TILE - 0.5
