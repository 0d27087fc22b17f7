"""Bright things behind the needle: paper, printed or not, or a sheet of it that ends behind the needle."""

from typing import Final

import cv2
import numpy as np

from tests.vision.studio.lens import Level
from tests.vision.studio.needle_board import SHIFT, board, clouds, fixed
from tests.vision.studio.needle_body import SHAPE

GROUNDS: Final = ("paper", "grey", "print", "half")
REACH_PX: Final = 40.0
"""A printed mark lies this far from the needle's end at most: 300 um."""


def bright(rng: np.random.Generator, kind: str, tip_px: tuple[float, float], angle_deg: float) -> Level:
    """Return one of ``GROUNDS``: a white sheet, a grey one, one with a printed mark, one that covers half a board."""
    low, high = (158.0, 176.0) if kind == "grey" else (188.0, 212.0)
    sheet = np.full(SHAPE, float(rng.uniform(low, high)), np.float32)
    if kind == "print":
        _mark(sheet, rng, np.asarray(tip_px))
        sheet = np.asarray(cv2.GaussianBlur(sheet, (0, 0), float(rng.uniform(0.5, 1.0))), np.float32)
    sheet += clouds(rng, 1.5, 50) + clouds(rng, 1.5, 3)
    if kind != "half":
        return sheet
    under = board(rng, tip_px, angle_deg, cluttered=False)
    cover = cv2.GaussianBlur(_half(rng, np.asarray(tip_px), angle_deg), (0, 0), 0.9)
    return np.asarray(under + cover * (sheet - under), np.float32)


def _half(rng: np.random.Generator, tip: np.ndarray, angle_deg: float) -> Level:
    """Return 1 on one side of a straight border that crosses the needle, 0 on the other."""
    angle = np.radians(angle_deg)
    at = tip - float(rng.uniform(0.0, 300.0)) * np.array([np.cos(angle), np.sin(angle)])
    turn = angle + float(rng.uniform(-2.8, 2.8))
    y, x = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]]
    beyond = (y - at[1]) * np.cos(turn) - (x - at[0]) * np.sin(turn)
    return np.asarray(np.clip(0.5 - beyond, 0.0, 1.0), np.float32)


def _mark(sheet: Level, rng: np.random.Generator, tip: np.ndarray) -> None:
    """Print four arms and a ring near the end."""
    middle = tip + rng.uniform(-REACH_PX, REACH_PX, 2)
    pen, ink, turn = int(rng.integers(4, 8)), float(rng.uniform(22.0, 45.0)), float(rng.uniform(0.0, np.pi / 2))
    for arm in turn + np.pi / 2 * np.arange(4) + rng.normal(0.0, 0.1, 4):
        ends = fixed(np.array([middle, middle + 72.0 * np.array([np.cos(arm), np.sin(arm)])]))
        cv2.polylines(sheet, [ends], isClosed=False, color=ink, thickness=pen, shift=SHIFT)
    round_about = np.linspace(0.0, 2 * np.pi, 90)
    ring = middle + np.column_stack([36.0 * np.cos(round_about), 31.0 * np.sin(round_about)])
    cv2.polylines(sheet, [fixed(ring)], isClosed=True, color=ink, thickness=pen, shift=SHIFT)
