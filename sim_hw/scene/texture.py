"""Texture of a board from above, drawn from its CAD layers, one image for each light.

Drawn in tiles when first looked at: a class per point (copper? open mask? silk? hole? board?) at twice the
resolution, a reflectance per class, averaged down so that rims are smooth; then relief, tarnish and weave.
Most of a board is the same as what is beside it, so that the mean is computed at the rims alone.
Rows run against y: texel (0, 0) is the upper left of the board as it lies in the robot, margin included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.board.board import Board
from sim_hw.board.finish import Finish
from sim_hw.board.nest import Mark
from sim_hw.board.shapes import Shape
from sim_hw.board.surface import BOARD, COPPER, HOLE, INK, LEAD, OPEN, SOLDER
from sim_hw.scene.blemish import dirt, lay_dent, lay_spot, lay_tin, tarnished
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

_ALL_BITS = 255
_BITS = np.arange(256)
_IS_BARE = (_BITS & OPEN != 0) & (_BITS & COPPER != 0)
_BENCH = np.where(_BITS & BOARD == 0, 255, 0).astype(np.uint8)
_BARE = np.where((_BITS & BOARD != 0) & _IS_BARE, 255, 0).astype(np.uint8)
"""What surface a class is, for its fine structure; all else is mask or laminate."""
_METAL = np.where((_IS_BARE & (_BITS & HOLE == 0) | (_BITS & LEAD != 0)) & (_BITS & BOARD != 0), 255, 0)
_METAL = _METAL.astype(np.uint8)
_SOLDERED = np.where((_METAL > 0) & (_BITS & SOLDER != 0) & (_BITS & LEAD == 0), 255, 0).astype(np.uint8)
_COVERED_COPPER = np.where((_BITS & (COPPER | OPEN)) == COPPER, 255, 0).astype(np.uint8)
_LIGHTER, _DARKER = (_BITS >> 4).astype(np.uint8), ((_BITS + 15) >> 4).astype(np.uint8)
"""Relief by how much the copper rises or falls there: a sixteenth, rounded down towards the dark."""


def periodic_noise(rng: np.random.Generator, scale_texels: float) -> npt.NDArray[np.float32]:
    """Return a (TILE, TILE) field of mean 0 and variance 1 that continues at its borders."""
    white = rng.standard_normal((TILE, TILE), dtype=np.float32)
    frequency = np.fft.fftfreq(TILE)[:, None] ** 2 + np.fft.rfftfreq(TILE)[None, :] ** 2
    keep = np.exp(-2.0 * np.pi**2 * scale_texels**2 * frequency)
    field = np.fft.irfft2(np.fft.rfft2(white) * keep, s=(TILE, TILE))
    return np.asarray((field - field.mean()) / field.std(), dtype=np.float32)


@dataclass(frozen=True)
class _Layer:
    """Polygons of one bit: corners in fractions of class points (int32), polarities, boxes (N, 4) in texels."""

    bit: int
    outlines: list[npt.NDArray[np.int32]]
    dark: list[bool]
    boxes: npt.NDArray[np.float64]

    def touching(self, left: int, top: int, texels: int) -> list[int]:
        """Return which polygons may show in a square, in drawing order."""
        boxes = self.boxes
        hit = (boxes[:, 0] <= left + texels) & (boxes[:, 2] >= left)
        hit &= (boxes[:, 1] <= top + texels) & (boxes[:, 3] >= top)
        found: list[int] = np.flatnonzero(hit).tolist()
        return found

    def paint(self, classes: Image, chosen: list[int], left: int, top: int) -> None:
        """Add the bit to the classes of a square where the chosen polygons lie."""
        layer = np.zeros_like(classes)  # of full size: a polygon's rim depends a little on where it is cut off
        away = np.array((left, top), dtype=np.int32) * (_FINE << _SHIFT)
        for k in chosen:
            cv2.fillPoly(layer, [self.outlines[k] - away], self.bit if self.dark[k] else 0, cv2.LINE_8, _SHIFT)
        boxes = (self.boxes[chosen] - (left, top, left, top)) * _FINE
        x0, y0 = np.maximum(boxes[:, :2].min(axis=0).astype(int) - 2, 0)
        x1, y1 = np.maximum(boxes[:, 2:].max(axis=0).astype(int) + 3, 0)
        cv2.bitwise_or(classes[y0:y1, x0:x1], layer[y0:y1, x0:x1], dst=classes[y0:y1, x0:x1])


class _Points:
    """The four class points of each texel. `small` (N, N) is the class of the first: of all four but at rims."""

    def __init__(self, classes: Image) -> None:
        self.small = _at_texels(classes)
        same = self.small.astype(np.uint16) * np.uint16(257)  # two equal bytes beside each other
        pairs = classes.view(np.uint16)
        self._rims = np.flatnonzero((pairs[::2] != same) | (pairs[1::2] != same))
        rows, columns = np.divmod(self._rims, self.small.shape[1])
        self._four = [classes[_FINE * rows + i, _FINE * columns + j] for i in range(_FINE) for j in range(_FINE)]

    def mean(self, table: Image) -> Image:
        """Return what a table says of each texel's points, averaged; halves are rounded up."""
        plane = _looked_up(self.small, table)
        wide = table.astype(np.uint16)
        first, second, third, fourth = (wide[points] for points in self._four)
        plane.reshape(-1)[self._rims] = (first + second + third + fourth + 2) >> 2
        return plane


class BoardTexture:
    """Hold the images of a board side, uint8: `image` (H, W, 4) is `white` (BGR) and `red` in one.

    One array of four channels is warped faster than one of three. `tiles` is how many are kept, see TileStore.
    """

    def __init__(
        self,
        board: Board,
        seed: int,
        finish: Finish | None = None,
        marks: Sequence[Mark] = (),
        tiles: int | None = None,
    ) -> None:
        width_mm, height_mm = board.size_mm
        per_mm = 1e3 / TEXEL_UM
        self.width = int((width_mm + 2 * MARGIN_MM) * per_mm)
        self.height = int((height_mm + 2 * MARGIN_MM) * per_mm)
        self._tiles = TileStore(self.width, self.height, tiles)
        self.image: Image = self._tiles.image
        self._board, self._marks, self._marks_seen = board, marks, len(marks)
        self._finish = finish = finish or Finish()
        none = (0.0, 0.0)
        self._layers = tuple(
            self._placed(bit, shapes, board, shift_um)
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
        self._palette = [np.ascontiguousarray(plane) for plane in palette(finish).T]
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
    def _placed(bit: int, shapes: Sequence[Shape], board: Board, shift_um: tuple[float, float]) -> _Layer:
        """Return a layer as it lies in the image."""
        x0, _, x1, y1 = board.outline_mm
        per_mm = 1e3 / TEXEL_UM
        outlines, boxes = [], []
        for shape in shapes:
            u = shape.outline_mm[:, 0] - x0 if board.side == "top" else x1 - shape.outline_mm[:, 0]
            columns = (u + MARGIN_MM) * per_mm + shift_um[0] / TEXEL_UM
            rows = (y1 + MARGIN_MM - shape.outline_mm[:, 1]) * per_mm - shift_um[1] / TEXEL_UM
            boxes.append((columns.min(), rows.min(), columns.max(), rows.max()))
            corners = np.column_stack((columns, rows)).astype(np.float32).astype(np.float64)
            centred = corners * _FINE - 0.5  # centres of class points at integers
            outlines.append(np.round(centred * (1 << _SHIFT)).astype(np.int32))
        return _Layer(bit, outlines, [shape.dark for shape in shapes], np.array(boxes).reshape(-1, 4))

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
        points = _Points(self._classes(left, top))
        lighter, darker = self._relief(points)
        variation = self._variation(points.small)
        planes = []
        for table in self._palette:
            lit = cv2.subtract(cv2.add(points.mean(table), lighter), darker)
            planes.append(np.asarray(cv2.multiply(lit, variation, scale=1.0 / 128.0), dtype=np.uint8))
        shaded = self._blemished(planes, points.small, left, top)
        height, width = min(TILE, self.height - top), min(TILE, self.width - left)
        blurred = cv2.GaussianBlur(cv2.merge(shaded), (3, 3), 0.7)
        self.image[top : top + height, left : left + width] = blurred[:height, :width]

    def _variation(self, small: Image) -> Image:
        """Return the fine structure (TILE, TILE) of what is there, 128 for none."""
        variation: Image = self._mask_look.copy()
        bare, bench = _looked_up(small, _BARE), _looked_up(small, _BENCH)
        cv2.copyTo(self._pad_look, bare, variation)
        if bench.any():
            variation[bench > 0] = 128
        return variation

    def _blemished(self, planes: list[Image], small: Image, left: int, top: int) -> list[Image]:
        """Return the planes with what time, tin, dirt and the needle did to the board."""
        if self._patches is not None:
            planes = tarnished(planes, _looked_up(small, _METAL), self._patches, self._finish.oxide)
        if self._rough is not None:
            lay_tin(planes, self._tinned(left, top), self._rough, TEXEL_UM, _BORDER)
        for spot in self._spots:
            x0, y0, x1, y1 = spot.box
            if x0 <= left + TILE and x1 >= left and y0 <= top + TILE and y1 >= top:
                lay_spot(planes, spot, left, top)
        for mark in self._marks[: self._marks_seen]:
            x, y = self._place_of(mark)
            if left - TILE / 8 <= x <= left + TILE * 9 / 8 and top - TILE / 8 <= y <= top + TILE * 9 / 8:
                lay_dent(planes, (x - left, y - top), mark.radius_um / TEXEL_UM)
        return planes

    def _tinned(self, left: int, top: int) -> Image | None:
        """Return where a tile and its surroundings are domed (255), or None where nothing is."""
        wide = (left - _BORDER, top - _BORDER, TILE + 2 * _BORDER)
        hasl = self._finish.metal == "hasl"
        needed = OPEN | LEAD if hasl else SOLDER
        if not any(layer.bit & needed and layer.touching(*wide) for layer in self._layers):
            return None
        return _looked_up(_at_texels(self._classes(*wide, bits=_ALL_BITS & ~INK)), _METAL if hasl else _SOLDERED)

    @staticmethod
    def _relief(points: _Points) -> tuple[Image, Image]:
        """Return how much lighter and how much darker (TILE, TILE) the edges of copper are that the mask covers."""
        slope = np.asarray(cv2.GaussianBlur(points.mean(_COVERED_COPPER), (7, 7), 1.6), dtype=np.uint8)
        here, before = slope[2:, 2:], slope[:-2, :-2]
        lighter, darker = np.zeros_like(slope), np.zeros_like(slope)
        lighter[2:, 2:] = _looked_up(np.asarray(cv2.subtract(here, before), dtype=np.uint8), _LIGHTER)
        darker[2:, 2:] = _looked_up(np.asarray(cv2.subtract(before, here), dtype=np.uint8), _DARKER)
        return lighter, darker

    def _classes(self, left: int, top: int, texels: int = TILE, bits: int = _ALL_BITS) -> Image:
        """Return the classes of a square's points, with those bits that are asked for."""
        size = texels * _FINE
        classes = np.zeros((size, size), dtype=np.uint8)
        for layer in self._layers:
            chosen = layer.touching(left, top, texels) if layer.bit & bits else []
            if chosen:
                layer.paint(classes, chosen, left, top)
        return classes


def _at_texels(classes: Image) -> Image:
    """Return the class of each texel: of one of its points."""
    size = classes.shape[0] // _FINE
    return np.asarray(cv2.resize(classes, (size, size), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def _looked_up(classes: Image, table: Image) -> Image:
    return np.asarray(cv2.LUT(classes, table), dtype=np.uint8)


def _middle(ends: Sequence[int]) -> float:
    """Return the middle of a span of texels, counted in tiles."""
    return sum(ends) / 2.0 / TILE - 0.5
