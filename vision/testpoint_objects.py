"""Cut the window round the tip into objects and measure their features, for the rules to decide on.

Two views of the same window: the raw pixels, on which positions are measured, and a flattened copy in which circles
on the board are circles, on which shapes are judged.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.caliper import sample
from vision.circle import CircleFit, View, fit_circle
from vision.circle_seeds import radii, seeds
from vision.image import Gray, Plane, despike, median
from vision.rules import LEAST_FILL, Hole, SeenObject, Wanted, is_round
from vision.segment import Component, components, multi_otsu

CLASSES = 4
# Brightness classes this little above the board are solder mask and what lies under it.
LEAST_STEP = 25.0
# Objects smaller than this are noise and not even listed.
LEAST_LISTED_PX = 9
# A circle with edge on less than this of its visible contour is not even a doubtful one.
LISTED_COVERAGE = 0.45
# A doubtful circle in a region this many times its own area belongs to that region.
LARGER_SHARE = 1.6
# Where is looked for what goes on beyond a circle: on these rings, in radii, along so many rays.
NECK_RINGS, NECK_RAYS = (1.15, 1.25, 1.35, 1.45), 72
# A hole is darker than its pad by at least this share of the pad's contrast, and no larger than this share of it.
HOLE_DEPTH, HOLE_LARGEST = 0.30, 0.72


@dataclass(frozen=True, slots=True)
class Window:
    """Hold the part of the red frame that is looked at.

    raw: (H, W) float32, spikes removed, else as taken; flat: flattened and median-filtered uint8; to_flat: (2, 3) from
    raw to flat pixels; hidden, hidden_flat: what the needle covers; x_px, y_px: raw pixel (0, 0) in the frame;
    board_level: brightness of the bare board; around_px: the tip, in raw pixels.
    """

    raw: Plane
    flat: Gray
    to_flat: NDArray[np.float64]
    hidden: NDArray[np.bool_] | None
    hidden_flat: NDArray[np.uint8]
    x_px: int
    y_px: int
    board_level: float
    around_px: tuple[float, float]
    view: View

    def flatten(self, x_px: float, y_px: float) -> tuple[float, float]:
        """Return where a raw point lies in the flattened picture."""
        x, y = self.to_flat @ np.array([x_px, y_px, 1.0])
        return float(x), float(y)

    def unflatten(self, x_px: float, y_px: float) -> tuple[float, float]:
        """Return where a flattened point lies in the raw window."""
        x, y = np.linalg.solve(self.to_flat[:, :2], np.array([x_px, y_px]) - self.to_flat[:, 2])
        return float(x), float(y)


def open_window(
    plane: Gray,
    corner: tuple[int, int],
    around_px: tuple[float, float],
    view: View,
    outline: NDArray[np.float64] | None,
) -> Window:
    """Prepare a window (H, W) uint8 whose top-left pixel is `corner`; `outline` (N, 2): the needle, in the frame."""
    clean = despike(np.ascontiguousarray(plane))
    linear = view.flattening()
    height, width = clean.shape
    centre = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
    # Room for the stretch along the minor axis.
    grown = int(np.ceil(width / view.ratio)), int(np.ceil(height / view.ratio))
    shift = (np.array(grown) - 1.0) / 2.0 - linear @ centre
    to_flat = np.column_stack([linear, shift])
    warped = cv2.warpAffine(median(clean, 3), to_flat, grown, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    flat = np.asarray(warped, dtype=np.uint8)
    cover = np.zeros(clean.shape, dtype=np.uint8)
    if outline is not None:
        points = np.rint((outline - np.array(corner)) * 16.0).astype(np.int32)
        cv2.fillPoly(cover, [points], (1,), shift=4)
    outside = np.ones(clean.shape, dtype=np.uint8)
    inside_flat = cv2.warpAffine(outside, to_flat, grown, flags=cv2.INTER_NEAREST)
    covered_flat = cv2.warpAffine(cover, to_flat, grown, flags=cv2.INTER_NEAREST)
    hidden_flat = np.maximum(np.asarray(covered_flat, dtype=np.uint8), 1 - np.asarray(inside_flat, dtype=np.uint8))
    seen = flat[hidden_flat == 0]
    board = float(np.partition(seen, seen.size // 4)[seen.size // 4]) if seen.size else 0.0
    around = around_px[0] - corner[0], around_px[1] - corner[1]
    return Window(
        clean.astype(np.float32),
        flat,
        to_flat,
        cover > 0 if outline is not None else None,
        hidden_flat,
        corner[0],
        corner[1],
        board,
        around,
        view,
    )


def round_objects(window: Window, wanted: Wanted) -> list[SeenObject]:
    """Return the circles found in the window with their features, each thing once.

    This is the thesis' "place a circle, blacken, repeat" (5.4.3): touching pads and pads with a trace come apart, and
    what is inside a whole disc is not asked about again.
    """
    trial: tuple[float, ...] = ()
    for low, high in wanted.radii_px:
        trial += radii(max(0.8 * low, 3.5), 1.25 * high)
    found: list[SeenObject] = []
    for seed in seeds(window.flat, trial, window.hidden_flat):
        at = window.unflatten(seed.x_px, seed.y_px)
        if any(_within(at, whole.circle) for whole in found if _whole(whole)):
            continue
        reach = max(2.5, 0.22 * seed.radius_px)
        circle = fit_circle(window.raw, at, seed.radius_px, window.view, reach_px=reach, hidden=window.hidden)
        if circle is None or circle.coverage < LISTED_COVERAGE or any(_same(circle, other.circle) for other in found):
            continue
        seen = _describe_circle(window, circle)
        if _whole(seen):
            found = [other for other in found if other.circle and not _within(_centre(other.circle), circle)]
        found.append(seen)
    done = blackened(window, [seen for seen in found if _whole(seen)])
    return [seen for seen in found if _whole(seen) or not _part_of_larger(window, seen, done)]


def blackened(window: Window, discs: Iterable[SeenObject]) -> NDArray[np.uint8]:
    """Return a mask (flattened, 0/1) of what needs no further look: the needle and the given discs."""
    done = window.hidden_flat.copy()
    for seen in discs:
        if seen.circle is not None:
            x, y = window.flatten(seen.circle.x_px, seen.circle.y_px)
            cv2.circle(done, (round(x), round(y)), round(seen.circle.radius_px) + 3, (1,), -1)
    return done


def _part_of_larger(window: Window, seen: SeenObject, done: NDArray[np.uint8]) -> bool:
    """Tell whether a doubtful circle is only the corner or the end of something larger, judged as a whole later."""
    if seen.circle is None:
        return False
    x, y = window.flatten(seen.circle.x_px, seen.circle.y_px)
    column, row = round(x), round(y)
    if not (0 <= row < window.flat.shape[0] and 0 <= column < window.flat.shape[1]):
        return True
    bright = ((window.flat > seen.level - 0.5 * seen.contrast) & (done == 0)).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(bright, connectivity=8)
    label = int(labels[row, column])
    return label > 0 and float(stats[label, cv2.CC_STAT_AREA]) > LARGER_SHARE * seen.area_px


def _whole(seen: SeenObject) -> bool:
    return is_round(seen) and seen.fill >= LEAST_FILL


def _centre(circle: CircleFit) -> tuple[float, float]:
    return circle.x_px, circle.y_px


def _within(at_px: tuple[float, float], circle: CircleFit | None) -> bool:
    return circle is not None and np.hypot(at_px[0] - circle.x_px, at_px[1] - circle.y_px) < 0.9 * circle.radius_px


def _same(one: CircleFit, other: CircleFit | None) -> bool:
    if other is None:
        return False
    apart = float(np.hypot(one.x_px - other.x_px, one.y_px - other.y_px))
    return apart < 0.6 * max(one.radius_px, other.radius_px)


def _describe_circle(window: Window, circle: CircleFit) -> SeenObject:
    """Return the features of a disc from the raw pixels inside and around it."""
    height, width = window.raw.shape
    reach = int(circle.radius_px * 1.5) + 4
    x1, y1 = max(int(circle.x_px) - reach, 0), max(int(circle.y_px) - reach, 0)
    x2, y2 = min(int(circle.x_px) + reach + 1, width), min(int(circle.y_px) + reach + 1, height)
    part = window.raw[y1:y2, x1:x2]
    rows, columns = np.mgrid[y1:y2, x1:x2]
    linear = window.view.flattening()
    dx, dy = columns - circle.x_px, rows - circle.y_px
    rho = np.hypot(linear[0, 0] * dx + linear[0, 1] * dy, linear[1, 0] * dx + linear[1, 1] * dy) / circle.radius_px
    free = np.ones(part.shape, dtype=bool) if window.hidden is None else ~window.hidden[y1:y2, x1:x2]
    inside = part[(rho < 0.85) & free]
    around = part[(rho > 1.0 + 2.0 / circle.radius_px) & (rho < 1.4 + 2.0 / circle.radius_px) & free]
    level = _quantile(inside, 0.65) if inside.size else 0.0
    floor = _quantile(around, 0.4) if around.size else window.board_level
    hole = _hole(window, circle, (part, rho, free & (rho < 0.8)), (x1, y1), level, floor)
    body = free & (rho < 0.85)
    if hole is not None:
        away = np.hypot(columns - hole.x_px, rows - hole.y_px) > hole.radius_px + 1.5
        body &= away
    fill = float(np.mean(part[body] > (level + floor) / 2.0)) if np.any(body) else 0.0
    edge = circle.radius_px + 1.0
    outside = min(circle.x_px, circle.y_px, width - 1 - circle.x_px, height - 1 - circle.y_px) < edge
    size = 2.0 * circle.radius_px
    distance = float(np.hypot(circle.x_px - window.around_px[0], circle.y_px - window.around_px[1]))
    return SeenObject(
        circle.x_px + window.x_px,
        circle.y_px + window.y_px,
        float(np.pi * circle.radius_px**2),
        size,
        size,
        1.0,
        float(np.pi / 4.0),
        fill,
        level,
        level - floor,
        _neck(window, circle, (level + floor) / 2.0),
        outside,
        circle,
        hole,
        distance,
    )


def _neck(window: Window, circle: CircleFit, threshold: float) -> float:
    """Return the width of the widest thing above `threshold` just beyond a circle, over the circle's diameter."""
    angles = np.arange(NECK_RAYS, dtype=np.float64) * (2.0 * np.pi / NECK_RAYS)
    rho = np.broadcast_to(np.array(NECK_RINGS) * circle.radius_px, (NECK_RAYS, len(NECK_RINGS)))
    xs, ys = window.view.to_image(circle.x_px, circle.y_px, rho, np.asarray(angles[:, None], dtype=np.float64))
    bright = np.min(sample(window.raw, xs, ys), axis=1) > threshold
    if window.hidden is not None:
        rows = np.clip(np.rint(ys[:, -1]).astype(np.intp), 0, window.hidden.shape[0] - 1)
        columns = np.clip(np.rint(xs[:, -1]).astype(np.intp), 0, window.hidden.shape[1] - 1)
        bright &= ~window.hidden[rows, columns]
    if bright.all():
        return NECK_RINGS[-1]
    # Unrolled from a dark ray on, every run is whole.
    unrolled = np.roll(bright, -int(np.argmin(bright)))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], unrolled, [False]]).astype(np.int8)))
    longest = int((edges[1::2] - edges[::2]).max()) if edges.size else 0
    return float(NECK_RINGS[-1] * np.sin(min(np.pi * longest / NECK_RAYS, np.pi / 2.0)))


def _quantile(values: Plane, share: float) -> float:
    at = int(share * (values.size - 1))
    return float(np.partition(values, at)[at])


def _hole(
    window: Window,
    circle: CircleFit,
    inner: tuple[Plane, NDArray[np.float64], NDArray[np.bool_]],
    corner: tuple[int, int],
    level: float,
    floor: float,
) -> Hole | None:
    """Return the dark hole inside a circle, or None where there is none or too little of it is seen."""
    part, rho, usable = inner
    step = level - floor
    if step <= 0:
        return None
    dark = usable & (part < level - max(HOLE_DEPTH * step, 15.0))
    regions = components(dark.astype(np.uint8), 4)
    if not regions:
        return None
    region = regions[0]
    x, y, wide, high = region.box
    radius = float(np.sqrt(region.area_px / np.pi / window.view.ratio))
    rows, columns = np.nonzero(region.mask)
    seed = corner[0] + x + float(np.mean(columns)), corner[1] + y + float(np.mean(rows))
    off_centre = float(np.hypot(seed[0] - circle.x_px, seed[1] - circle.y_px))
    if radius > HOLE_LARGEST * circle.radius_px or off_centre > 0.45 * circle.radius_px or max(wide, high) > 5 * radius:
        return None
    if radius >= 3.5:
        fit = fit_circle(
            window.raw,
            seed,
            radius,
            window.view,
            reach_px=max(2.0, 0.3 * radius),
            bright_inside=False,
            hidden=window.hidden,
        )
        if fit is None or fit.coverage < 0.5 or fit.visible < 0.5:
            return None
        return Hole(fit.x_px, fit.y_px, fit.radius_px, fit.sigma_px)
    return _small_hole(window, part, rho, corner, seed, radius, level)


def _small_hole(
    window: Window,
    part: Plane,
    rho: NDArray[np.float64],
    corner: tuple[int, int],
    seed: tuple[float, float],
    radius: float,
    level: float,
) -> Hole | None:
    """Return a hole of a few pixels by the centroid of its darkness: it has too little edge for calipers."""
    rows, columns = np.mgrid[0 : part.shape[0], 0 : part.shape[1]]
    x, y = seed[0] - corner[0], seed[1] - corner[1]
    for _ in range(4):
        distance = np.hypot(columns - x, rows - y)
        weight = np.clip(level - part, 0.0, None) * np.clip(radius + 1.0 - distance, 0.0, 1.0) * (rho < 0.85)
        if window.hidden is not None:
            cover = window.hidden[corner[1] : corner[1] + part.shape[0], corner[0] : corner[0] + part.shape[1]]
            if np.any(cover & (distance < radius + 1.5)):
                return None
        total = float(weight.sum())
        if total <= 0.0:
            return None
        x, y = float((weight * columns).sum() / total), float((weight * rows).sum() / total)
    noise = 4.0 * np.sqrt(np.pi) * (radius + 1.0) ** 2 / 2.0 / total
    return Hole(x + corner[0], y + corner[1], radius, float(np.hypot(noise, 0.03)))


def other_objects(window: Window, explained: Iterable[SeenObject]) -> list[SeenObject]:
    """Return the bright objects that `explained` circles leave over, by brightness class from the top."""
    done = blackened(window, explained)
    levels = multi_otsu(window.flat, CLASSES, window.hidden_flat == 0)
    found: list[SeenObject] = []
    for threshold in sorted({level for level in levels if level >= window.board_level + LEAST_STEP}, reverse=True):
        mask = ((window.flat > threshold) & (done == 0)).astype(np.uint8)
        found += [_describe_region(window, region) for region in components(mask, LEAST_LISTED_PX)]
        done |= np.asarray(cv2.dilate(mask, np.ones((5, 5), dtype=np.uint8)), dtype=np.uint8)
    return found


def _describe_region(window: Window, region: Component) -> SeenObject:
    """Return the features of a connected region of the flattened picture, holes filled."""
    x, y, width, height = region.box
    contours, _ = cv2.findContours(region.mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(contours, key=len)
    area = float(cv2.contourArea(outline)) + 0.5 * float(len(outline)) + 1.0
    perimeter = float(cv2.arcLength(outline, closed=True)) + 3.0
    (_, (side1, side2), _) = cv2.minAreaRect(outline)
    length, thickness = max(side1, side2) + 1.0, min(side1, side2) + 1.0
    moments = cv2.moments(region.mask, binaryImage=True)
    cx, cy = x + moments["m10"] / moments["m00"], y + moments["m01"] / moments["m00"]
    pixels = window.flat[y : y + height, x : x + width]
    level = float(np.median(pixels[region.mask > 0]))
    grown = cv2.dilate(
        cv2.copyMakeBorder(region.mask, 4, 4, 4, 4, cv2.BORDER_CONSTANT, value=0), np.ones((7, 7), np.uint8)
    )
    y1, x1 = max(y - 4, 0), max(x - 4, 0)
    y2, x2 = min(y + height + 4, window.flat.shape[0]), min(x + width + 4, window.flat.shape[1])
    ring = grown[y1 - y + 4 : y2 - y + 4, x1 - x + 4 : x2 - x + 4].copy()
    ring[y - y1 : y - y1 + height, x - x1 : x - x1 + width][region.mask > 0] = 0
    hidden = window.hidden_flat[y1:y2, x1:x2]
    near = window.flat[y1:y2, x1:x2][(ring > 0) & (hidden == 0)]
    floor = float(np.partition(near, near.size // 3)[near.size // 3]) if near.size else window.board_level
    cut = bool(np.any(hidden[(ring > 0)]))
    image_x, image_y = window.unflatten(cx, cy)
    distance = float(np.hypot(image_x - window.around_px[0], image_y - window.around_px[1]))
    return SeenObject(
        image_x + window.x_px,
        image_y + window.y_px,
        area,
        length,
        thickness,
        perimeter / (2.0 * float(np.sqrt(np.pi * area))),
        area / (length * thickness),
        1.0,
        level,
        level - floor,
        0.0,
        cut,
        None,
        None,
        distance,
    )
