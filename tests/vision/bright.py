"""Bright grounds of the first artist: white paper, light grey, paper with a printed mark, half paper half board.

Each is drawn over the board of `scene.white_frame` and under its needle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from tests.vision.scene import AXIS_DEG, NOMINAL_TIP, Camera, Canvas, Field, Needle, white_frame

Rng = np.random.Generator
Point = tuple[float, float]
GROUNDS = ("paper", "grey", "print", "half")
PLAIN = Camera()
INK = 32.0
# A mark lies this far from the end at most: 300 um on the board.
PRINT_REACH_PX = 40.0


def bright_ground(kind: str, tip: Point, rng: Rng) -> Callable[[Canvas], None]:
    """Return what paints one of `GROUNDS` under a needle that ends at `tip`."""
    if kind not in GROUNDS:
        raise ValueError(f"the ground must be one of {GROUNDS}, not {kind!r}")

    def paint(canvas: Canvas) -> None:
        level = _paper(canvas, rng.uniform(160.0, 175.0) if kind == "grey" else rng.uniform(190.0, 210.0), rng)
        everywhere = np.full(canvas.x.shape, -10.0, dtype=np.float32)
        canvas.paint(_border(canvas, tip, rng) if kind == "half" else everywhere, level)
        if kind == "print":
            _print(canvas, tip, rng)
        _shadow(canvas, tip, rng)

    return paint


def bright_frame(kind: str, needle: Needle | None, camera: Camera = PLAIN, seed: int = 0) -> np.ndarray:
    """Return a white-lit frame (1200, 1600, 3) of the needle before a bright ground."""
    tip = needle.tip if needle else NOMINAL_TIP
    more = bright_ground(kind, tip, np.random.default_rng([seed, 6]))
    return white_frame(needle, camera, seed, 1.0 if kind == "half" else 0.0, more=more)


def placed(needle: Needle, rng: Rng) -> Needle:
    """Return `needle` within 15 px and 3 degrees of its taught place."""
    tip = NOMINAL_TIP[0] + rng.uniform(-15, 15), NOMINAL_TIP[1] + rng.uniform(-15, 15)
    return replace(needle, tip=tip, angle_deg=AXIS_DEG + rng.uniform(-3, 3))


def _paper(canvas: Canvas, level: float, rng: Rng) -> Field:
    grain = rng.normal(0.0, 1.0, (canvas.height // 6 + 1, canvas.width // 6 + 1)).astype(np.float32)
    return np.asarray(level + 2.5 * cv2.resize(grain, canvas.x.shape[::-1], interpolation=cv2.INTER_CUBIC))


def _border(canvas: Canvas, tip: Point, rng: Rng) -> Field:
    """Return the distance from the paper's straight border, which crosses the needle."""
    axis = np.radians(AXIS_DEG)
    up, turn = rng.uniform(0.0, 300.0), AXIS_DEG + rng.choice([-1.0, 1.0]) * rng.uniform(0.0, 160.0)
    at = tip[0] - up * np.cos(axis), tip[1] - up * np.sin(axis)
    return canvas.along(at, turn)[1]


def _print(canvas: Canvas, tip: Point, rng: Rng) -> None:
    x, y = (at + rng.uniform(-1, 1) * PRINT_REACH_PX for at in tip)
    turn, width = rng.uniform(0.0, 90.0), rng.uniform(4.0, 7.0)
    for angle in (turn, turn + rng.uniform(78.0, 102.0)):
        canvas.paint(canvas.bar((x, y), angle, 140.0, width), INK)
    ring = canvas.ellipse(x, y, 34.0, 0.87, AXIS_DEG)
    canvas.paint(np.abs(ring) - width / 2.0, INK)


def _shadow(canvas: Canvas, tip: Point, rng: Rng) -> None:
    """Darken what lies on one side of a soft border that runs beside the needle."""
    u, v = canvas.along(tip, AXIS_DEG + rng.uniform(-20.0, 20.0))
    side, wide = rng.choice([-1.0, 1.0]), rng.uniform(60.0, 160.0)
    band = np.clip((wide / 2.0 - np.abs(v - side * wide / 2.0)) / 12.0 + 0.5, 0.0, 1.0) * np.clip(-u / 12.0, 0.0, 1.0)
    canvas.level *= 1.0 - rng.uniform(0.08, 0.25) * band
