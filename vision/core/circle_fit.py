"""Ellipse fit to edge points: whether one ellipse lies on them, and along how much of its contour.

The camera looks obliquely, so a circle on the board is an ellipse. All radii here are semi-major; angles go round in
the plane of the board, so that an undistorted pad is a constant radius plus a small second harmonic. What is taken is
afterwards measured on the pixels themselves (`pads.disc_fit`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.core.caliper import Floats, robust_fit
from vision.core.edges import Edgels
from vision.core.view import View, ellipse_of

Flags = NDArray[np.bool_]
LEAST_POINTS, LEAST_FOR_FOURTH = 8, 16
LEAST_LENGTH, LEAST_FOR_SHAPE = 0.3, 0.65
"""Fewer edge points than this share of a contour's length are not worth a fit; a shape is asked of rounder things
only."""
LEAST_COVERAGE = 0.35
NEAR_PX, NEAR_SHARE, MOST_NEAR_PX = 0.35, 0.05, 0.8
"""An edge this near the fit lies on it: small circles must not be met by the bends and corners of strokes."""
LEAST_AIM = 0.75
"""An edge belongs to the contour if its slope points at the centre to this (cosine)."""
ROUNDS = 3
NOTHING_HIDDEN: Flags = np.zeros((0, 0), dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class Contour:
    """Hold an ellipse as the view's circle with a second harmonic.

    At board angle phi it lies radius_px + cos2_px cos(2 phi) + sin2_px sin(2 phi) from (x_px, y_px).
    """

    x_px: float
    y_px: float
    radius_px: float
    cos2_px: float = 0.0
    sin2_px: float = 0.0

    def ellipse(self, view: View) -> tuple[float, float, float]:
        """Return (semi-major px, minor over major, direction of the minor axis in rad) in the image."""
        size, turn = math.hypot(self.cos2_px, self.sin2_px), 0.5 * math.atan2(self.sin2_px, self.cos2_px)
        c, s = math.cos(turn), math.sin(turn)
        one, other = self.radius_px + size, self.radius_px - size
        return ellipse_of(view.unflattening() @ np.array([[c * one, -s * other], [s * one, c * other]]))


@dataclass(frozen=True, slots=True)
class CircleFit:
    """Hold a fitted circle as seen: its ellipse, and how far it can be trusted.

    x_px, y_px: centre; radius_px: semi-major; ratio: minor over major axis; minor_rad: direction of the minor axis;
    sigma_px: 1-sigma of each coordinate of the centre. visible: share of the contour that nothing hides (0..1).
    coverage: share of the visible contour with an edge on the fit (0..1). squareness: amplitude of the contour's fourth
    harmonic as a share of the radius (a square's is 0.08, a disc's 0). noise: residual scale as a share of the step, 0
    until measured on the pixels. sectors: (S,) along which board angles the edge shows. contour: the same ellipse in
    the view's terms.
    """

    x_px: float
    y_px: float
    radius_px: float
    ratio: float
    minor_rad: float
    sigma_px: float
    visible: float
    coverage: float
    squareness: float
    noise: float
    sectors: Flags
    contour: Contour


@dataclass(frozen=True, slots=True)
class _Ring:
    """Edge points about a contour's centre: board angle, distance from the contour (outwards), each (N,)."""

    cosine: Floats
    sine: Floats
    off_px: Floats

    def design(self) -> Floats:
        c, s = self.cosine, self.sine
        return np.stack([np.ones_like(c), c, s, c * c - s * s, 2.0 * c * s], axis=1)


def fit_circle(
    edgels: Edgels,
    seed: Contour,
    view: View,
    *,
    shape: tuple[int, int],
    reach_px: float,
    bright_inside: bool = True,
    hidden: Flags = NOTHING_HIDDEN,
    maybe_hidden: Flags = NOTHING_HIDDEN,
) -> CircleFit | None:
    """Fit an ellipse to the edge points near a seed; None when too few lie on one.

    shape: (H, W) of the image. reach_px: how far from the seed edges are looked for at first. hidden: (H, W) bool,
    what the probe covers. maybe_hidden: where something may stand in front: contour without an edge there does not
    count as visible. A size of zero means nothing is hidden.
    """
    contour, sigma = seed, 0.0
    prior = np.array([np.inf, np.inf, np.inf, view.shape_sigma * seed.radius_px, view.shape_sigma * seed.radius_px])
    ring = _ring(edgels, contour, view, reach_px, bright_inside)
    if ring.off_px.size < LEAST_LENGTH * 2.0 * np.pi * seed.radius_px:
        return None
    for turn in range(ROUNDS):
        if ring.off_px.size < LEAST_POINTS:
            return None
        here = np.array([0.0, 0.0, 0.0, contour.cos2_px, contour.sin2_px])
        target = ring.off_px + ring.design()[:, 3:] @ here[3:]
        fit = robust_fit(
            ring.design(), target, prior, floor=0.05, ceiling=max(0.3, 0.02 * seed.radius_px), rounds=2 + (turn == 0)
        )
        moved = view.unflattening() @ fit.parameters[1:3]
        contour = Contour(
            contour.x_px + float(moved[0]),
            contour.y_px + float(moved[1]),
            contour.radius_px + float(fit.parameters[0]),
            float(fit.parameters[3]),
            float(fit.parameters[4]),
        )
        away = np.hypot(contour.x_px - seed.x_px, contour.y_px - seed.y_px)
        if contour.radius_px < 1.0 or away > 2.0 * reach_px or not np.isfinite(away):
            return None
        # Neighbouring edge points share pixels and blur: half of them count as independent.
        sigma = float(np.sqrt(fit.covariance[1, 1] + fit.covariance[2, 2]))
        reach = max(reach_px / (2.0 + turn), 1.6)
        ring = _ring(edgels, contour, view, reach, bright_inside)
        if float(np.hypot(*moved)) + abs(float(fit.parameters[0])) < 0.15:
            break
    return _judge(contour, ring, view, shape, sigma, hidden, maybe_hidden)


def _ring(edgels: Edgels, contour: Contour, view: View, reach_px: float, bright_inside: bool) -> _Ring:  # noqa: FBT001
    """Return the edge points within `reach_px` of a contour that face its centre (or away from it)."""
    linear = view.flattening()
    dx, dy = edgels.x_px - contour.x_px, edgels.y_px - contour.y_px
    limit = contour.radius_px + reach_px + abs(contour.cos2_px) + abs(contour.sin2_px)
    near = (np.abs(dx) < limit) & (np.abs(dy) < limit)
    dx, dy = dx[near], dy[near]
    u, v = linear[0, 0] * dx + linear[0, 1] * dy, linear[1, 0] * dx + linear[1, 1] * dy
    rho = np.maximum(np.hypot(u, v), 1e-6)
    c, s = u / rho, v / rho
    off = rho - contour.radius_px - contour.cos2_px * (c * c - s * s) - contour.sin2_px * (2.0 * c * s)
    aim = edgels.toward_x[near] * dx + edgels.toward_y[near] * dy
    facing = (-aim if bright_inside else aim) > LEAST_AIM * np.hypot(dx, dy)
    good = facing & (np.abs(off) < reach_px)
    return _Ring(*(np.asarray(part[good], dtype=np.float64) for part in (c, s, off)))


def _judge(
    contour: Contour,
    ring: _Ring,
    view: View,
    shape: tuple[int, int],
    sigma: float,
    hidden: Flags,
    maybe_hidden: Flags,
) -> CircleFit | None:
    """Return the circle with the shares of its contour that can be seen and that are."""
    sectors = min(max(int(3.2 * contour.radius_px), 16), 72)
    near = np.abs(ring.off_px) < min(NEAR_PX + NEAR_SHARE * contour.radius_px, MOST_NEAR_PX)
    angle = np.arctan2(ring.sine[near], ring.cosine[near]) * (sectors / (2.0 * np.pi))
    shown = np.zeros(sectors, dtype=np.bool_)
    shown[np.floor(angle).astype(np.intp) % sectors] = True
    # A single empty sector between two shown ones is only the spacing of pixels.
    shown |= np.roll(shown, 1) & np.roll(shown, -1)
    phi: Floats = (np.arange(sectors, dtype=np.float64) + 0.5) * (2.0 * np.pi / sectors)
    radius = contour.radius_px + contour.cos2_px * np.cos(2.0 * phi) + contour.sin2_px * np.sin(2.0 * phi)
    xs, ys = view.to_image(contour.x_px, contour.y_px, radius, phi)
    columns, rows = np.rint(xs).astype(np.intp), np.rint(ys).astype(np.intp)
    seen = (columns >= 1) & (rows >= 1) & (columns < shape[1] - 1) & (rows < shape[0] - 1)
    at = rows.clip(0, shape[0] - 1), columns.clip(0, shape[1] - 1)
    if hidden.size:
        seen &= ~hidden[at]
    if maybe_hidden.size:
        seen &= shown | ~maybe_hidden[at]
    visible = int(np.count_nonzero(seen))
    shown &= seen
    coverage = float(np.count_nonzero(shown)) / max(visible, 1)
    if coverage < LEAST_COVERAGE or np.count_nonzero(shown) < LEAST_POINTS // 2:
        return None
    semi_major, ratio, minor = contour.ellipse(view)
    return CircleFit(
        x_px=contour.x_px,
        y_px=contour.y_px,
        radius_px=semi_major,
        ratio=ratio,
        minor_rad=minor,
        sigma_px=float(np.hypot(sigma, 0.03)),
        visible=visible / sectors,
        coverage=coverage,
        squareness=_squareness(ring, contour) if coverage >= LEAST_FOR_SHAPE else 0.0,
        noise=0.0,
        sectors=shown,
        contour=contour,
    )


def _squareness(ring: _Ring, contour: Contour) -> float:
    """Return the amplitude of the fourth harmonic of the edge points about a contour, over its radius."""
    if ring.off_px.size < LEAST_FOR_FOURTH:
        return 0.0
    angle = 4.0 * np.arctan2(ring.sine, ring.cosine)
    design = np.concatenate([ring.design(), np.cos(angle)[:, None], np.sin(angle)[:, None]], axis=1)
    fit = robust_fit(design, ring.off_px, floor=0.1, rounds=2)
    return float(np.hypot(fit.parameters[5], fit.parameters[6])) / contour.radius_px
