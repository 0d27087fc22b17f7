"""Find the round things in the window and measure what the rules ask about them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.caliper import Floats, middle
from vision.circle import CircleFit, Contour, fit_circle
from vision.circle_seeds import seeds
from vision.disc import DiscFit, measure_disc
from vision.edgels import Edgels
from vision.image import Plane
from vision.rules import (
    LEAST_FILL,
    LEAST_RATIO,
    LEAST_VISIBLE,
    STROKE_NECK,
    WHOLE_VISIBLE,
    Hole,
    SeenObject,
    Wanted,
    is_round,
)
from vision.segment import components
from vision.view import View
from vision.window import Flags, Window

# A circle with edge on less than this of its visible contour is not even a doubtful one.
LISTED_COVERAGE = 0.45
# A doubtful circle in a region this many times its own area belongs to that region.
LARGER_SHARE = 1.6
# Where is looked for what goes on beyond a circle: on these rings, in radii, along so many rays.
NECK_RINGS, NECK_RAYS, NECK_BESIDE = (1.15, 1.25, 1.35, 1.45), 72, 3
# A hole is darker than its pad by at least this share of the pad's contrast; once measured without its blur it is as
# dark as the board or nearly. A mark that a probe has left is not.
HOLE_DEPTH, HOLE_STEP = 0.30, 0.55
# A hole's radius as a share of its pad's, and how far a drill wanders; marks are smaller or lie anywhere.
HOLE_LEAST, HOLE_LARGEST, HOLE_WANDER = 0.12, 0.62, 0.32
# Holes at least this large have a rim to lie on, visible for this share, of which this share shows an edge.
HOLE_WITH_EDGE_PX, HOLE_VISIBLE, HOLE_COVERAGE = 3.6, 0.45, 0.55
# A whole circle tells the shape of the others beside it to this share of the radius, if as much edge lies on it.
REFERENCE_SIGMA, TOLD_COVERAGE = 0.015, 0.9
# Two measurements of one circle agree to this, px, and three sigma.
AGREE_PX = 0.1
# What lies this near a whole circle is the other's blur.
TOUCHING_PX = 2
# A ring's inside is wider than this share of it and as bright as the board to this share of its step.
RING_SHARE, RING_LIKENESS = 0.44, 0.08
# Of pads smaller than this the middle may be a hole though it is not dark: duller than the ring by this share.
DIP_RADIUS_PX, DIP_SHARE = 10.0, 0.12
# The hole of a small pad must explain the pixels better by this much: chi square of four parameters, far out.
HOLE_EVIDENCE = 30.0
# Levels are taken where nothing can stand in front, if that is this share of the disc or more.
LEAST_CLEAR = 0.3
# A measured disc that differs from its edge points by more than this (px, or share of the radius) is something else.
MOST_REFINED_PX, MOST_REFINED_SHARE = 1.0, 0.07


@dataclass(frozen=True, slots=True)
class _Patch:
    """The pixels round a disc: brightness, distance from its centre in radii, what can be seen; each (h, w)."""

    x_px: int
    y_px: int
    level: Plane
    rho: Floats
    free: Flags

    def at(self, x_px: float, y_px: float) -> Floats:
        """Return every pixel's distance from a point of the window, px."""
        rows, columns = np.ogrid[: self.level.shape[0], : self.level.shape[1]]
        return np.asarray(np.hypot(columns + self.x_px - x_px, rows + self.y_px - y_px))


def round_objects(window: Window, edgels: Edgels, wanted: Wanted) -> list[SeenObject]:
    """Return the circles found in the window with their features, each thing once.

    This is the thesis' "place a circle, blacken, repeat" (5.4.3): touching pads and pads with a trace come apart, and
    what is inside a whole disc is not asked about again.
    """
    bands = [(max(0.8 * low, 3.5), 1.25 * high) for low, high in wanted.radii_px]
    found: list[SeenObject] = []
    for seed in seeds(edgels, window.shape, bands, window.view):
        if any(_within((seed.x_px, seed.y_px), whole.circle) for whole in found if _whole(whole)):
            continue
        circle = _fit(window, edgels, Contour(seed.x_px, seed.y_px, seed.radius_px))
        if circle is None or circle.coverage < LISTED_COVERAGE or any(_same(circle, other.circle) for other in found):
            continue
        seen = _describe(window, edgels, circle)
        if _whole(seen):
            found = [other for other in found if other.circle and not _within(_centre(other.circle), circle)]
        found.append(seen)
    if window.maybe_hidden.any():
        found = [_without_doubt(window, edgels, seen) for seen in found]
    found = _again(window, edgels, found)
    done = blackened(window, [seen for seen in found if _whole(seen)])
    kept = [seen for seen in found if _whole(seen) or not _part_of_larger(window, seen, done)]
    return [_in_frame(seen, window) for seen in kept]


def blackened(window: Window, discs: Iterable[SeenObject], margin_px: int = 3) -> NDArray[np.uint8]:
    """Return a mask (0/1) of what needs no further look: the needle and the given discs (in the window's pixels)."""
    done = window.hidden.astype(np.uint8)
    for seen in discs:
        if seen.circle is not None:
            circle = seen.circle
            axes = round(circle.radius_px * circle.ratio) + margin_px, round(circle.radius_px) + margin_px
            at = round(circle.x_px), round(circle.y_px)
            cv2.ellipse(done, at, axes, float(np.degrees(circle.minor_rad)), 0.0, 360.0, (1,), -1)
    return done


def _without_doubt(window: Window, edgels: Edgels, seen: SeenObject) -> SeenObject:
    """Return a circle as it is where nothing can stand before it, unless what may be hidden says the same.

    The edge of a needle across a pad lies near the pad's own: where they disagree, the pad's is the one far from it.
    """
    circle = seen.circle
    if circle is None:
        return seen
    clear = replace(window, hidden=window.hidden | window.maybe_hidden, maybe_hidden=np.zeros_like(window.maybe_hidden))
    points = edgels.outside(clear.hidden)
    other = _fit(clear, points, Contour(circle.x_px, circle.y_px, circle.radius_px))
    if other is None or other.visible < LEAST_VISIBLE or other.coverage < circle.coverage:
        return seen
    strict = _describe(clear, points, other)
    if strict.circle is None:
        return seen
    apart = np.hypot(strict.circle.x_px - circle.x_px, strict.circle.y_px - circle.y_px)
    return strict if apart > AGREE_PX + 3.0 * strict.circle.sigma_px else seen


def _again(window: Window, edgels: Edgels, found: list[SeenObject]) -> list[SeenObject]:
    """Measure once more what is not whole, knowing the whole circles beside it (thesis 5.4.3: blacken, and repeat).

    They tell how obliquely the board is seen, and where they touch another its contour cannot show.
    """
    whole = [seen for seen in found if _whole(seen) and seen.circle and seen.circle.ratio > LEAST_RATIO]
    if not whole or len(whole) == len(found):
        return found
    known = replace(window, hidden=blackened(window, whole, TOUCHING_PX) > 0)
    best = max(whole, key=lambda seen: seen.circle.visible * seen.circle.radius_px if seen.circle else 0.0).circle
    if best is not None and best.visible > WHOLE_VISIBLE:
        known = replace(known, view=View(best.ratio, best.minor_rad, REFERENCE_SIGMA))
    left_over = edgels.outside(known.hidden)
    again: list[SeenObject] = []
    for seen in found:
        circle = seen.circle
        if circle is None or (seen in whole and circle.visible > WHOLE_VISIBLE):
            again.append(seen)
            continue
        others = known if seen not in whole else replace(known, hidden=window.hidden)
        points = left_over if seen not in whole else edgels
        better = _fit(others, points, Contour(circle.x_px, circle.y_px, circle.radius_px))
        told = better is not None and better.coverage > TOLD_COVERAGE * circle.coverage
        again.append(_describe(others, points, better) if better and told else seen)
    return again


def _fit(window: Window, edgels: Edgels, seed: Contour) -> CircleFit | None:
    return fit_circle(
        edgels,
        seed,
        window.view,
        shape=window.shape,
        reach_px=max(2.5, 0.22 * seed.radius_px),
        hidden=window.hidden,
        maybe_hidden=window.maybe_hidden,
    )


def _part_of_larger(window: Window, seen: SeenObject, done: NDArray[np.uint8]) -> bool:
    """Tell whether a doubtful circle is only the corner or the end of something larger, judged as a whole later."""
    if seen.circle is None:
        return False
    column, row = round(seen.circle.x_px), round(seen.circle.y_px)
    if not (0 <= row < window.shape[0] and 0 <= column < window.shape[1]):
        return True
    bright = ((window.smooth > seen.level - 0.5 * seen.contrast) & (done == 0)).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(bright, connectivity=8)
    label = int(labels[row, column])
    area = seen.area_px * seen.circle.ratio
    return label > 0 and float(stats[label, cv2.CC_STAT_AREA]) > LARGER_SHARE * area


def _whole(seen: SeenObject) -> bool:
    """Tell whether an object is a disc to its rim: what goes on all round it is only the middle of one."""
    return is_round(seen) and seen.fill >= LEAST_FILL and (seen.neck < STROKE_NECK or seen.hole is not None)


def _centre(circle: CircleFit) -> tuple[float, float]:
    return circle.x_px, circle.y_px


def _within(at_px: tuple[float, float], circle: CircleFit | None) -> bool:
    return circle is not None and np.hypot(at_px[0] - circle.x_px, at_px[1] - circle.y_px) < 0.9 * circle.radius_px


def _same(one: CircleFit, other: CircleFit | None) -> bool:
    if other is None:
        return False
    apart = float(np.hypot(one.x_px - other.x_px, one.y_px - other.y_px))
    return apart < 0.6 * max(one.radius_px, other.radius_px)


def _in_frame(seen: SeenObject, window: Window) -> SeenObject:
    """Return an object in the frame's pixels, its circle and hole still in the window's."""
    return replace(seen, x_px=seen.x_px + window.x_px, y_px=seen.y_px + window.y_px)


def _describe(window: Window, edgels: Edgels, circle: CircleFit) -> SeenObject:
    """Return the features of a disc from the pixels inside and around it, in the window's pixels."""
    patch = _patch(window, circle)
    inside, around = patch.rho < 0.85, patch.rho > 1.0 + 2.0 / circle.radius_px
    clear = patch.free & ~window.maybe_hidden[_box(patch)]
    if np.count_nonzero(clear & inside) < LEAST_CLEAR * np.count_nonzero(inside):
        clear = patch.free
    disc, ring = patch.level[inside & clear], patch.level[around & clear]
    level = middle(disc, 0.65) if disc.size else 0.0
    floor = middle(ring, 0.4) if ring.size else window.board_level
    idea, hole, measured = None, None, None
    if circle.coverage >= LISTED_COVERAGE and level > floor:
        idea = _find_hole(window, edgels, circle, patch, level - floor, level)
        hole, measured = _measure(window, circle, idea)
    body = inside & clear
    # Dark middles that could not be measured, seen obliquely through a thick board, are holes all the same.
    bore = hole or idea
    if bore is not None:
        body &= patch.at(bore.x_px, bore.y_px) > bore.radius_px + 1.5
    fill = float(np.mean(patch.level[body] > (level + floor) / 2.0)) if np.any(body) else 0.0
    if measured is not None:
        circle = measured
    height, width = window.shape
    outside = min(circle.x_px, circle.y_px, width - 1 - circle.x_px, height - 1 - circle.y_px) < circle.radius_px + 1.0
    size = 2.0 * circle.radius_px
    return SeenObject(
        circle.x_px,
        circle.y_px,
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
        0.0,
        _is_ring(circle, patch, idea, floor, level - floor),
        circle,
        hole,
        window.distance_px(circle.x_px, circle.y_px),
    )


def _patch(window: Window, circle: CircleFit) -> _Patch:
    contour = circle.contour
    height, width = window.shape
    reach = int(circle.radius_px * 1.4) + 4
    x1, y1 = max(int(contour.x_px) - reach, 0), max(int(contour.y_px) - reach, 0)
    x2, y2 = min(int(contour.x_px) + reach + 1, width), min(int(contour.y_px) + reach + 1, height)
    linear = window.view.flattening()
    dx, dy = np.arange(x1, x2)[None, :] - contour.x_px, np.arange(y1, y2)[:, None] - contour.y_px
    u, v = linear[0, 0] * dx + linear[0, 1] * dy, linear[1, 0] * dx + linear[1, 1] * dy
    square = np.maximum(u * u + v * v, 1e-6)
    harmonic = (contour.cos2_px * (u * u - v * v) + contour.sin2_px * 2.0 * u * v) / square
    rho = np.sqrt(square) / (contour.radius_px + harmonic)
    return _Patch(x1, y1, window.raw[y1:y2, x1:x2], rho, ~window.hidden[y1:y2, x1:x2])


def _box(patch: _Patch) -> tuple[slice, slice]:
    height, width = patch.level.shape
    return slice(patch.y_px, patch.y_px + height), slice(patch.x_px, patch.x_px + width)


def _measure(window: Window, circle: CircleFit, idea: Contour | None) -> tuple[Hole | None, CircleFit | None]:
    """Measure the disc (and hole) on its pixels; the circle is None where the model does not describe them."""

    def attempt(hole: Contour | None) -> DiscFit | None:
        return measure_disc(
            window.raw, circle.contour, window.view, hole=hole, usable=~window.hidden, sectors=circle.sectors
        )

    fit = attempt(idea) if idea is not None else None
    if fit is None or fit.hole_step < HOLE_STEP * fit.step:
        fit = attempt(None)
    elif circle.radius_px < DIP_RADIUS_PX:
        plain = attempt(None)
        if plain is not None and plain.misfit - fit.misfit < HOLE_EVIDENCE * fit.noise**2:
            fit = plain
    if fit is None:
        return None, None
    contour = fit.contour
    moved = np.hypot(contour.x_px - circle.x_px, contour.y_px - circle.y_px)
    grown = abs(contour.radius_px - circle.contour.radius_px)
    if max(moved, grown) > max(MOST_REFINED_PX, MOST_REFINED_SHARE * circle.radius_px):
        return None, None
    radius, ratio, minor = contour.ellipse(window.view)
    better = replace(
        circle,
        x_px=contour.x_px,
        y_px=contour.y_px,
        radius_px=radius,
        ratio=ratio,
        minor_rad=minor,
        sigma_px=fit.sigma_px,
        contour=contour,
    )
    if fit.hole is None:
        return None, better
    size, _, _ = fit.hole.ellipse(window.view)
    return Hole(fit.hole.x_px, fit.hole.y_px, size, fit.hole_sigma_px), better


def _neck(window: Window, circle: CircleFit, threshold: float) -> float:
    """Return the width of the widest thing above `threshold` just beyond a circle, over the circle's diameter."""
    angles = np.arange(NECK_RAYS, dtype=np.float64)[:, None] * (2.0 * np.pi / NECK_RAYS)
    xs, ys = window.view.to_image(circle.x_px, circle.y_px, np.array(NECK_RINGS) * circle.contour.radius_px, angles)
    rows = np.clip(np.rint(ys).astype(np.intp), 0, window.shape[0] - 1)
    columns = np.clip(np.rint(xs).astype(np.intp), 0, window.shape[1] - 1)
    hidden = window.hidden[rows, columns] | window.maybe_hidden[rows, columns]
    bright = (window.smooth[rows, columns] > threshold) & ~window.hidden[rows, columns]
    if not bright.any():
        return 0.0
    # Whatever goes on does so on every ring; the narrowest of its widths tells a touching pad from a stroke.
    return min(
        _widest(_behind(on_ring, unseen)) * ring
        for on_ring, unseen, ring in zip(bright.T, hidden.T, NECK_RINGS, strict=True)
    )


def _behind(bright: Flags, hidden: Flags) -> Flags:
    """Return a ring's bright rays with those that hide between two bright ones, or beside one: it goes on there."""
    if not hidden.any() or hidden.all():
        return bright
    start = int(np.argmin(hidden))
    bright, hidden = np.roll(bright, -start), np.roll(hidden, -start)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], hidden, [False]]).astype(np.int8)))
    filled = bright.copy()
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        beside = bright[first - NECK_BESIDE : first].any() or bright[after : after + NECK_BESIDE].any()
        filled[first:after] |= beside
    return filled


def _widest(bright: Flags) -> float:
    """Return the half width of the longest run round a ring of radius 1: 1 where it spans half of the ring or more."""
    if bright.all():
        return 1.0
    # Unrolled from a dark ray on, every run is whole.
    unrolled = np.roll(bright, -int(np.argmin(bright)))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], unrolled, [False]]).astype(np.int8)))
    longest = int((edges[1::2] - edges[::2]).max()) if edges.size else 0
    return float(np.sin(min(np.pi * longest / bright.size, np.pi / 2.0)))


def _find_hole(
    window: Window, edgels: Edgels, circle: CircleFit, patch: _Patch, step: float, level: float
) -> Contour | None:
    """Return a first idea of the dark hole inside a circle, or None where none is seen."""
    # Nearer the rim than this the blur alone is dark.
    inner = 1.0 - 1.2 / circle.radius_px
    seen = patch.free & ~window.maybe_hidden[_box(patch)]
    dark = seen & (patch.rho < inner) & (patch.level < level - max(HOLE_DEPTH * step, 15.0))
    for region in components(dark.astype(np.uint8), 3):
        rows, columns = np.nonzero(region.mask)
        x, y = patch.x_px + region.box[0] + float(np.mean(columns)), patch.y_px + region.box[1] + float(np.mean(rows))
        radius = float(np.sqrt(region.area_px / np.pi / circle.ratio))
        idea = Contour(x, y, max(radius, 1.0))
        if radius >= HOLE_WITH_EDGE_PX:
            # A needle may stand before part of it: the hole is where a circle lies on its edge.
            rim = _hole_rim(window, edgels, idea)
            if rim is None:
                continue
            idea = rim
        elif max(region.box[2:]) > 3.0 * radius + 1.0:
            continue
        off_centre = float(np.hypot(idea.x_px - circle.x_px, idea.y_px - circle.y_px)) / circle.radius_px
        sized = HOLE_LEAST < idea.radius_px / circle.radius_px < HOLE_LARGEST
        if sized and off_centre < HOLE_WANDER:
            return idea
    return _dip(circle, patch, step) if circle.radius_px < DIP_RADIUS_PX else None


def _is_ring(circle: CircleFit, patch: _Patch, hole: Contour | None, floor: float, step: float) -> bool:
    """Tell whether a wide hole shows the board itself. A drilled one is mostly darker, or shows what lies below."""
    if hole is None or hole.radius_px < RING_SHARE * circle.radius_px:
        return False
    within = patch.free & (patch.at(hole.x_px, hole.y_px) < 0.7 * hole.radius_px)
    return bool(within.any()) and abs(middle(patch.level[within]) - floor) < RING_LIKENESS * step


def _hole_rim(window: Window, edgels: Edgels, idea: Contour) -> Contour | None:
    """Return the circle on the edge of a dark region, if there is one."""
    rim = fit_circle(
        edgels,
        idea,
        window.view,
        shape=window.shape,
        reach_px=max(2.0, 0.5 * idea.radius_px),
        bright_inside=False,
        hidden=window.hidden,
        maybe_hidden=window.maybe_hidden,
    )
    if rim is None or rim.coverage < HOLE_COVERAGE or rim.visible < HOLE_VISIBLE:
        return None
    return rim.contour


def _dip(circle: CircleFit, patch: _Patch, step: float) -> Contour | None:
    """Return a hole too small for its blur to be dark: the middle of a small pad, duller than the ring round it.

    A small pad without a hole is brightest in its middle.
    """
    middle_part, ring = patch.free & (patch.rho < 0.45), patch.free & (patch.rho > 0.4) & (patch.rho < 0.75)
    if np.count_nonzero(middle_part) < 5 or np.count_nonzero(ring) < 8:
        return None
    crest = middle(patch.level[ring], 0.7)
    depth = np.where(middle_part, np.clip(crest - patch.level, 0.0, None), 0.0)
    if float(depth[middle_part].mean()) < DIP_SHARE * step:
        return None
    rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]]
    total = float(depth.sum())
    x, y = float((depth * columns).sum()) / total, float((depth * rows).sum()) / total
    return Contour(patch.x_px + x, patch.y_px + y, 0.4 * circle.radius_px)
