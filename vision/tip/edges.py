"""Edges of the probe to a fraction of a pixel, and the fit of the axis through all of them at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.core import Floats, Plane, mad_sigma, refine_peaks, tukey
from vision.tip.silhouette import Silhouette
from vision.tip.strip import ProbeStrip

ROUNDS = 8
ENOUGH_AGREE, BETTER_SHARE = 0.75, 0.1
"""A fit this share of the points agree with needs no other start; another start has to bring so much more of them into
agreement."""
SCALE_FLOOR_PX, SCALE_CEILING_PX = 0.03, 0.35
WIDTH_SIGMA_PX, TAPER_SIGMA_PX = 0.4, 0.06
"""How much wider the taught probe may look, by light and blur, and how much more so its taper, 1-sigma. The second
belief is firm: a highlight within the taper, before a pad as bright as metal, passes for a narrower taper."""
STRAIGHT_SIGMA_PX = 0.1
"""A probe that is not bent turns its taper by no more than this over its length."""


@dataclass(frozen=True, slots=True)
class EdgePoints:
    """Hold edge points in strip coordinates (N,): `side` is +1 for v > 0 (L2), -1 for v < 0 (L1).

    `taught_px`: the edge's taught v from the axis at that row. `brightens` (N,) bool: brighter inwards, as before a
    dark ground; before something brighter than the metal the steepest place lies up to half a pixel elsewhere.
    strength: its slope (N,), levels per px. offered: how many calipers looked for an edge.
    """

    u_px: Floats
    v_px: Floats
    side: Floats
    taught_px: Floats
    on_taper: NDArray[np.bool_]
    brightens: NDArray[np.bool_]
    strength: Floats
    offered: int
    offered_on_taper: int

    def where(self, keep: NDArray[np.bool_], offered: int, offered_on_taper: int) -> EdgePoints:
        """Return the points `keep` (N,) says, found by so many calipers."""
        u, v, side, taught = self.u_px[keep], self.v_px[keep], self.side[keep], self.taught_px[keep]
        on_taper, brightens, strength = self.on_taper[keep], self.brightens[keep], self.strength[keep]
        return EdgePoints(
            u_px=u,
            v_px=v,
            side=side,
            taught_px=taught,
            on_taper=on_taper,
            brightens=brightens,
            strength=strength,
            offered=offered,
            offered_on_taper=offered_on_taper,
        )


@dataclass(frozen=True, slots=True)
class ProbeAxis:
    """Hold the fitted bisector v = a + b u with covariance (2, 2), the change of half widths, the edge support.

    bend_px: how far, at the end, the taper lies from where the cylinder points, with its 1-sigma. taper_sigma_px: that
    of how much wider the taper is than the cylinder.
    """

    a_px: float
    b: float
    covariance: Floats
    taper_wider_px: float
    cylinder_wider_px: float
    bend_px: float
    bend_sigma_px: float
    taper_sigma_px: float
    support: float
    scale_px: float
    weights: Floats

    def v_px(self, u_px: float) -> float:
        """Return the axis' place across the strip at `u_px`."""
        return self.a_px + self.b * u_px


def edge_points(
    strip: ProbeStrip,
    slope: Plane,
    outline: Silhouette,
    axis: tuple[float, float],
    wider_px: tuple[float, float],
    reach_px: int,
    *,
    either_way: bool = False,
) -> EdgePoints:
    """Return the sub-pixel edge points near the outline placed on `axis` (a, b) and grown by (cylinder, taper).

    Edges that brighten inwards, or, `either_way`, edges of both signs (a bright pad may lie behind the probe). The
    outline's dim side has none.
    """
    rows = np.rint(outline.u_px).astype(np.intp) - strip.u_from_px
    inside = (rows >= 0) & (rows < slope.shape[0])
    rows, u, on_taper = rows[inside], outline.u_px[inside], outline.on_taper[inside]
    count = rows.size
    side = np.repeat([-1.0, 1.0], count)
    taught = np.concatenate([outline.left_px[inside], outline.right_px[inside]])
    wider = np.tile(np.where(on_taper, wider_px[1], wider_px[0]), 2)
    inwards = np.concatenate([slope[rows], -slope[rows]])
    # Before a pad brighter than the metal the same edge darkens inwards; it counts, but less.
    wanted = np.maximum(inwards, -0.7 * inwards) if either_way else inwards
    expected = axis[0] + axis[1] * np.tile(u, 2) + taught + side * wider
    centre = np.rint(expected).astype(np.intp) + strip.reach_px
    centre = np.clip(centre, reach_px + 1, slope.shape[1] - reach_px - 2)
    index = np.arange(2 * count)
    part = wanted[index[:, None], centre[:, None] + np.arange(-reach_px, reach_px + 1)]
    peak = np.argmax(part, axis=1)
    at = centre + peak - reach_px
    good = (part[index, peak] > 0.4 * strip.edge_level) & (peak > 0) & (peak < 2 * reach_px)
    sides = 2
    if outline.dim_side:
        sides, good = 1, good & (side != outline.dim_side)
    v = refine_peaks(wanted[good], at[good]) - strip.reach_px
    brightens = (inwards[index, at] > 0.0)[good]
    return EdgePoints(
        u_px=np.tile(u, 2)[good],
        v_px=v,
        side=side[good],
        taught_px=taught[good],
        on_taper=np.tile(on_taper, 2)[good],
        brightens=brightens,
        strength=np.abs(inwards[index, at])[good].astype(np.float64),
        offered=sides * count,
        offered_on_taper=sides * int(np.count_nonzero(on_taper)),
    )


def fit_axis(
    points: EdgePoints, pivot_u_px: float, *, straight: bool = True, same_width: bool = True
) -> ProbeAxis | None:
    """Fit the bisector, the change of both half widths and the taper's turn to all points; None when too few agree.

    pivot_u_px: where the taper turns. straight: believe that it hardly does; otherwise the turn is free. same_width:
    believe that the taper is as wide as taught, but for the light; otherwise its width is free. The fit starts from the
    cylinder's points, from all and from the taper's, and the start with clearly the most agreement wins, the earlier
    one in doubt: clutter behind one part of the probe does not draw the axis away from the other.
    """
    if points.u_px.size < 10:
        return None
    on_taper = points.on_taper.astype(np.float64)
    design = np.stack(
        [
            np.ones_like(on_taper),
            points.u_px / 100.0,
            points.side,
            points.side * on_taper,
            on_taper * (points.u_px / -pivot_u_px + 1.0),
        ],
        axis=1,
    )
    bend_sigma, taper_sigma = STRAIGHT_SIGMA_PX if straight else 1e3, TAPER_SIGMA_PX if same_width else 1e3
    pull = np.array([0.0, 0.0, WIDTH_SIGMA_PX**-2, taper_sigma**-2, bend_sigma**-2])
    target = points.v_px - points.taught_px
    best: _Fit | None = None
    for start in (1.001 - on_taper, np.ones_like(on_taper), on_taper + 1e-3):
        fit = _robust(design, target, pull, start)
        if best is None or np.sum(fit.weights) > np.sum(best.weights) + BETTER_SHARE * on_taper.size:
            best = fit
        if np.mean(fit.weights > 0.3) > ENOUGH_AGREE:
            break
    if best is None or np.count_nonzero(best.weights > 0.3) < 8:
        return None
    return _axis_of(best, points)


@dataclass(frozen=True, slots=True)
class _Fit:
    parameters: Floats
    covariance: Floats
    weights: Floats
    scale: float


def _robust(design: Floats, target: Floats, pull: Floats, weights: Floats) -> _Fit:
    """Solve design @ p = target by least squares with Tukey weights until it settles; pull: 1 / sigma^2 of a prior."""
    parameters, scale = np.full(design.shape[1], np.inf), 1.0
    size = design.shape[1]
    normal = np.eye(size)
    for turn in range(ROUNDS):
        weighted = design.T * weights
        normal = weighted @ design
        normal.flat[:: size + 1] += pull * scale**2 + 1e-9
        before, parameters = parameters, np.linalg.solve(normal, weighted @ target)
        residual = target - design @ parameters
        kept = residual[weights > 0.1]
        scale = mad_sigma(kept if kept.size > size else residual, SCALE_FLOOR_PX)
        scale = max(min(scale, SCALE_CEILING_PX * max(6 - turn, 1)), SCALE_FLOOR_PX)
        weights = tukey(residual, scale)
        if turn >= 5 or (turn >= 2 and np.max(np.abs(parameters - before)) < 0.01):
            break
    return _Fit(parameters, np.asarray(np.linalg.inv(normal) * scale**2), weights, scale)


def _axis_of(fit: _Fit, points: EdgePoints) -> ProbeAxis:
    scaling = np.diag([1.0, 0.01])
    a, b, wider, taper, bend = (float(number) for number in fit.parameters)
    return ProbeAxis(
        a_px=a,
        b=b / 100.0,
        covariance=np.asarray(scaling @ fit.covariance[:2, :2] @ scaling),
        taper_wider_px=wider + taper,
        cylinder_wider_px=wider,
        bend_px=bend,
        bend_sigma_px=float(np.sqrt(fit.covariance[4, 4])),
        taper_sigma_px=float(np.sqrt(fit.covariance[3, 3])),
        support=float(np.count_nonzero(fit.weights > 0.3)) / max(points.offered, 1),
        scale_px=fit.scale,
        weights=fit.weights,
    )
