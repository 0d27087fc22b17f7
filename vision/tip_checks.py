"""Is the measured needle the taught one? Each check finds out something that would make a wrong tip look right."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import theilslopes

from vision.caliper import Floats
from vision.image import Plane
from vision.tip_strip import Axis, EdgePoints, NeedleShape, Rim, Strip, caliper_rows, fit_axis

# An edge point lies on the silhouette within this.
ON_SILHOUETTE_PX = 0.8
# Edge points a side of taper or cylinder needs before its own width means something.
LEAST_SIDE_POINTS = 8
# Turns of the taper that are tried, and up to which it counts as straight.
TURNS_DEG = tuple(float(d) for d in np.arange(-10.0, 10.1, 0.5))
STRAIGHT_DEG = 1.5


def side_shares(points: EdgePoints, axis: Axis, shape: NeedleShape) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the share (0..1) of calipers whose edge lies on the fit: cylinder (L1, L2), taper (L1, L2)."""
    above = points.u_px < -shape.end_to_rim_px
    wider = np.where(above, axis.cylinder_wider_px, axis.taper_wider_px)
    expected = axis.a_px + axis.b * points.u_px + points.side * (shape.half_width(points.u_px) + wider)
    near = np.abs(points.v_px - expected) < ON_SILHOUETTE_PX
    taper, cylinder = caliper_rows(shape)

    def share(part: NDArray[np.bool_], side: float, offered: int) -> float:
        return float(np.count_nonzero(near & part & (points.side == side))) / offered

    return (
        (share(above, -1.0, cylinder.size), share(above, 1.0, cylinder.size)),
        (share(~above, -1.0, taper.size), share(~above, 1.0, taper.size)),
    )


def metal_beyond(strip: Strip, axis: Axis, shape: NeedleShape) -> float:
    """Return along how much (0..1) of the needle it is as bright outside as the metal is, on the worse side.

    A thicker needle whose highlight was taken for an edge does that all along, beside its cylinder and beside the thick
    half of its taper. A pad or lettering behind it may do so beside one of them.
    """
    taper, cylinder = caliper_rows(shape)
    thick_half = taper[taper < -0.5 * shape.end_to_rim_px]
    return max(
        min(
            _bright_beside(strip, axis, shape.cylinder_half_px + axis.cylinder_wider_px, cylinder, side),
            _bright_beside(strip, axis, shape.half_width(thick_half) + axis.taper_wider_px, thick_half, side),
        )
        for side in (-1.0, 1.0)
    )


def _bright_beside(strip: Strip, axis: Axis, half_px: Floats | float, u_px: Floats, side: float) -> float:
    """Return along how many of the rows `u_px` it is as bright just outside the silhouette as just inside."""
    rows = np.rint(u_px).astype(np.intp) - strip.u_from_px
    keep = (rows >= 0) & (rows < strip.pixels.shape[0])
    half = np.broadcast_to(np.asarray(half_px, dtype=np.float64), u_px.shape)

    def levels(off_axis: Floats) -> Plane:
        columns = np.rint(axis.a_px + axis.b * u_px + off_axis).astype(np.intp) + strip.reach_px
        columns = np.clip(columns, 0, strip.pixels.shape[1] - 1)
        return np.asarray(strip.pixels[rows[keep], columns[keep]], dtype=np.float32)

    metal = min(float(np.median(levels(half - 3.0))), float(np.median(levels(3.0 - half))))
    return float(np.mean(levels(side * (half + 4.0)) > 0.75 * metal))


def turned_taper(strip: Strip, slope: Plane, axis: Axis, shape: NeedleShape) -> tuple[float, float, float]:
    """Return (degrees, shown there, shown straight): the turn about the marking at which the taper's edges show best.

    shown: share (0..1) of rows with an edge on both sides of the taper at once. A bent needle shows its edges away from
    where its cylinder points; a busy background hides them without showing such a pair elsewhere.
    """
    u, _ = caliper_rows(shape)
    rows = np.rint(u).astype(np.intp) - strip.u_from_px
    strength = np.abs(slope[rows])
    peaks = (strength >= cv2.dilate(strength, np.ones((1, 5), dtype=np.uint8))) & (strength > strip.edge_level)
    shown = cv2.dilate(peaks.astype(np.uint8), np.ones((1, 3), dtype=np.uint8)) > 0
    index, last = np.arange(u.size), shown.shape[1] - 1
    scores: dict[float, float] = {}
    for degrees in TURNS_DEG:
        middle = axis.a_px + axis.b * u + np.tan(np.radians(degrees)) * (u + shape.end_to_rim_px)
        sides = [np.rint(middle + side * shape.half_width(u)).astype(np.intp) + strip.reach_px for side in (-1.0, 1.0)]
        both = shown[index, np.clip(sides[0], 0, last)] & shown[index, np.clip(sides[1], 0, last)]
        scores[degrees] = float(np.mean(both))
    straight = max(score for degrees, score in scores.items() if abs(degrees) <= STRAIGHT_DEG)
    best = max((d for d in scores if abs(d) > STRAIGHT_DEG), key=lambda d: scores[d])
    return best, scores[best], straight


def consistency(points: EdgePoints, axis: Axis, rim2: Rim, shape: NeedleShape) -> tuple[float, float]:
    """Return (bend, moved) in px, each 0 where clutter leaves it unknown.

    bend: how far, at the end, the taper lies from where the cylinder points. moved: how far the marking lies from where
    it was taught, by the taper's width, which tells for itself where the end is. Half a pixel of width are 3 px of
    place, so only edges before a background darker than the metal count. Both sides must say it: a bend or a moved
    marking shows on both, a line of silkscreen beside the needle on one.
    """
    points = points.where(points.brightens, points.offered)
    above = points.u_px < -shape.end_to_rim_px
    own_axes: list[Axis] = []
    for own in (~above, above):
        if min(np.count_nonzero(own & (points.side == side)) for side in (-1.0, 1.0)) < LEAST_SIDE_POINTS:
            return 0.0, 0.0
        line = fit_axis(points.where(own, int(np.count_nonzero(own))), shape, free_width=True)
        if line is None or line.support < 0.75 or line.covariance[0, 0] > 0.1:
            return 0.0, 0.0
        own_axes.append(line)
    beyond = points.side * (points.v_px - axis.a_px - axis.b * points.u_px) - shape.half_width(points.u_px)
    expected = rim2.u_px + shape.end_to_rim_px
    moved = _both_say([_moved(beyond, points.side == side, above, shape) - expected for side in (-1.0, 1.0)])
    bend = _both_say([_bend(points, ~above & (points.side == side), own_axes[1], shape) for side in (-1.0, 1.0)])
    return bend, moved


def _both_say(sides: list[float]) -> float:
    """Return what both sides of the needle agree on: the smaller of two numbers of one sign, else 0."""
    return min(sides, key=abs) if sides[0] * sides[1] > 0.0 else 0.0


def _bend(points: EdgePoints, own: NDArray[np.bool_], cylinder: Axis, shape: NeedleShape) -> float:
    """Return how far, at the end, one side of the taper lies from where the cylinder's axis puts it, px."""
    u, side = points.u_px[own], points.side[own]
    off = points.v_px[own] - cylinder.a_px - cylinder.b * u - side * shape.half_width(u)
    return float(theilslopes(off, u).intercept)


def _moved(beyond: NDArray[np.float64], side: NDArray[np.bool_], above: NDArray[np.bool_], shape: NeedleShape) -> float:
    """Return how far along the needle one side of the taper is off its taught place, px.

    A brighter background or more blur makes taper and cylinder look narrower alike: the cylinder tells by how much.
    """
    wider = float(np.median(beyond[side & ~above]) - np.median(beyond[side & above]))
    return wider / shape.taper_slope
