"""Domed metal is worked out where it is, and looks as if all of the tile had been."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from sim_hw.scene.blemish import DOME_REACH_UM, Plane, lay_tin
from sim_hw.scene.texture import TILE, periodic_noise

BORDER = 40
SIZE = TILE + 2 * BORDER
TEXEL_UM = 6.0


def plainly(planes: list[Plane], metal: Plane, noise: tuple[npt.NDArray[np.float32], ...]) -> list[Plane]:
    """Lay tin by the formula, on every texel of the tile."""
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    depth = cv2.distanceTransform(metal, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    depth = np.sqrt(np.rint(depth * depth)) * np.float32(TEXEL_UM)
    level = cv2.GaussianBlur(np.minimum(depth, DOME_REACH_UM), (0, 0), 2.5)
    slope_x = cv2.Sobel(level, cv2.CV_32F, 1, 0, ksize=3, scale=1.0 / 8.0)[inner]
    slope_y = cv2.Sobel(level, cv2.CV_32F, 0, 1, ksize=3, scale=1.0 / 8.0)[inner]
    steep = 0.5 * (1.0 - level[inner] / DOME_REACH_UM) / TEXEL_UM
    across, down = slope_x * steep + 0.07 * noise[0], slope_y * steep + 0.07 * noise[1]
    gains = []
    for towards_x, towards_y in ((0.10, -0.07), (-0.09, -0.10)):
        away = (across - towards_x) ** 2 + (down - towards_y) ** 2
        gain = 0.5 + 0.85 * np.exp(-away / (2.0 * 0.13**2))
        gains.append(np.where(metal[inner] > 0, gain, 1.0).astype(np.float32))
    each = [gains[0]] * 3 + [gains[1]]
    return [
        np.asarray(cv2.multiply(plane, gain, dtype=cv2.CV_8U), dtype=np.uint8)
        for plane, gain in zip(planes, each, strict=True)
    ]


def pads(seed: int, count: int, largest: int) -> Plane:
    """Return metal of discs and bars, some of which reach over the edges of what is seen."""
    rng = np.random.default_rng(seed)
    metal = np.zeros((SIZE, SIZE), dtype=np.uint8)
    for _ in range(count):
        x, y, width, height = (int(drawn) for drawn in (*rng.integers(-50, SIZE + 50, 2), *rng.integers(1, largest, 2)))
        if rng.random() < 0.5:
            cv2.circle(metal, (x, y), width, 255, -1)
        else:
            cv2.rectangle(metal, (x, y), (x + width, y + height), 255, -1)
    return metal


METAL = {
    "none": np.zeros((SIZE, SIZE), dtype=np.uint8),
    "all": np.full((SIZE, SIZE), 255, dtype=np.uint8),
    "one texel": np.pad(np.full((1, 1), 255, dtype=np.uint8), ((500, SIZE - 501), (77, SIZE - 78))),
    "a stripe": np.pad(np.full((SIZE, 9), 255, dtype=np.uint8), ((0, 0), (640, SIZE - 649))),
    "few pads": pads(1, 12, 60),
    "many pads": pads(2, 150, 30),
    "large ones": pads(3, 6, 400),
    "wild": pads(4, 40, 120) & np.random.default_rng(4).choice(np.array([0, 255], dtype=np.uint8), (SIZE, SIZE)),
}


@pytest.mark.parametrize("which", METAL)
def test_tin_laid_where_metal_is_looks_as_by_the_formula(which: str) -> None:
    rng = np.random.default_rng(9)
    noise = (periodic_noise(rng, 14.0), periodic_noise(rng, 14.0))
    planes = [np.ascontiguousarray(rng.integers(0, 256, (TILE, TILE), dtype=np.uint8)) for _ in range(4)]
    expected = plainly(planes, METAL[which], noise)
    lay_tin(planes, METAL[which], noise, TEXEL_UM, BORDER)
    for plane, other in zip(planes, expected, strict=True):
        assert np.array_equal(plane, other)
