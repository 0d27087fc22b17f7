"""Parts on a board: boxes laid over it by a seed, and pads that carry solder; bare boards have none of their own."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.bench.see.boards import Side
from vision.registration import Polygon, SideLayers, Target

PER_CM2 = 2.2
SMALLEST_UM, LARGEST_UM = 800.0, 5000.0
TOE_UM = 350.0
"""A pad so near to a part is soldered to it."""


def bodies(side: Side, seed: int) -> tuple[NDArray[np.float64], ...]:
    """Return boxes (4, 2), um."""
    rng = np.random.default_rng([seed, 99])
    width, height = side.size_um
    count = round(PER_CM2 * width * height / 1e8)
    boxes = []
    for _ in range(count):
        x, y = rng.uniform(0, width), rng.uniform(0, height)
        a, b = np.exp(rng.uniform(np.log(SMALLEST_UM), np.log(LARGEST_UM), 2)) / 2
        boxes.append(np.array([[x - a, y - b], [x + a, y - b], [x + a, y + b], [x - a, y + b]]))
    return tuple(boxes)


def touched(target: Target, boxes: tuple[NDArray[np.float64], ...], margin_um: float) -> bool:
    """Say whether a pad is under a part or as near to it as `margin_um`."""
    low, high = target.outline_um.min(axis=0) - margin_um, target.outline_um.max(axis=0) + margin_um
    return any(bool(np.all(box.min(axis=0) < high) and np.all(box.max(axis=0) > low)) for box in boxes)


def with_parts(side: Side, boxes: tuple[NDArray[np.float64], ...]) -> SideLayers:
    """Return what CAD says of the assembled board: bodies, and the pads that are soldered."""
    soldered = tuple(Polygon(_grown(t.outline_um)) for t in side.targets if touched(t, boxes, TOE_UM))
    return replace(side.layers, bodies=tuple(Polygon(box) for box in boxes), soldered=soldered)


def solder(side: Side, boxes: tuple[NDArray[np.float64], ...]) -> tuple[NDArray[np.float64], ...]:
    """Return the outlines that the artist covers with solder."""
    return tuple(t.outline_um for t in side.targets if touched(t, boxes, TOE_UM))


def _grown(outline: NDArray[np.float64]) -> NDArray[np.float64]:
    hull = cv2.convexHull(outline.astype(np.float32))[:, 0, :].astype(np.float64)
    middle = hull.mean(axis=0)
    away = hull - middle
    return np.asarray(middle + away * (1.0 + 50.0 / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1.0)))
