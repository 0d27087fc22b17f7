"""What all pad peers share: the same window as ours, spikes out, the view flattened where it is known, and the choice.

None of this is part of a peer; it is the help a good engineer would give it, so that peers are judged at their best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.bench.vision.scenes import REACH_PX, DiscScene, PadScene, Point

Plane = NDArray[np.uint8]
Floats = NDArray[np.float64]
# The thesis' two classes, with half a pixel to either side for the peer's own error.
CLASSES_PX = ((4.5, 8.5), (13.5, 21.5))
LARGEST_PX = 21.5
MARGIN_PX = 8
SPIKE_LEVELS = 60
# A pad is brighter than what surrounds it by this much, on this share of its contour (a trace or the needle may leave).
LEAST_STEP, LEAST_ROUND = 22.0, 0.6
# A hole's radius: at least so many px, at most this share of its pad's.
LEAST_HOLE_PX, MOST_HOLE = 1.4, 0.75
# A hole is darker than this share of the way from its pad down to the ground.
HOLE_DEPTH = 0.45
DIRECTIONS = np.linspace(0, 2 * np.pi, 72, endpoint=False)


@dataclass(frozen=True)
class Circle:
    """A candidate in the window's pixels; radius_px is semi-major."""

    x: float
    y: float
    radius_px: float


@dataclass(frozen=True)
class Window:
    """The red channel about the tip, spikes replaced; `flat` stretches circles seen obliquely back to circles."""

    plane: Plane
    corner: tuple[int, int]
    around: Point
    flat: Floats

    def flattened(self) -> tuple[Plane, Floats]:
        """Return the plane with ellipses drawn back to circles, and the (2, 3) map from the window into it."""
        size = self.plane.shape[0]
        centre = np.array([(size - 1) / 2, (size - 1) / 2])
        grown = int(np.ceil(size / self.ratio)) | 1
        shift = np.array([(grown - 1) / 2, (grown - 1) / 2]) - self.flat @ centre
        matrix = np.column_stack([self.flat, shift])
        if self.ratio == 1.0:
            return self.plane, matrix
        border = cv2.BORDER_REPLICATE
        return np.asarray(cv2.warpAffine(self.plane, matrix, (grown, grown), None, cv2.INTER_CUBIC, border)), matrix

    @property
    def ratio(self) -> float:
        return float(1.0 / np.linalg.norm(self.flat, 2))


def window_of(scene: PadScene | DiscScene) -> Window:
    half = int(np.ceil(REACH_PX + 21 + MARGIN_PX))
    x, y = round(scene.around_px[0]) - half, round(scene.around_px[1]) - half
    plane = np.ascontiguousarray(scene.red_bgr[y : y + 2 * half + 1, x : x + 2 * half + 1, 2])
    middle = cv2.medianBlur(plane, 3)
    plane = np.where(cv2.absdiff(plane, middle) > SPIKE_LEVELS, middle, plane)
    ratio, minor = scene.flat or (1.0, 0.0)
    towards = np.array([np.cos(minor), np.sin(minor)])
    flat = np.eye(2) + (1.0 / ratio - 1.0) * np.outer(towards, towards)
    return Window(plane, (x, y), (scene.around_px[0] - x, scene.around_px[1] - y), flat)


def unflatten(window: Window, matrix: Floats, circles: Sequence[Circle]) -> list[Circle]:
    """Return circles found in the flattened picture as they lie in the window."""
    back = np.linalg.inv(matrix[:, :2])
    found = []
    for circle in circles:
        x, y = back @ (np.array([circle.x, circle.y]) - matrix[:, 2])
        found.append(Circle(float(x), float(y), circle.radius_px))
    return found


def in_class(radius: float) -> bool:
    return any(least <= radius <= most for least, most in CLASSES_PX)


def ring(window: Window, circle: Circle, share: float, extra: float = 0.0) -> Floats:
    """Return levels (72,) on the circle scaled by `share` (plus `extra` px), bilinear."""
    back = np.linalg.inv(window.flat)
    radius = circle.radius_px * share + extra
    x, y = back @ (radius * np.stack([np.cos(DIRECTIONS), np.sin(DIRECTIONS)]))
    xs, ys = (x + circle.x).astype(np.float32)[None, :], (y + circle.y).astype(np.float32)[None, :]
    return np.asarray(cv2.remap(window.plane, xs, ys, cv2.INTER_LINEAR)[0], dtype=np.float64)


def is_pad(window: Window, circle: Circle) -> bool:
    """Tell whether the circle steps up from the ground all round, and its inside is one bright thing."""
    inside, outside = ring(window, circle, 1.0, -2.0), ring(window, circle, 1.0, 2.0)
    return float(np.mean(inside - outside > LEAST_STEP)) >= LEAST_ROUND


def target_of(window: Window, circle: Circle) -> Point:
    """Return the hole's centre, by its darkness, where a dark hole is seen in the pad; else the pad's."""
    reach = int(np.ceil(circle.radius_px))
    x0, y0 = round(circle.x) - reach, round(circle.y) - reach
    if min(x0, y0) < 0 or max(x0, y0) + 2 * reach + 1 > window.plane.shape[0]:
        return circle.x, circle.y
    part = window.plane[y0 : y0 + 2 * reach + 1, x0 : x0 + 2 * reach + 1].astype(np.float64)
    rows, columns = np.mgrid[0 : part.shape[0], 0 : part.shape[1]]
    dx, dy = columns + x0 - circle.x, rows + y0 - circle.y
    away = np.hypot(*np.tensordot(window.flat, np.stack([dx, dy]), 1))
    pad, ground = np.percentile(part[away < circle.radius_px - 1.5], 75), np.median(ring(window, circle, 1.0, 3.0))
    level = pad - HOLE_DEPTH * (pad - ground)
    dark = ((part < level) & (away < circle.radius_px - 1.8)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(dark, connectivity=4)
    best: Point | None = None
    for label in range(1, count):
        area = float(stats[label, cv2.CC_STAT_AREA])
        size = float(np.sqrt(area / (np.pi * window.ratio)))
        wide, high = stats[label, cv2.CC_STAT_WIDTH], stats[label, cv2.CC_STAT_HEIGHT]
        if not LEAST_HOLE_PX <= size <= MOST_HOLE * circle.radius_px or max(wide, high) > 2 * min(wide, high):
            continue
        near = cv2.dilate((labels == label).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        weight = np.clip(pad - part, 0.0, None) * near
        total = weight.sum()
        at = circle.x + float((weight * dx).sum() / total), circle.y + float((weight * dy).sum() / total)
        if np.hypot(at[0] - circle.x, at[1] - circle.y) < 0.35 * circle.radius_px:
            best = at
    return best or (circle.x, circle.y)


def choose(window: Window, circles: Sequence[Circle]) -> Point | None:
    """Return the target nearest to the tip among the candidates that look like a pad, in the frame's pixels."""
    targets = [target_of(window, circle) for circle in circles if in_class(circle.radius_px) and is_pad(window, circle)]
    ranked = sorted((float(np.hypot(x - window.around[0], y - window.around[1])), x, y) for x, y in targets)
    if not ranked or ranked[0][0] > REACH_PX:
        return None
    return ranked[0][1] + window.corner[0], ranked[0][2] + window.corner[1]


Peer = Callable[[PadScene | DiscScene], Point | None]
