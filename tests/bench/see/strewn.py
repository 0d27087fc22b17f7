"""What lies on a board and is no part of it, painted on its texture under the red lamp: flux, labels, dirt, tin."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Frame = NDArray[np.uint8]
Rng = np.random.Generator


def dome(red: Frame, rng: Rng) -> None:
    """Give all bright metal the relief of molten tin."""
    coarse = rng.normal(0.0, 1.0, (red.shape[0] // 24 + 2, red.shape[1] // 24 + 2)).astype(np.float32)
    relief = cv2.resize(coarse, (red.shape[1], red.shape[0]), interpolation=cv2.INTER_CUBIC)
    metal = red > 130
    red[metal] = np.clip(red[metal] * np.clip(1.0 + 0.3 * relief[metal], 0.35, 1.6), 0, 255).astype(np.uint8)


def flux(red: Frame, blotches: int, rng: Rng) -> None:
    """Lay translucent blotches, a millimetre wide."""
    for _ in range(blotches):
        x, y = round(rng.uniform(0, red.shape[1])), round(rng.uniform(0, red.shape[0]))
        axes = tuple(round(v) for v in rng.uniform(60.0, 260.0, 2))
        turn_deg, strength, grey = rng.uniform(0, 180), rng.uniform(0.05, 0.2), rng.uniform(40.0, 110.0)
        # Only the blotch's own box: the whole texture would take ten times as long.
        reach = max(axes) + 40
        left, top = max(0, x - reach), max(0, y - reach)
        part = red[top : y + reach, left : x + reach]
        cover = np.zeros(part.shape, dtype=np.uint8)
        cv2.ellipse(cover, (x - left, y - top), axes, turn_deg, 0, 360, 255, -1)
        share = cv2.GaussianBlur(cover, (0, 0), 8.0).astype(np.float32) * np.float32(strength / 255.0)
        part[...] = np.clip(part + (grey - part) * share, 0.0, 255.0).astype(np.uint8)


def label(red: Frame, rng: Rng) -> None:
    """Stick a printed label on, 3 to 8 mm wide."""
    size = rng.uniform(500.0, 1300.0), rng.uniform(300.0, 800.0)
    middle = rng.uniform(0, red.shape[1]), rng.uniform(0, red.shape[0])
    corners = cv2.boxPoints((middle, size, float(rng.choice([0.0, 90.0]) + rng.uniform(-4.0, 4.0))))
    cv2.fillPoly(red, [corners.astype(np.int32)], 205)
    for line in np.linspace(0.2, 0.8, 4):
        start = corners[0] + line * (corners[1] - corners[0])
        end = corners[3] + line * (corners[2] - corners[3])
        for share in np.arange(0.1, 0.88, 0.06):
            at = start + share * (end - start)
            cv2.circle(red, (round(float(at[0])), round(float(at[1]))), int(rng.integers(6, 16)), 40, -1)


def dirt(red: Frame, spots: int, rng: Rng) -> None:
    """Lay spots of all sizes and levels."""
    for _ in range(spots):
        x, y = rng.uniform(0, red.shape[1]), rng.uniform(0, red.shape[0])
        size = float(np.exp(rng.uniform(np.log(8.0), np.log(90.0))))
        axes = (max(1, round(size)), max(1, round(size * rng.uniform(0.4, 1.0))))
        grey = int(rng.integers(5, 230))
        cv2.ellipse(red, (round(x), round(y)), axes, rng.uniform(0, 180), 0, 360, grey, -1)
