"""Is the measured needle the taught one? Each check finds out something that would make a wrong tip look right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.image import Plane
from vision.tip_strip import Axis, EdgePoints, NeedleShape, Rim, Strip, caliper_rows, fit_axis

# An edge point lies on the silhouette within this.
ON_SILHOUETTE_PX = 0.8
# Edge points a side of taper or cylinder needs before its own width means something.
LEAST_SIDE_POINTS = 8


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
    """Return along how much (0..1) of the cylinder it is as bright outside as the metal is, on the worse side.

    Pads behind do that here and there; a thicker needle whose highlight was taken for an edge does it all along.
    """
    _, u = caliper_rows(shape)
    rows = np.rint(u).astype(np.intp) - strip.u_from_px
    rows, u = rows[rows >= 0], u[rows >= 0]
    half = shape.cylinder_half_px + axis.cylinder_wider_px

    def levels(v_off_axis: float) -> Plane:
        columns = np.rint(axis.a_px + axis.b * u + v_off_axis).astype(np.intp) + strip.reach_px
        return strip.pixels[rows, np.clip(columns, 0, strip.pixels.shape[1] - 1)]

    metal = min(float(np.median(levels(half - 3.0))), float(np.median(levels(3.0 - half))))
    return max(float(np.mean(levels(side * (half + 4.0)) > 0.75 * metal)) for side in (-1.0, 1.0))


def consistency(points: EdgePoints, axis: Axis, rim2: Rim, shape: NeedleShape) -> tuple[float, float]:
    """Return (bend, moved) in px, each 0 where clutter leaves it unknown.

    bend: how far the taper's own axis and the cylinder's own axis are apart at the end. moved: how far the marking
    lies from where it was taught, by the taper's width, which tells for itself where the end is. Half a pixel of width
    are 3 px of place, so only edges before a background darker than the metal count, and both sides must say it: a
    moved marking shows on both, a line of silkscreen beside the needle on one.
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
    sides = [_moved(beyond, points.side == side, above, shape) - expected for side in (-1.0, 1.0)]
    moved = min(sides, key=abs) if sides[0] * sides[1] > 0.0 else 0.0
    return own_axes[0].a_px - own_axes[1].a_px, moved


def _moved(beyond: NDArray[np.float64], side: NDArray[np.bool_], above: NDArray[np.bool_], shape: NeedleShape) -> float:
    """Return how far along the needle one side of the taper is off its taught place, px.

    A brighter background or more blur makes taper and cylinder look narrower alike: the cylinder tells by how much.
    """
    wider = float(np.median(beyond[side & ~above]) - np.median(beyond[side & above]))
    return wider / shape.taper_slope
