"""Efficient measurement of a disc, with or without a hole, on its pixels.

The model is the image itself: levels inside and outside that may slope, one blur, one ellipse a disc. Gauss-Newton on
the pixels within a few px of the edges, weighted robustly, so that a trace, a probe, dirt or a neighbour drop out. On
white noise it comes within 1.0..1.5 times the Cramer-Rao bound (tests/bench/vision): it must also find the levels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.core import Contour, Floats, Plane, View, mad_sigma, quantile, solve_normal, tukey

Flags = NDArray[np.bool_]
EDGE_PX = 3.0
"""Pixels this near the rim tell of its place."""
INSIDE_PX, OUTSIDE_PX = 7.0, 6.5
"""Pixels this near an edge are asked: the nearest tell of its place, the farther ones of how the levels slope."""
ROUNDS = 5
MOST_MISFIT = 25.0
"""A pixel counts as badly explained up to this many levels."""
LEAST_NOISE = 0.4
"""Half a grey level is what rounding alone leaves."""
LEAST_BLUR_PX, MOST_BLUR_PX = 0.35, 3.0
START_BLUR_PX, BLUR_SIGMA_PX = 1.1, 0.4
HOLE_STEP_SIGMA, SMALL_RADIUS_PX = 0.3, 10.0
LEAST_AGREE = 0.5
"""Share of the pixels that must agree with the model."""
LEAST_PIXELS = 40
LEVEL_SLOPE = 0.006
"""Levels may slope by about this share of the step in a px (1-sigma)."""
SETTLED_PX = 0.012
"""A step this small ends the search."""
SYSTEMATIC_SIGMA_PX = 0.02
"""Interpolation, demosaicking and JPEG leave about this, whatever the noise."""


@dataclass(frozen=True, slots=True)
class DiscFit:
    """Hold a measured disc: its contour, and its hole's (None without one).

    sigma_px: 1-sigma of each coordinate of the contour's centre, and of the hole's. step: levels by which the disc
    stands above its surroundings; hole_step: by which the hole lies below the disc (0 without one). blur_px: Gaussian
    sigma of the edge; noise: residual scale in levels; agree: share (0..1) of pixels that the model explains; misfit:
    sum of squared residuals in levels, each bounded, for comparing two models of the same pixels. slope: how much the
    disc's brightness changes along its radius, over its step.
    """

    contour: Contour
    hole: Contour | None
    sigma_px: float
    hole_sigma_px: float
    step: float
    hole_step: float
    blur_px: float
    noise: float
    agree: float
    misfit: float
    slope: float


@dataclass(frozen=True, slots=True)
class _Pixels:
    """The chosen pixels: flattened offsets (u, v) from the image's (x0, y0), and brightness, each (N,)."""

    u: Floats
    v: Floats
    level: Floats
    per_flat: Floats  # image px per flattened px across the edge


FLOOR, STEP, BLUR, RADIUS, SIZE, HOLE_SIZE = 0, 3, 6, 7, 12, 4
"""Where each parameter stands in a state: levels outside and the step inwards (constant, along u, along v), blur,
radius, centre (u, v), second harmonic; then the hole's step, radius, centre."""


def measure_disc(
    plane: Plane, disc: Contour, view: View, *, hole: Contour | None = None, usable: Flags, sectors: Flags
) -> DiscFit | None:
    """Measure a disc near `disc` on raw pixels (H, W) float32; None where the model does not fit them.

    hole: a first idea of its hole. usable: (H, W) bool, pixels nothing hides. sectors: (S,) the board angles along
    which the disc's edge shows; elsewhere something else begins there.
    """
    pixels = _choose(plane, disc, hole, view, usable, sectors)
    if pixels is None or pixels.level.size < LEAST_PIXELS:
        return None
    inner = None
    if hole is not None:
        at = view.flattening() @ np.array([hole.x_px - disc.x_px, hole.y_px - disc.y_px])
        inner = Contour(float(at[0]), float(at[1]), hole.radius_px)
    start = _start(pixels, replace(disc, x_px=0.0, y_px=0.0), inner)
    found = None if start is None else _iterate(pixels, start, view)
    if found is None or found[3] < LEAST_AGREE:
        return None
    state, covariance, noise, agree = found
    residual = pixels.level - _linearise(pixels, state)[1]
    contour, bore = _contours(state)
    return DiscFit(
        contour=_in_image(contour, disc, view),
        hole=None if bore is None else _in_image(bore, disc, view),
        sigma_px=_sigma(covariance[RADIUS + 1 : RADIUS + 3, RADIUS + 1 : RADIUS + 3], view),
        hole_sigma_px=0.0 if bore is None else _sigma(covariance[SIZE + 2 :, SIZE + 2 :], view),
        step=float(state[STEP]),
        hole_step=0.0 if bore is None else float(state[SIZE]),
        blur_px=float(state[BLUR]),
        noise=noise,
        agree=agree,
        misfit=float(np.sum(np.minimum(np.square(residual), MOST_MISFIT**2))),
        slope=float(np.hypot(state[FLOOR + 1] + state[STEP + 1], state[FLOOR + 2] + state[STEP + 2]) / state[STEP]),
    )


def _in_image(contour: Contour, disc: Contour, view: View) -> Contour:
    at = view.unflattening() @ np.array([contour.x_px, contour.y_px])
    return replace(contour, x_px=disc.x_px + float(at[0]), y_px=disc.y_px + float(at[1]))


def _sigma(covariance: Floats, view: View) -> float:
    """Return the 1-sigma of each image coordinate of a centre known to `covariance` (2, 2) in flattened px."""
    linear = view.unflattening()
    variance = float(np.trace(linear @ covariance @ linear.T)) / 2.0
    return float(np.sqrt(max(variance, 0.0) + SYSTEMATIC_SIGMA_PX**2))


def _choose(
    plane: Plane, disc: Contour, hole: Contour | None, view: View, usable: Flags, sectors: Flags
) -> _Pixels | None:
    """Pick the pixels near the rim (where it shows) and near the hole."""
    reach = int(1.06 * disc.radius_px + OUTSIDE_PX) + 2
    height, width = plane.shape
    column, row = round(disc.x_px), round(disc.y_px)
    x1, x2 = max(column - reach, 0), min(column + reach + 1, width)
    y1, y2 = max(row - reach, 0), min(row + reach + 1, height)
    if x2 - x1 < 5 or y2 - y1 < 5:
        return None
    linear = view.flattening()
    dx = np.arange(x1, x2, dtype=np.float64)[None, :] - disc.x_px
    dy = np.arange(y1, y2, dtype=np.float64)[:, None] - disc.y_px
    u, v = linear[0, 0] * dx + linear[0, 1] * dy, linear[1, 0] * dx + linear[1, 1] * dy
    rho = np.maximum(np.hypot(u, v), 1e-6)
    c, s = u / rho, v / rho
    off = rho - disc.radius_px - disc.cos2_px * (c * c - s * s) - disc.sin2_px * (2.0 * c * s)
    near = (off < OUTSIDE_PX) & (off > -INSIDE_PX)
    sector = np.floor(np.arctan2(v[near], u[near]) * (sectors.size / (2.0 * np.pi))).astype(np.intp) % sectors.size
    near[near] = sectors[sector]
    edge = np.abs(off) < EDGE_PX
    if hole is not None:
        at = linear @ np.array([hole.x_px - disc.x_px, hole.y_px - disc.y_px])
        from_hole = np.hypot(u - at[0], v - at[1]) - hole.radius_px
        near |= (from_hole < OUTSIDE_PX) & (off < 0.0)
        edge |= np.abs(from_hole) < EDGE_PX
    near &= usable[y1:y2, x1:x2]
    # Of the pixels that only tell of the levels, every other one will do.
    near &= edge | ((np.arange(x1, x2)[None, :] + np.arange(y1, y2)[:, None]) % 2 == 0)
    c, s = c[near], s[near]
    # d(rho)/d(image) across the edge: the flattened pixel is longer along the minor axis.
    slope = np.hypot(linear[0, 0] * c + linear[1, 0] * s, linear[0, 1] * c + linear[1, 1] * s)
    return _Pixels(u[near], v[near], plane[y1:y2, x1:x2][near].astype(np.float64), 1.0 / slope)


def _polar(pixels: _Pixels, contour: Contour) -> tuple[Floats, Floats, Floats]:
    """Return (distance outwards from the contour in image px, cosine, sine of the board angle)."""
    u, v = pixels.u - contour.x_px, pixels.v - contour.y_px
    rho = np.maximum(np.hypot(u, v), 1e-6)
    c, s = u / rho, v / rho
    off = rho - contour.radius_px - contour.cos2_px * (c * c - s * s) - contour.sin2_px * (2.0 * c * s)
    return off * pixels.per_flat, c, s


def _start(pixels: _Pixels, disc: Contour, hole: Contour | None) -> Floats | None:
    """Return the first parameters: levels are what lies clearly inside and outside of the contours."""
    off, _, _ = _polar(pixels, disc)
    inside, outside = off < -1.2, off > 1.2
    hole_step = 0.0
    if hole is not None:
        from_hole, _, _ = _polar(pixels, hole)
        in_hole = from_hole < -0.3 * hole.radius_px
        inside &= from_hole > 0.8
    if np.count_nonzero(inside) < 6 or np.count_nonzero(outside) < 6:
        return None
    level, floor = quantile(pixels.level[inside]), quantile(pixels.level[outside])
    if hole is not None:
        if not in_hole.any():
            return None
        hole_step = level - quantile(pixels.level[in_hole])
    start = np.zeros(SIZE + (HOLE_SIZE if hole else 0))
    start[[FLOOR, STEP, BLUR]] = floor, level - floor, START_BLUR_PX
    start[RADIUS:SIZE] = disc.radius_px, 0.0, 0.0, disc.cos2_px, disc.sin2_px
    if hole is not None:
        start[SIZE:] = hole_step, hole.radius_px, hole.x_px, hole.y_px
    return start if level - floor > 4.0 * LEAST_NOISE else None


def _contours(state: Floats) -> tuple[Contour, Contour | None]:
    radius, x, y, cos2, sin2 = (float(v) for v in state[RADIUS:SIZE])
    disc = Contour(x, y, radius, cos2, sin2)
    if state.size == SIZE:
        return disc, None
    _, hole_radius, hole_x, hole_y = (float(v) for v in state[SIZE:])
    # Seen through the same camera, the hole is an ellipse of the same shape.
    share = hole_radius / radius
    return disc, Contour(hole_x, hole_y, hole_radius, share * cos2, share * sin2)


def _linearise(pixels: _Pixels, state: Floats) -> tuple[Floats, Floats]:
    """Return (design (N, P), model (N,)) at a state."""
    disc, hole = _contours(state)
    from scipy.special import ndtr  # noqa: PLC0415  # a third of what a start would load, see `vision.warm`

    blur = float(state[BLUR])
    off, c, s = _polar(pixels, disc)
    along, across = pixels.u / disc.radius_px, pixels.v / disc.radius_px
    cover, edge = ndtr(-off / blur), _bell(off, blur)
    step = state[STEP] + state[STEP + 1] * along + state[STEP + 2] * across
    model = state[FLOOR] + state[FLOOR + 1] * along + state[FLOOR + 2] * across + step * cover
    rise = step * edge
    design = np.empty((state.size, off.size))
    design[FLOOR], design[FLOOR + 1], design[FLOOR + 2] = 1.0, along, across
    design[STEP], design[STEP + 1], design[STEP + 2] = cover, along * cover, across * cover
    design[BLUR] = rise * off / blur
    rise = rise * pixels.per_flat
    design[RADIUS], design[RADIUS + 1], design[RADIUS + 2] = rise, rise * c, rise * s
    design[RADIUS + 3], design[RADIUS + 4] = rise * (c * c - s * s), rise * (2.0 * c * s)
    if hole is not None:
        off, c, s = _polar(pixels, hole)
        cover, edge = ndtr(-off / blur), -float(state[SIZE]) * _bell(off, blur)
        model -= state[SIZE] * cover
        design[BLUR] += edge * off / blur
        edge *= pixels.per_flat
        design[SIZE], design[SIZE + 1], design[SIZE + 2], design[SIZE + 3] = -cover, edge, edge * c, edge * s
    return design, model


def _bell(off: Floats, blur: float) -> Floats:
    return np.asarray(np.exp(-0.5 * np.square(off / blur)) * (0.3989422804 / blur))


def _iterate(pixels: _Pixels, start: Floats, view: View) -> tuple[Floats, Floats, float, float] | None:
    """Return (state, covariance, noise, share of pixels that agree), or None where the model does not hold."""
    state, believed, pull = start, np.zeros_like(start), np.zeros_like(start)
    believed[BLUR] = START_BLUR_PX
    pull[RADIUS + 3 : SIZE] = (view.shape_sigma * start[RADIUS]) ** -2
    # Levels slope a little, and the blur is that of a lens in focus.
    pull[[FLOOR + 1, FLOOR + 2, STEP + 1, STEP + 2]] = (LEVEL_SLOPE * start[RADIUS] * start[STEP]) ** -2
    pull[BLUR] = BLUR_SIGMA_PX**-2
    if start.size > SIZE and start[RADIUS] < SMALL_RADIUS_PX:
        # A hole is as dark as the board or darker; with a blur of its own size it cannot say so for itself.
        believed[SIZE], pull[SIZE] = start[STEP], (HOLE_STEP_SIGMA * start[STEP]) ** -2
    weights, noise = np.ones_like(pixels.level), 1.0
    normal = np.eye(state.size)
    for turn in range(ROUNDS):
        design, model = _linearise(pixels, state)
        residual = pixels.level - model
        noise = mad_sigma(residual, LEAST_NOISE)
        # The first model is a rough one: what it does not explain need not be dirt.
        weights = tukey(residual, noise * (1.0 if turn else 1.5))
        weighted = design * weights
        normal = weighted @ design.T
        normal.flat[:: state.size + 1] += noise**2 * pull + 1e-9
        step = solve_normal(normal, weighted @ residual + noise**2 * pull * (believed - state))
        state = state + step
        if not _plausible(state, start):
            return None
        if turn and float(np.abs(step[RADIUS : RADIUS + 3]).max()) < SETTLED_PX:
            break
    return state, np.asarray(np.linalg.inv(normal) * noise**2), noise, float(np.mean(weights > 0.3))


def _plausible(state: Floats, start: Floats) -> bool:
    """Tell whether a fit still describes what it began with."""
    if not np.isfinite(state).all() or state[STEP] <= 0.0 or not LEAST_BLUR_PX < state[BLUR] < MOST_BLUR_PX:
        return False
    moved = np.abs(state[RADIUS : RADIUS + 3] - start[RADIUS : RADIUS + 3])
    if moved.max() > 1.0 + 0.06 * start[RADIUS]:
        return False
    if state.size == SIZE:
        return True
    hole_moved = np.abs(state[SIZE + 1 :] - start[SIZE + 1 :])
    near = hole_moved.max() < 1.5 + 0.2 * start[SIZE + 1]
    return bool(near and state[SIZE] > 0.0 and 0.7 < state[SIZE + 1] < 0.9 * state[RADIUS])
