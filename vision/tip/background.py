"""Background of the probe: what it does to the probe's edges; it may be darker than the metal, or brighter.

An edge is where the image is steepest. The metal's own light changes from the edge inwards, which moves that place by
g s^2 / A: g the slope of the metal's light next to the edge, A the step from the ground up to the metal, s the blur.
Its sign turns with the step's: before a dark ground, where the probe was taught, the place lies inside the edge when
the metal grows brighter inwards, before a ground brighter than the metal outside of it. Where the ground is as bright
as the metal there is no edge, whatever is found there: such a row counts neither for nor against.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vision.core import Floats, Plane
from vision.tip.edges import EdgePoints
from vision.tip.silhouette import Silhouette
from vision.tip.strip import ProbeStrip, upper_median

INSIDE_PX, FURTHER_PX = 4, 2
"""How far inside the edge the metal's own slope is read, clear of the blurred step, and how much further once more: a
slope that grows inwards belongs to a highlight and says little of the edge."""
LEAST_HALF_PX, LEAST_ROWS = 9.0, 3
"""Rows narrower than this (half width) have no place to read it; theirs follows from the wider ones'."""
BLUR_PX = 1.35
"""Lens (1 px), smoothing across and sampling together, and the peak of a unit step's slope when blurred by it."""
STEEPEST = 0.4 / BLUR_PX
TAUGHT_GROUND = 0.25
"""The ground of the taught image, as a share of the metal next to the edge."""
MOST_SHIFT_PX = 1.2
OUTSIDE_PX, SAME_LEVEL = 5.0, 0.2
"""How far outside the edge the ground is read. Within this share of the metal's level it is as bright as the metal."""
STRONG_STEP = 0.35
"""An edge with so large a step, as a share of the metal's level, is one whatever lies further out."""
LEAST_TOLD = 0.35
"""So much of cylinder and of taper (0..1) has to stand before something else, or the ground is no excuse."""


def corrected(strip: ProbeStrip, slope: Plane, points: EdgePoints, line: tuple[float, float]) -> EdgePoints:
    """Return the points with edges that darken inwards put where they would be before a dark ground.

    line: the axis (a, b) the points lie about. The metal's slope is that of both sides together: a highlight nearer to
    one edge than to the other must not draw the axis aside.
    """
    darkens = ~points.brightens
    shift = np.zeros(points.u_px.size)
    rows = np.rint(points.u_px).astype(np.intp) - strip.u_from_px
    half = np.abs(points.v_px - line[0] - line[1] * points.u_px)
    for part in (points.on_taper, ~points.on_taper):
        own = darkens & part
        wide = own & (half > LEAST_HALF_PX)
        if np.count_nonzero(wide) < LEAST_ROWS:
            continue
        side = points.side[wide]
        at = np.rint(points.v_px[wide] - side * INSIDE_PX).astype(np.intp) + strip.reach_px
        further = at - np.rint(side * FURTHER_PX).astype(np.intp)
        growth = _growth(*(upper_median(-side * half[wide] * slope[rows[wide], column]) for column in (at, further)))
        metal = upper_median(strip.pixels[rows[wide], at])
        before_dark = (1.0 - TAUGHT_GROUND) * max(metal, 1.0)
        shift[own] = growth / half[own] * BLUR_PX**2 * (STEEPEST / points.strength[own] + 1.0 / before_dark)
    shift = np.clip(shift, -MOST_SHIFT_PX, MOST_SHIFT_PX)
    return replace(points, v_px=points.v_px - points.side * shift)


def _growth(near: float, further: float) -> float:
    """Return the metal's slope at the edge from that at two places inside of it; none where it grows inwards."""
    return near * float(np.clip(2.0 - further / near, 0.0, 1.0)) if near else 0.0


def without_blind(
    strip: ProbeStrip, points: EdgePoints, outline: Silhouette, line: tuple[float, float], wider_px: tuple[float, float]
) -> EdgePoints:
    """Return the points, and how many were looked for, without the rows whose ground is as bright as the metal.

    line, wider_px: where the outline lies, as in `edge_points`. A row with a strong edge stays: something else lies
    between. Where nearly all of the cylinder or of the taper would be left out, nothing is: what cannot be seen is not
    taken for the probe.
    """
    row = np.minimum(np.searchsorted(outline.u_px, points.u_px), outline.u_px.size - 1)
    gone, left_out = np.zeros(points.u_px.size, dtype=bool), np.zeros(2, dtype=int)
    for side, edge in ((-1.0, outline.left_px), (1.0, outline.right_px)):
        if side == outline.dim_side:
            continue
        grown = edge + side * np.where(outline.on_taper, wider_px[1], wider_px[0])
        blind, metal = _blind(strip, outline, line, grown, side)
        strong = (points.side == side) & (points.strength > STRONG_STEP * metal * STEEPEST)
        blind[row[strong]] = False
        gone |= (points.side == side) & blind[row]
        left_out += np.array([np.count_nonzero(blind & ~outline.on_taper), np.count_nonzero(blind & outline.on_taper)])
    offered = np.array([points.offered - points.offered_on_taper, points.offered_on_taper])
    told = offered - left_out
    if np.any(told < LEAST_TOLD * offered):
        return points
    return points.where(~gone, int(told.sum()), int(told[1]))


def _blind(
    strip: ProbeStrip, outline: Silhouette, line: tuple[float, float], edge_px: Floats, side: float
) -> tuple[NDArray[np.bool_], float]:
    """Return at which of the outline's rows (N,) the ground is as bright as the cylinder's metal, and that level."""
    rows = np.rint(outline.u_px).astype(np.intp) - strip.u_from_px
    inside = (rows >= 0) & (rows < strip.pixels.shape[0])
    rows = np.clip(rows, 0, strip.pixels.shape[0] - 1)
    at = line[0] + line[1] * outline.u_px + edge_px + strip.reach_px
    last = strip.pixels.shape[1] - 1

    def levels(off_edge_px: float) -> Plane:
        columns = np.clip(np.rint(at + side * off_edge_px).astype(np.intp), 1, last - 1)
        near = strip.pixels[rows[:, None], columns[:, None] + np.arange(-1, 2)]
        return np.asarray(near.mean(axis=1), dtype=np.float32)

    metal = upper_median(levels(-float(INSIDE_PX))[inside & ~outline.on_taper])
    same = np.abs(levels(OUTSIDE_PX) - metal) < SAME_LEVEL * metal
    return np.asarray(inside & same, dtype=np.bool_), metal
