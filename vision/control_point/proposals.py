"""Proposals of crossings: dark line pixels vote for lines, pairs of lines are judged by arms.

Done at half size, where an arm is two to six pixels wide. What it proposes is rough (a pixel or two, a degree or two);
`cross` measures and decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Gray, Plane

Floats = NDArray[np.float64]
ARM_ANGLE_DEG = (72.0, 108.0)
"""Angle between two lines through the centre, degrees, as the oblique view shows it: 72..95 and its supplement."""
ANGLE_SLACK_DEG = 3.0
"""What voting for directions in bins of 3 degrees may add to it."""
WIDEST_ARM_PX = 14.0
LEAST_DEPTH = 12.0
"""Darker than the paper by at least this many levels."""
DIRECTIONS = 60
LINES, CROSSINGS = 10, 5
INNER_SHARE = 0.2
"""Arms are looked for from this share of their length outwards."""
ALONG_RAD = 0.3
"""A line pixel runs along an arm when their directions differ by less, rad."""
LEAST_COVER = 0.35
"""On each line an arm shows on this share of its length."""
APART_PX = 4.0


@dataclass(frozen=True, slots=True)
class Crossing:
    """Hold a place (x_px, y_px) of the image and the directions (rad, 0..pi) of two lines that meet there."""

    x_px: float
    y_px: float
    angles_rad: tuple[float, float]

    def moved(self, x_px: float, y_px: float) -> Crossing:
        """Return the same crossing in an image whose pixel (0, 0) lies at (-x_px, -y_px)."""
        return Crossing(self.x_px + x_px, self.y_px + y_px, self.angles_rad)


@dataclass(frozen=True, slots=True)
class _Ridges:
    """Half-size maps: which pixels lie on a thin dark line (H, W) bool, and its direction (rad, 0..pi)."""

    on_line: NDArray[np.bool_]
    direction: Plane


def propose_crossings(plane: Gray, reach_px: float, arm_px: float) -> list[Crossing]:
    """Return up to five crossings within `reach_px` of the middle of a square image (H, H) uint8, best first."""
    ridges = _ridges(plane)
    lines = _lines(ridges)
    pairs = _pairs(lines, reach_px / 2.0 + 2.0)
    if pairs.shape[0] == 0:
        return []
    half = (ridges.on_line.shape[0] - 1) / 2.0
    cover = _cover(ridges, pairs, half, arm_px / 2.0)
    # Opposite arms lie on one line; each line needs one arm, and every further arm speaks for the crossing.
    weakest = cover.max(axis=2).min(axis=1)
    score = weakest + 0.5 * cover.sum(axis=(1, 2))
    found: list[Crossing] = []
    for index in np.argsort(-score):
        x, y, first, second = (float(number) for number in pairs[index])
        # A pixel of the half-size image is the mean of two: its centre lies between theirs.
        place = 2.0 * (x + half) + 0.5, 2.0 * (y + half) + 0.5
        if weakest[index] < LEAST_COVER or any(
            np.hypot(place[0] - other.x_px, place[1] - other.y_px) < APART_PX for other in found
        ):
            continue
        found.append(Crossing(*place, (first, second)))
        if len(found) == CROSSINGS:
            break
    return found


def _ridges(plane: Gray) -> _Ridges:
    small = cv2.resize(plane, (plane.shape[1] // 2, plane.shape[0] // 2), interpolation=cv2.INTER_AREA)
    raw = cv2.GaussianBlur(small, (3, 3), 0.7).astype(np.float32)
    size = int(WIDEST_ARM_PX / 2.0) + 2
    closed = cv2.morphologyEx(raw, cv2.MORPH_CLOSE, np.ones((size, size), np.uint8))
    depth = cv2.GaussianBlur(closed - raw, (0, 0), 0.8)
    smooth = cv2.GaussianBlur(depth, (0, 0), 0.8)
    slope_x, slope_y = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    # Structure tensor: the direction in which the slope is least is the line's.
    xx, yy, xy = (cv2.GaussianBlur(part, (0, 0), 1.7) for part in (slope_x**2, slope_y**2, slope_x * slope_y))
    across = 0.5 * cv2.phase(xx - yy, 2.0 * xy)
    direction = np.asarray((across + np.float32(np.pi / 2.0)) % np.float32(np.pi), dtype=np.float32)
    # Arms fill one pixel in a hundred or more.
    strong = float(np.partition(depth.ravel(), rank := int(0.99 * (depth.size - 1)))[rank])
    on_line = depth > max(LEAST_DEPTH, 0.4 * strong)
    # What touches the border has no surroundings to be darker than.
    on_line[:2], on_line[-2:], on_line[:, :2], on_line[:, -2:] = False, False, False, False
    return _Ridges(np.asarray(on_line, dtype=np.bool_), direction)


def _lines(ridges: _Ridges) -> Floats:
    """Return the best lines (N, 2): direction (rad) and offset from the middle (half-size px)."""
    rows, columns = np.nonzero(ridges.on_line)
    half = (ridges.on_line.shape[0] - 1) / 2.0
    middle = int(np.ceil(np.hypot(half, half))) + 1
    span = 2 * middle + 1
    angle = np.rint(ridges.direction[rows, columns] * (DIRECTIONS / np.pi)).astype(np.intp)
    votes = np.zeros(DIRECTIONS * span)
    for turn in (-1, 0, 1):
        index = (angle + turn) % DIRECTIONS
        theta = index * (np.pi / DIRECTIONS)
        offset = (rows - half) * np.cos(theta) - (columns - half) * np.sin(theta)
        votes += np.bincount(index * span + np.rint(offset).astype(np.intp) + middle, minlength=votes.size)
    left = cv2.blur(votes.reshape(DIRECTIONS, span), (3, 1))
    found = []
    for _ in range(LINES):
        row, column = divmod(int(np.argmax(left)), span)
        if left[row, column] <= 0.0:
            break
        found.append((row * np.pi / DIRECTIONS, float(column - middle)))
        for turn in range(-4, 5):
            # Past half a turn a line comes back with its offset's sign changed.
            around = (row + turn) // DIRECTIONS % 2 == 1
            at = span - 1 - column if around else column
            left[(row + turn) % DIRECTIONS, max(at - 4, 0) : at + 5] = 0.0
    return np.array(found).reshape(-1, 2)


def _pairs(lines: Floats, reach: float) -> Floats:
    """Return where lines cross like arms within `reach` of the middle, and their directions: (N, 4)."""
    first, second = np.triu_indices(lines.shape[0], 1)
    a, b = lines[first, 0], lines[second, 0]
    sine = np.sin(b - a)
    least = np.sin(np.radians(ARM_ANGLE_DEG[0] - ANGLE_SLACK_DEG))
    kept = np.abs(sine) > least
    a, b, sine = a[kept], b[kept], sine[kept]
    p, q = lines[first[kept], 1], lines[second[kept], 1]
    # A line is y cos - x sin = offset.
    x = (p * np.cos(b) - q * np.cos(a)) / sine
    y = (p * np.sin(b) - q * np.sin(a)) / sine
    near = np.hypot(x, y) <= reach
    return np.asarray(np.stack([x, y, a, b], axis=1)[near], dtype=np.float64)


def _cover(ridges: _Ridges, pairs: Floats, half: float, arm: float) -> Floats:
    """Return on which share of its length each arm shows: (N, 2 lines, 2 ways)."""
    along = np.arange(INNER_SHARE * arm, 0.9 * arm, 1.0)
    along = np.stack([along, -along])[None, None, :, :, None]
    across = np.array([-1.0, 0.0, 1.0])
    theta = pairs[:, 2:, None, None, None]
    c, s = np.cos(theta), np.sin(theta)
    x = np.rint(pairs[:, :1, None, None, None] + half + along * c - across * s).astype(np.intp)
    y = np.rint(pairs[:, 1:2, None, None, None] + half + along * s + across * c).astype(np.intp)
    last = ridges.on_line.shape[0] - 1
    x, y = np.clip(x, 0, last), np.clip(y, 0, last)
    turned = np.abs((ridges.direction[y, x] - theta + np.pi / 2.0) % np.pi - np.pi / 2.0)
    shows = ridges.on_line[y, x] & (turned < ALONG_RAD)
    return np.asarray(shows.any(axis=4).mean(axis=3), dtype=np.float64)
