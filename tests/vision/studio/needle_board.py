"""The board behind the needle: mask, traces, pads, lettering in grey levels; cheap, since nobody measures it."""

import cv2
import numpy as np

from tests.vision.studio.lens import Level
from tests.vision.studio.needle_body import SHAPE

SHIFT = 4
"""Binary digits of the sub-pixel fraction with which cv2 draws."""


def plain(rng: np.random.Generator) -> Level:
    """Return the dark cloth that the operator lays under the needle to teach it."""
    return np.float32(24.0) + clouds(rng, 1.5, 60) + clouds(rng, 1.0, 8)


def board(rng: np.random.Generator, tip_px: tuple[float, float], angle_deg: float, *, cluttered: bool) -> Level:
    """Return a board; a cluttered one has pads right behind the taper and bars along the needle's edges."""
    mask = float(rng.uniform(42.0, 68.0))
    canvas = np.full(SHAPE, mask, np.float32)
    _traces(canvas, rng, mask + float(rng.uniform(9.0, 20.0)))
    for _ in range(int(rng.integers(30, 60))):
        _pad(canvas, rng, (float(rng.uniform(0, 1600)), float(rng.uniform(0, 1200))), mask)
    for _ in range(int(rng.integers(8, 16))):
        _word(canvas, rng, (float(rng.uniform(0, 1600)), float(rng.uniform(0, 1200))), float(rng.choice([0.0, 90.0])))
    if cluttered:
        _clutter(canvas, rng, np.asarray(tip_px), angle_deg, mask)
    # The board lies a little behind the plane of focus, and its mask is glossy and uneven.
    canvas = cv2.GaussianBlur(canvas, (0, 0), float(rng.uniform(0.5, 1.1)))
    rough = 2.0 if cluttered else 1.0
    return canvas + clouds(rng, 2.5 * rough, 40) + clouds(rng, 1.6 * rough, 4)


def shadow(level: Level, tip_px: tuple[float, float], angle_deg: float, rng: np.random.Generator) -> None:
    """Darken in place the board where the needle keeps the lamp's light away."""
    turn = np.radians(angle_deg - float(rng.uniform(8.0, 22.0)))
    start = np.asarray(tip_px) + rng.uniform(2.0, 14.0, 2)
    back = -np.array([np.cos(turn), np.sin(turn)])
    side = np.array([-back[1], back[0]])
    corners = [start, start + 130 * back + 22 * side, start + 900 * back + 30 * side]
    corners += [start + 900 * back - 30 * side, start + 130 * back - 22 * side]
    small = np.zeros((SHAPE[0] // 4, SHAPE[1] // 4), np.float32)
    cv2.fillConvexPoly(small, np.rint(np.asarray(corners) * (1 << SHIFT) / 4).astype(np.int32), 1.0, cv2.LINE_8, SHIFT)
    soft = cv2.resize(cv2.GaussianBlur(small, (0, 0), 2.5), (SHAPE[1], SHAPE[0]))
    level *= np.float32(1.0) - np.float32(rng.uniform(0.15, 0.4)) * soft


def glints(level: Level, rng: np.random.Generator, tip_px: tuple[float, float], angle_deg: float) -> None:
    """Add in place a few small bright spots on the needle and beside it."""
    angle = np.radians(angle_deg)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    for _ in range(int(rng.integers(4, 9))):
        place = np.asarray(tip_px) - float(rng.uniform(-30, 300)) * along + float(rng.normal(0, 22)) * across
        _spot(level, place, float(rng.uniform(0.9, 3.2)), float(rng.uniform(60, 260)))


def _spot(level: Level, place: np.ndarray, size: float, height: float) -> None:
    reach = int(4 * size) + 1
    x0, y0 = (int(v) - reach for v in place)
    x1, y1 = x0 + 2 * reach + 1, y0 + 2 * reach + 1
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, SHAPE[1]), min(y1, SHAPE[0])
    if x0 >= x1 or y0 >= y1:
        return
    r2 = (np.arange(y0, y1)[:, None] - place[1]) ** 2 + (np.arange(x0, x1)[None, :] - place[0]) ** 2
    level[y0:y1, x0:x1] += (height * np.exp(-r2 / (2 * size**2))).astype(np.float32)


def clouds(rng: np.random.Generator, rms: float, scale: int) -> Level:
    """Return an uneven brightness (H, W) with mean 0 whose blots are about ``scale`` px large."""
    small = rng.standard_normal((SHAPE[0] // scale + 2, SHAPE[1] // scale + 2), dtype=np.float32)
    cloud = cv2.resize(small, (SHAPE[1], SHAPE[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(cloud * np.float32(1.5 * rms), np.float32)


def fixed(points: np.ndarray) -> np.ndarray:
    """Return points in the binary fractions of a pixel that cv2 draws with."""
    return np.rint(np.asarray(points) * (1 << SHIFT)).astype(np.int32)


def _traces(canvas: Level, rng: np.random.Generator, level: float) -> None:
    for _ in range(int(rng.integers(14, 26))):
        points = [rng.uniform((0, 0), (1600, 1200))]
        heading = int(rng.integers(0, 8))
        for _ in range(int(rng.integers(2, 6))):
            angle = heading * np.pi / 4
            points.append(points[-1] + float(rng.uniform(60, 500)) * np.array([np.cos(angle), np.sin(angle)]))
            heading += int(rng.choice([-1, 1]))
        width = int(rng.integers(6, 22))
        cv2.polylines(canvas, [fixed(np.asarray(points))], isClosed=False, color=level, thickness=width, shift=SHIFT)


def _pad(canvas: Level, rng: np.random.Generator, place: tuple[float, float], mask: float) -> None:
    level, size = (
        float(rng.uniform(140, 215)),
        float(rng.choice([7.0, 9.0, 17.0, 26.0, 40.0])) * float(rng.uniform(0.8, 1.2)),
    )
    centre = tuple(int(v) for v in fixed(np.asarray(place)))
    if rng.random() < 0.6:
        radius = round(size * (1 << SHIFT))
        cv2.circle(canvas, centre, radius + 48, mask * 0.75, -1, cv2.LINE_8, SHIFT)
        cv2.circle(canvas, centre, radius, level, -1, cv2.LINE_8, SHIFT)
        if rng.random() < 0.5:
            cv2.circle(canvas, centre, round(radius * 0.45), 25.0, -1, cv2.LINE_8, SHIFT)
        return
    half = np.array([size, size * float(rng.uniform(0.5, 2.0))])
    low, high = (tuple(int(v) for v in fixed(np.asarray(place) + sign * half)) for sign in (-1, 1))
    cv2.rectangle(canvas, low, high, level, -1, cv2.LINE_8, SHIFT)


def _word(canvas: Level, rng: np.random.Generator, place: tuple[float, float], angle_deg: float) -> None:
    angle = np.radians(angle_deg)
    along, down = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    height, pen, level = float(rng.uniform(18, 44)), int(rng.integers(3, 6)), float(rng.uniform(150, 205))
    for letter in range(int(rng.integers(2, 6))):
        corner = np.asarray(place) + letter * 0.85 * height * along
        box = [
            corner,
            corner + 0.6 * height * along,
            corner + 0.6 * height * along + height * down,
            corner + height * down,
        ]
        for stroke in range(4):
            if rng.random() < 0.65:
                ends = fixed(np.array([box[stroke], box[(stroke + int(rng.integers(1, 3))) % 4]]))
                cv2.polylines(canvas, [ends], isClosed=False, color=level, thickness=pen, shift=SHIFT)


def _clutter(canvas: Level, rng: np.random.Generator, tip: np.ndarray, angle_deg: float, mask: float) -> None:
    angle = np.radians(angle_deg)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    for _ in range(int(rng.integers(2, 5))):
        place = tip - float(rng.uniform(-15, 130)) * along + float(rng.normal(0, 18)) * across
        _pad(canvas, rng, (float(place[0]), float(place[1])), mask)
    for _ in range(int(rng.integers(2, 4))):
        off = float(rng.choice([-1, 1])) * float(rng.uniform(26, 75))
        start = tip - float(rng.uniform(20, 260)) * along + off * across
        ends = fixed(np.array([start, start - float(rng.uniform(50, 240)) * along]))
        level, pen = float(rng.uniform(140, 200)), int(rng.integers(4, 11))
        cv2.polylines(canvas, [ends], isClosed=False, color=level, thickness=pen, shift=SHIFT)
