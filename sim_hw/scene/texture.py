"""Texture of a board from above, drawn from its CAD layers, one image for each light.

Drawn in tiles when first looked at: a class per point (copper? open mask? silk? hole? board?) at twice the
resolution, a reflectance per class, averaged down so that rims are smooth; then relief, tarnish and weave.
Rows run against y: texel (0, 0) is the upper left of the board as it lies in the robot, margin included.
"""

from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.board.board import Board
from sim_hw.board.shapes import Shape

Image = npt.NDArray[np.uint8]

TEXEL_UM = 6.0
MARGIN_MM = 1.0
TILE = 1024
_FINE = 2
"""Class points per texel and direction."""
_SHIFT = 4
"""Fractional bits of polygon corners."""
_COPPER, _OPEN, _SILK, _HOLE, _BOARD = 1, 2, 4, 8, 16
BENCH_WHITE = (20, 21, 22)
BENCH_RED = 12


def _palette() -> npt.NDArray[np.uint8]:
    """Return (256, 4): blue, green and red under the white lamp, red under the red lamp, by class bits."""
    table = np.zeros((256, 4), dtype=np.uint8)
    for bits in range(32):
        table[bits] = _colour(bits)
    return table


def _colour(bits: int) -> tuple[int, int, int, int]:
    if not bits & _BOARD:
        return (*BENCH_WHITE, BENCH_RED)
    if bits & _OPEN:
        if bits & _HOLE:
            return (11, 13, 14, 9)
        return (138, 184, 206, 192) if bits & _COPPER else (62, 84, 88, 52)
    if bits & _SILK:
        return (196, 202, 198, 116)
    if bits & _HOLE:
        return (33, 47, 23, 30)
    return (46, 63, 32, 40) if bits & _COPPER else (36, 50, 25, 29)


_BENCH, _COVERED, _BARE = 0, 1, 2


def _kinds() -> npt.NDArray[np.uint8]:
    """Return (256,): what surface a class is, for its fine structure."""
    bits = np.arange(256)
    bare = (bits & _OPEN != 0) & (bits & _COPPER != 0)
    return np.where(bits & _BOARD == 0, _BENCH, np.where(bare, _BARE, _COVERED)).astype(np.uint8)


_KIND = _kinds()
_COVERED_COPPER = np.where((np.arange(256) & (_COPPER | _OPEN)) == _COPPER, 255, 0).astype(np.uint8)


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

    def __init__(self, board: Board, seed: int) -> None:
        width_mm, height_mm = board.size_mm
        per_mm = 1e3 / TEXEL_UM
        self.width = int((width_mm + 2 * MARGIN_MM) * per_mm)
        self.height = int((height_mm + 2 * MARGIN_MM) * per_mm)
        # Untouched pages of zeros cost no memory: only the tiles looked at do.
        self.image: Image = np.zeros((self.height, self.width, 4), dtype=np.uint8)
        self._done: set[tuple[int, int]] = set()
        self._layers = tuple(
            (bit, [self._placed(shape, board) for shape in shapes])
            for bit, shapes in (
                (_COPPER, board.layers.copper),
                (_OPEN, board.layers.mask),
                (_SILK, board.layers.silk),
                (_HOLE, board.layers.holes),
                (_BOARD, board.layers.outline),
            )
        )
        self._boxes = [np.array([box for _, _, box in shapes]).reshape(-1, 4) for _, shapes in self._layers]
        self._palette = _palette()
        rng = np.random.default_rng(seed)
        slow, medium, fine = (periodic_noise(rng, scale) for scale in (170.0, 22.0, 2.5))
        self._mask_look = np.clip(128 + 9 * slow + 5 * medium + 4 * fine, 90, 170).astype(np.uint8)
        specks = np.where(medium * fine > 4.2, 18.0, 0.0)
        self._pad_look = np.clip(128 + 5 * slow + 7 * medium + 5 * fine + specks, 80, 180).astype(np.uint8)

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

    def _placed(self, shape: Shape, board: Board) -> tuple[npt.NDArray[np.float32], bool, tuple[float, ...]]:
        """Return outline in class points (fine grid), its polarity and its box in texels."""
        x0, _, x1, y1 = board.outline_mm
        u = shape.outline_mm[:, 0] - x0 if board.side == "top" else x1 - shape.outline_mm[:, 0]
        per_mm = 1e3 / TEXEL_UM
        columns = (u + MARGIN_MM) * per_mm
        rows = (y1 + MARGIN_MM - shape.outline_mm[:, 1]) * per_mm
        box = (float(columns.min()), float(rows.min()), float(columns.max()), float(rows.max()))
        return (np.column_stack((columns, rows)).astype(np.float32), shape.dark, box)

    def ensure(self, x0: int, y0: int, x1: int, y1: int) -> None:
        """Draw the tiles that cover these texels, if they are not drawn yet."""
        for i in range(max(0, y0) // TILE, (min(self.height, y1) - 1) // TILE + 1):
            for j in range(max(0, x0) // TILE, (min(self.width, x1) - 1) // TILE + 1):
                self._draw_once(i, j)

    def draw_one_more(self) -> bool:
        """Draw one tile nobody has looked at yet; return False once there is none left."""
        for i in range((self.height - 1) // TILE + 1):
            for j in range((self.width - 1) // TILE + 1):
                if (i, j) not in self._done:
                    self._draw_once(i, j)
                    return True
        return False

    def _draw_once(self, i: int, j: int) -> None:
        if (i, j) not in self._done:
            self._draw_tile(i, j)
            self._done.add((i, j))

    def _draw_tile(self, i: int, j: int) -> None:
        left, top = j * TILE, i * TILE
        classes = self._classes(left, top)
        planes = [cv2.LUT(classes, self._palette[:, k]) for k in range(4)]
        look = [cv2.resize(plane, (TILE, TILE), interpolation=cv2.INTER_AREA) for plane in planes]
        kind = cv2.LUT(cv2.resize(classes, (TILE, TILE), interpolation=cv2.INTER_NEAREST), _KIND)
        variation = np.where(kind == _BARE, self._pad_look, self._mask_look)
        variation[kind == _BENCH] = 128
        relief = self._relief(classes)
        height, width = min(TILE, self.height - top), min(TILE, self.width - left)
        view = np.s_[top : top + height, left : left + width]
        for k, plane in enumerate(look):
            shaded = cv2.add(plane, relief, dtype=cv2.CV_8U)
            shaded = cv2.multiply(shaded, variation, scale=1.0 / 128.0)
            shaded = cv2.GaussianBlur(shaded, (3, 3), 0.7)[:height, :width]
            self.image[view][..., k] = shaded

    @staticmethod
    def _relief(classes: Image) -> npt.NDArray[np.int16]:
        """Return the light and shade (TILE, TILE) at the edges of copper that the mask covers."""
        covered = cv2.LUT(classes, _COVERED_COPPER)
        small = cv2.GaussianBlur(cv2.resize(covered, (TILE, TILE), interpolation=cv2.INTER_AREA), (7, 7), 1.6)
        slope = small.astype(np.int16)
        relief = np.zeros_like(slope)
        relief[2:, 2:] = (slope[2:, 2:] - slope[:-2, :-2]) >> 4
        return relief

    def _classes(self, left: int, top: int) -> Image:
        size = TILE * _FINE
        classes = np.zeros((size, size), dtype=np.uint8)
        for (bit, shapes), boxes in zip(self._layers, self._boxes, strict=True):
            layer = np.zeros((size, size), dtype=np.uint8)
            for k in self._touching(boxes, left, top):
                outline, dark, _ = shapes[k]
                corners = (outline - (left, top)) * _FINE - 0.5  # centres of class points at integers
                fixed = np.round(corners * (1 << _SHIFT)).astype(np.int32)
                cv2.fillPoly(layer, [fixed], bit if dark else 0, cv2.LINE_8, _SHIFT)
            cv2.bitwise_or(classes, layer, dst=classes)
        return classes

    @staticmethod
    def _touching(boxes: npt.NDArray[np.float64], left: int, top: int) -> Iterator[int]:
        hit = (boxes[:, 0] <= left + TILE) & (boxes[:, 2] >= left) & (boxes[:, 1] <= top + TILE) & (boxes[:, 3] >= top)
        yield from np.flatnonzero(hit).tolist()
