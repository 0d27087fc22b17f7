"""Print of the control-point card: a ring and four thin arms crosswise (thesis figure 6.5c), toner on white paper.

Drawn once, when first looked at; as of the board, blue, green and red under the white lamp and red under the red one.
"""

import numpy as np
import numpy.typing as npt

from sim_hw.plant.card import CARD_SIDE_UM
from sim_hw.scene.texture import BENCH_RED, BENCH_WHITE, TILE, Image, periodic_noise

ARM_UM = 900.0
"""From the centre to an arm's end, and width of arms and ring."""
LINE_UM = 70.0
RING_RADIUS_UM = 420.0
CARD_TEXEL_UM = 5.5

_MARGIN = 10
"""Texels of bench round the paper: its edge is smooth too."""
_PAPER = (203, 205, 204, 186)
_TONER = (36, 35, 36, 27)
_STRIP = (40, 38, 37, 26)
_STRIP_UM = (np.float32(-1600.0), np.float32(450.0))
"""What covers the card: a strip across it, from and to along u, that leaves the end of one arm to be seen."""
_RAGGED_UM = 3.0

Field = npt.NDArray[np.float32]


class CardPrint:
    """Hold the images (N, N, 4) uint8 of a card, as printed and as covered by a strip of something dark."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._images: dict[bool, Image] = {}
        self.size = round(CARD_SIDE_UM / CARD_TEXEL_UM) + 2 * _MARGIN

    def from_mm(self) -> npt.NDArray[np.float64]:
        """Return the (3, 3) map from card mm (u right, v up, from the centre) to texels, centres at integers."""
        per_mm, middle = 1e3 / CARD_TEXEL_UM, (self.size - 1) / 2.0
        return np.array([[per_mm, 0.0, middle], [0.0, -per_mm, middle], [0.0, 0.0, 1.0]])

    def image(self, *, covered: bool) -> Image:
        """Return the card, or the card under the strip."""
        if covered not in self._images:
            self._images[covered] = self._drawn(covered=covered)
        return self._images[covered]

    def _drawn(self, *, covered: bool) -> Image:
        rng = np.random.default_rng((self._seed, 11))
        fibres, grain, ragged = (self._tiled(periodic_noise(rng, scale)) for scale in (30.0, 2.0, 4.0))
        along = ((np.arange(self.size) - (self.size - 1) / 2.0) * CARD_TEXEL_UM).astype(np.float32)
        u, v = along[None, :], -along[:, None]
        paper = np.float32(1.0) + 0.008 * fibres + 0.012 * grain
        layers: list[tuple[tuple[int, ...], Field]] = [(_TONER, self._toner(u, v, ragged))]
        if covered:
            layers.append((_STRIP, _inside(np.minimum(u - _STRIP_UM[0], _STRIP_UM[1] - u))))
        beyond_um = np.maximum(np.abs(u), np.abs(v)) - np.float32(CARD_SIDE_UM / 2.0)
        layers.append(((*BENCH_WHITE, BENCH_RED), _inside(beyond_um)))
        image: Image = np.empty((self.size, self.size, 4), dtype=np.uint8)
        for k, level in enumerate(_PAPER):
            plane = level * paper
            for colour, share in layers:
                plane += (np.float32(colour[k]) - plane) * share
            image[..., k] = np.clip(np.round(plane), 0.0, 255.0)
        return image

    def _tiled(self, field: Field) -> Field:
        times = -(-self.size // TILE)
        return np.tile(field, (times, times))[: self.size, : self.size]

    @staticmethod
    def _toner(u: Field, v: Field, ragged: Field) -> Field:
        """Return how much of each texel toner covers, 0..1; its rims are a little ragged."""
        half = LINE_UM / 2.0
        reach_u, reach_v = ARM_UM - np.abs(u), ARM_UM - np.abs(v)
        level = np.minimum(half - np.abs(v), reach_u)
        upright = np.minimum(half - np.abs(u), reach_v)
        ring = half - np.abs(np.hypot(u, v) - RING_RADIUS_UM)
        depth_um = np.maximum(np.maximum(level, upright), ring)
        return _inside(depth_um + _RAGGED_UM * ragged)


def _inside(depth_um: Field) -> Field:
    """Return how much of a texel is covered by what reaches `depth_um` beyond its centre; rims are a texel soft."""
    return np.asarray(np.clip(depth_um / (1.5 * CARD_TEXEL_UM) + 0.5, 0.0, 1.0), dtype=np.float32)
