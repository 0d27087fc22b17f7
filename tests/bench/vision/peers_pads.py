"""The pad finders others would use, each with sensible settings and the help of `window`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import cv2
import numpy as np

from tests.bench.vision.scenes import DiscScene, PadScene, Point
from tests.bench.vision.window import (
    CLASSES_PX,
    LARGEST_PX,
    Circle,
    Floats,
    Peer,
    Plane,
    Window,
    choose,
    is_pad,
    unflatten,
    window_of,
)

RAYS = 180


def hough_circles(window: Window) -> list[Circle]:
    """Return cv2.HoughCircles' answers, one run per radius class: small circles need fewer votes."""
    plane, matrix = window.flattened()
    smooth = cv2.GaussianBlur(plane, (0, 0), 1.0)
    # Canny's upper threshold from the picture's own contrast: a dim pad has weaker edges.
    edge = float(np.clip(1.6 * (np.percentile(plane, 99) - np.median(plane)), 40, 250))
    found: list[Circle] = []
    for (least, most), votes in zip(CLASSES_PX, (9, 16), strict=True):
        circles = cv2.HoughCircles(
            smooth, cv2.HOUGH_GRADIENT, 1, 6, param1=edge, param2=votes, minRadius=int(least), maxRadius=int(most) + 1
        )
        if circles is not None:
            found += [Circle(float(x), float(y), float(r)) for x, y, r in np.asarray(circles).reshape(-1, 3)[:12]]
    return unflatten(window, matrix, [Circle(c.x, c.y, float(np.clip(c.radius_px, 4.5, 21.5))) for c in found])


def hough(scene: PadScene | DiscScene) -> Point | None:
    window = window_of(scene)
    return choose(window, hough_circles(window))


def _blob_detector() -> Any:
    settings = cv2.SimpleBlobDetector_Params()
    settings.minThreshold, settings.maxThreshold, settings.thresholdStep = 30, 240, 10
    settings.minDistBetweenBlobs, settings.minRepeatability = 4, 2
    settings.filterByColor = False  # a pad with a hole is dark in its middle
    settings.filterByArea, settings.minArea, settings.maxArea = True, 50.0, float(np.pi * LARGEST_PX**2)
    settings.filterByCircularity, settings.minCircularity = True, 0.65
    settings.filterByConvexity, settings.minConvexity = True, 0.8
    settings.filterByInertia, settings.minInertiaRatio = True, 0.5
    return cv2.SimpleBlobDetector.create(settings)


_BLOBS = _blob_detector()


def simple_blob(scene: PadScene | DiscScene) -> Point | None:
    """Look at the picture as it is and with small and large holes closed: a hole's blob would hide its pad's."""
    window = window_of(scene)
    plane, matrix = window.flattened()
    blobs = list(_BLOBS.detect(plane))
    for size in (13, 25):
        closer = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
        blobs += _BLOBS.detect(cv2.morphologyEx(plane, cv2.MORPH_CLOSE, closer))
    circles = [Circle(*point.pt, point.size / 2) for point in blobs]
    return choose(window, unflatten(window, matrix, circles))


def _threshold(plane: Plane) -> Plane:
    _, mask = cv2.threshold(cv2.GaussianBlur(plane, (3, 3), 0), 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return np.asarray(mask)


def otsu_ellipse(scene: PadScene | DiscScene) -> Point | None:
    """Return the nearest round contour's ellipse."""
    window = window_of(scene)
    contours, _ = cv2.findContours(_threshold(window.plane), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    circles = []
    for contour in contours:
        if len(contour) < 12:
            continue
        (x, y), (one, other), _ = cv2.fitEllipse(contour)
        # A contour of pixel centres lies half a pixel inside the edge.
        least, most = sorted((one / 2 + 0.5, other / 2 + 0.5))
        full = cv2.contourArea(contour) / max(np.pi * (least - 0.5) * (most - 0.5), 1.0)
        if least > 0.72 * most and 0.85 < full < 1.15:
            circles.append(Circle(x, y, most))
    return choose(window, circles)


def kasa(points: Floats) -> Circle:
    """Fit a circle to points (N, 2): x^2 + y^2 = 2 a x + 2 b y + c, linear in a, b, c (Kasa 1976)."""
    middle = points.mean(axis=0)
    x, y = (points - middle).T
    a, b, c = np.linalg.lstsq(np.stack([2 * x, 2 * y, np.ones_like(x)], axis=1), x**2 + y**2, rcond=None)[0]
    return Circle(float(a + middle[0]), float(b + middle[1]), float(np.sqrt(max(c + a * a + b * b, 1e-9))))


def rays_of(window: Window, seed: Circle) -> Circle | None:
    """Cast 180 rays from a seed, take each one's steepest fall, fit by Kasa with the worst points left out."""
    angles = np.linspace(0, 2 * np.pi, RAYS, endpoint=False)
    steps = np.arange(max(seed.radius_px - 4.0, 0.5), seed.radius_px + 4.01, 0.5)
    board = np.stack([np.outer(np.cos(angles), steps), np.outer(np.sin(angles), steps)])
    x, y = np.tensordot(np.linalg.inv(window.flat), board, 1)
    xs, ys = (x + seed.x).astype(np.float32), (y + seed.y).astype(np.float32)
    levels = cv2.GaussianBlur(cv2.remap(window.plane.astype(np.float32), xs, ys, cv2.INTER_LINEAR), (5, 1), 0)
    slope = levels[:, :-2] - levels[:, 2:]
    at = np.argmax(slope[:, 1:-1], axis=1) + 1
    row = np.arange(RAYS)
    before, peak, after = slope[row, at - 1], slope[row, at], slope[row, at + 1]
    bow = before - 2 * peak + after
    shift = np.where(np.abs(bow) > 1e-3, 0.5 * (before - after) / np.where(np.abs(bow) > 1e-3, bow, 1.0), 0.0)
    radius = steps[at + 1] + 0.5 * np.clip(shift, -1, 1)
    points = np.stack([np.cos(angles) * radius, np.sin(angles) * radius], axis=1)[peak > 0.4 * np.median(peak)]
    for _ in range(4):
        if len(points) < RAYS // 3:
            return None
        fit = kasa(points)
        miss = np.abs(np.hypot(points[:, 0] - fit.x, points[:, 1] - fit.y) - fit.radius_px)
        points = points[miss < max(2.5 * 1.48 * float(np.median(miss)), 0.3)]
    dx, dy = np.linalg.inv(window.flat) @ np.array([fit.x, fit.y])
    return Circle(seed.x + float(dx), seed.y + float(dy), fit.radius_px)


def rays_kasa(scene: PadScene | DiscScene) -> Point | None:
    """Start from HoughCircles, refine the candidates that look like pads by rays."""
    window = window_of(scene)
    refined = []
    for seed in _plausible(window, hough_circles(window)):
        fit: Circle | None = seed
        for _ in range(3):
            fit = rays_of(window, fit) if fit else None
        if fit is not None and np.hypot(fit.x - seed.x, fit.y - seed.y) < 4.0:
            refined.append(fit)
    return choose(window, refined)


def _plausible(window: Window, circles: list[Circle]) -> list[Circle]:
    near = [c for c in circles if np.hypot(c.x - window.around[0], c.y - window.around[1]) < 36.0]
    return [circle for circle in near if is_pad(window, circle)]


@cache
def _subpixel_edges() -> Callable[..., Any]:
    """Return the package's one function, compiled: it still names np.int, which NumPy took away in 1.24."""
    import subpixel_edges

    vars(np)["int"] = int
    try:
        subpixel_edges.subpixel_edges(np.random.default_rng(0).uniform(0, 255, (40, 40)), 20, 1, 2)
    finally:
        del vars(np)["int"]
    return subpixel_edges.subpixel_edges  # type: ignore[no-any-return]


def _fit_edges(
    window: Window, fit: Callable[..., Any], at: Floats, normal: Floats, seed: Circle, reach_px: float
) -> Circle | None:
    """Fit the edge points (N, 2) near a seed's contour whose normals lie along its rays, the worst left out."""
    away = (at - (seed.x, seed.y)) @ window.flat.T
    distance = np.hypot(away[:, 0], away[:, 1])
    towards = np.abs((away * normal).sum(axis=1)) / np.maximum(distance, 1e-6)
    points = away[(np.abs(distance - seed.radius_px) < reach_px) & (towards > 0.8)]
    for _ in range(3):
        if len(points) < 10:
            return None
        x, y, radius, _ = fit(points)
        miss = np.abs(np.hypot(points[:, 0] - x, points[:, 1] - y) - radius)
        points = points[miss < max(2.5 * 1.48 * float(np.median(miss)), 0.3)]
    dx, dy = np.linalg.inv(window.flat) @ np.array([x, y])
    return Circle(seed.x + float(dx), seed.y + float(dy), float(radius))


def subpixel_circle_fit(scene: PadScene | DiscScene) -> Point | None:
    """Trujillo-Pino's sub-pixel edges (subpixel-edges), those near a Hough seed fitted by hyperLSQ (circle-fit)."""
    from circle_fit import hyperLSQ

    window = window_of(scene)
    seeds = _plausible(window, hough_circles(window))
    if not seeds:
        return None
    edges = _subpixel_edges()(window.plane.astype(np.float64), 20, 1, 2)
    at = np.stack([edges.x, edges.y], axis=1)
    normal = np.stack([edges.nx, edges.ny], axis=1)
    circles = []
    for seed in seeds:
        fit: Circle | None = seed
        for reach in (4.5, 3.5, 2.5):
            fit = _fit_edges(window, hyperLSQ, at, normal, fit, reach) if fit else None
        if fit is not None and np.hypot(fit.x - seed.x, fit.y - seed.y) < 4.0:
            circles.append(fit)
    return choose(window, circles)


PEERS: dict[str, Peer] = {
    "cv2.HoughCircles": hough,
    "cv2.SimpleBlobDetector": simple_blob,
    "Otsu + fitEllipse": otsu_ellipse,
    "180 rays + Kasa fit": rays_kasa,
    "subpixel-edges + circle-fit": subpixel_circle_fit,
}
