"""Teach a needle: from one white frame and the operator's click on its end, measure what `find_tip` relies on.

The end should stand before a dark, quiet background (thesis 5.3.6). The click fixes only the distance h from the
marking's lower rim to the end: across the needle the measured axis is better than any hand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.caliper import Floats, derivative, robust_fit
from vision.image import Gray, Plane
from vision.tip_strip import (
    THIN_END_PX,
    Axis,
    NeedleShape,
    Strip,
    across_slope,
    caliper_rows,
    edge_points,
    fit_axis,
    join_rim,
    middle_profile,
    rim_columns,
    rim_places,
    straighten,
)

# The needle comes into view from the upper left; teaching looks this far to either side of that direction.
AXIS_HINT_RAD = float(np.arctan2(232.0, 119.0))
HINT_REACH_DEG = 12.0
LENGTH_PX = 400
REACH_PX = 64
WIDE_REACH_PX = 120
# A hand on a screen hits the end within about a pixel; further off the axis, the click or the axis is wrong.
CLICK_REACH_PX = 3.0


@dataclass(frozen=True, slots=True)
class Taught:
    """Hold what teaching measured: the tip on the axis, the axis' angle, the silhouette, the rim's form, levels."""

    x_px: float
    y_px: float
    angle_rad: float
    shape: NeedleShape
    rim_form_px: Floats
    marking_contrast: float
    click_offset_px: float


def measure(plane: Gray, tip_px: tuple[float, float], hint_rad: float) -> Taught:
    """Measure the needle that ends at `tip_px` in a clean gray picture; ValueError says what could not be found."""
    image = plane.astype(np.float32)
    tilt, shape = _coarse(straighten(image, tip_px, hint_rad, -LENGTH_PX, 20, WIDE_REACH_PX))
    angle = hint_rad + tilt
    strip = straighten(image, tip_px, angle, -LENGTH_PX, 30, REACH_PX)
    axis: Axis | None = None
    for _ in range(3):
        axis, shape = _refine(strip, shape)
        angle += float(np.arctan(axis.b))
        strip = straighten(image, strip.to_image(0.0, axis.a_px), angle, -LENGTH_PX, 30, REACH_PX)
    return _conclude(strip, shape, tip_px)


def _conclude(strip: Strip, shape: NeedleShape, click_px: tuple[float, float]) -> Taught:
    """Measure the rims on the final strip and put the click on the axis."""
    columns = rim_columns(shape)
    at = np.full(columns.size, -shape.end_to_rim_px)
    u2, strength2 = rim_places(strip, (0.0, 0.0), columns, at, 9, 1.0)
    form = _smooth_form(columns, u2)
    rim2 = join_rim(u2, strength2, form)
    u1, strength1 = rim_places(strip, (0.0, 0.0), columns[2:-2], at[2:-2] - shape.marking_px, 9, -1.0)
    middle = columns.size // 2
    rim1 = float(np.median(u1[middle - 5 : middle + 2]))
    if min(rim2.strength, float(np.median(strength1))) < 8.0 or rim2.agreement < 0.6:
        raise ValueError(
            "the rims of the black marking are too faint or ragged to teach (strength "
            f"{rim2.strength:.0f} levels/px, {100 * rim2.agreement:.0f} % agree): renew the marking"
        )
    c, s = np.cos(strip.angle_rad), np.sin(strip.angle_rad)
    dx, dy = click_px[0] - strip.x_px, click_px[1] - strip.y_px
    along, across = float(dx * c + dy * s), float(dy * c - dx * s)
    shape = replace(
        shape,
        end_to_rim_px=along - rim2.u_px,
        marking_px=rim2.u_px - rim1,
        end_half_px=shape.end_half_px - shape.taper_slope * along,
    )
    if abs(across) > CLICK_REACH_PX:
        raise ValueError(
            f"the given end lies {abs(across):.1f} px beside the needle's measured axis (at most "
            f"{CLICK_REACH_PX:.0f}): click the very end again, before a dark, quiet background"
        )
    if not (0.3 < shape.end_half_px < 8.0):
        raise ValueError(
            f"the taper would end {2 * shape.end_half_px:.1f} px wide at the given point: something behind the needle "
            "was taken for its edge, or the point is not its end; use a dark, quiet background"
        )
    metal, dark = marking_levels(strip, (0.0, 0.0), rim1, rim2.u_px)
    x, y = strip.to_image(along, 0.0)
    return Taught(x, y, strip.angle_rad, shape, form, 1.0 - dark / max(metal, 1.0), across)


def marking_levels(strip: Strip, axis: tuple[float, float], rim1_u_px: float, rim2_u_px: float) -> tuple[float, float]:
    """Return the brightness of the metal on both sides of the marking, and of the marking itself, levels."""
    values = middle_profile(strip, axis, 6)
    at1, at2 = int(rim1_u_px) - strip.u_from_px, int(rim2_u_px) - strip.u_from_px
    inside = values[max(at1 + 8, 0) : max(at2 - 8, 1)]
    outside = np.concatenate([values[max(at1 - 24, 0) : max(at1 - 6, 0)], values[max(at2 + 6, 0) : max(at2 + 24, 0)]])
    if inside.size == 0 or outside.size == 0:
        return 0.0, 0.0
    return float(np.median(outside)), float(np.median(inside))


def _smooth_form(columns: NDArray[np.intp], u_px: Floats) -> Floats:
    """Return the rim's form over the columns, 0 at the axis: wild columns replaced, its centre averaged."""
    bow = np.stack([np.ones(columns.size), columns, columns**2.0], axis=1)
    fit = robust_fit(bow, u_px - float(np.median(u_px)))
    smooth = bow @ fit.parameters + float(np.median(u_px))
    form = np.where(np.abs(u_px - smooth) < 2.0, u_px, smooth)
    return np.asarray(form - float(np.mean(form[np.abs(columns) <= 3])), dtype=np.float64)


def _coarse(strip: Strip) -> tuple[float, NeedleShape]:
    """Return the needle's turn against the strip (rad) and its rough silhouette.

    Every direction and taper is tried: edges on both sides of the taper, the two rims of a dark marking along the
    middle, edges on both sides of the cylinder above it. The widest that does nearly as well as the best wins:
    highlights make needles inside the needle.
    """
    votes = _EdgeVotes.of(strip)
    tilts = np.tan(np.radians(np.arange(-HINT_REACH_DEG, HINT_REACH_DEG + 0.1, 1.0)))
    slopes = np.arange(0.04, 0.30, 0.012)
    score = np.zeros((tilts.size, slopes.size))
    shapes: dict[tuple[int, int], NeedleShape] = {}
    for row, tilt in enumerate(tilts):
        marking = _marking(strip, float(tilt))
        if marking is None:
            continue
        rim1, rim2 = marking
        for column, slope in enumerate(slopes):
            shape = NeedleShape(-rim2, rim2 - rim1, 2.0, float(slope), 2.0 - float(slope) * rim2)
            score[row, column], shapes[row, column] = votes.score(shape, float(tilt))
    best = score.max(axis=0)
    wide = int(np.flatnonzero(best >= 0.85 * best.max())[-1])
    if best[wide] < 0.8:
        raise ValueError(
            "no needle with a black marking ends at the given point. Click the very end of the needle under white "
            "light, before a dark, quiet background, and see that the marking is fresh"
        )
    row = int(np.argmax(score[:, wide]))
    return float(np.arctan(tilts[row])), shapes[row, wide]


@dataclass(frozen=True, slots=True)
class _EdgeVotes:
    """Hold how much every strip pixel is an edge that brightens towards +v, and towards -v, both 0..1."""

    rising: Plane
    falling: Plane
    u_from_px: int
    reach_px: int

    @classmethod
    def of(cls, strip: Strip) -> _EdgeVotes:
        slope, cap = across_slope(strip), strip.edge_level
        grow = np.ones((1, 3), dtype=np.uint8)
        rising = np.asarray(cv2.dilate(np.clip(slope / cap, 0.0, 1.0), grow), dtype=np.float32)
        falling = np.asarray(cv2.dilate(np.clip(-slope / cap, 0.0, 1.0), grow), dtype=np.float32)
        return cls(rising, falling, strip.u_from_px, strip.reach_px)

    def score(self, shape: NeedleShape, tilt: float) -> tuple[float, NeedleShape]:
        """Return 0..2, the share of taper and of cylinder with both edges, and the shape with its best cylinder."""
        taper, cylinder = caliper_rows(shape)
        on_taper = max(float(np.mean(self._both(taper, tilt, shape.half_width(taper) + grow))) for grow in (-1.0, 1.0))
        if on_taper < 0.35:
            return 0.0, shape
        halves = shape.cylinder_half_px * np.arange(0.9, 1.21, 0.05)
        on_cylinder = [float(np.mean(self._both(cylinder, tilt, np.full(cylinder.size, half)))) for half in halves]
        pick = int(np.argmax(on_cylinder))
        return on_taper + on_cylinder[pick], replace(shape, cylinder_half_px=float(halves[pick]))

    def _both(self, u: Floats, tilt: float, half: Floats) -> Floats:
        rows = np.rint(u).astype(np.intp) - self.u_from_px
        keep = (rows >= 0) & (rows < self.rising.shape[0])
        rows, u, half = rows[keep], u[keep], half[keep]
        if rows.size == 0:
            return np.zeros(1)
        last = self.rising.shape[1] - 1
        best = np.zeros(rows.size)
        for shift in (-2.0, 0.0, 2.0):
            right = np.clip(np.rint(tilt * u + shift - half).astype(np.intp) + self.reach_px, 0, last)
            left = np.clip(np.rint(tilt * u + shift + half).astype(np.intp) + self.reach_px, 0, last)
            votes = np.minimum(self.rising[rows, right], self.falling[rows, left])
            if votes.mean() > best.mean():
                best = np.asarray(votes, dtype=np.float64)
        return best


def _marking(strip: Strip, tilt: float) -> tuple[float, float] | None:
    """Return the coarse u of the upper and lower rim along a tilted line: a fall and, 15..90 px below it, a rise."""
    slope = derivative(middle_profile(strip, (0.0, tilt), 4)[None, :], 2.5)[0]
    u = np.arange(slope.size) + strip.u_from_px
    rise = np.where((u > -250) & (u < -40), slope, 0.0)
    peaks = np.flatnonzero((rise[1:-1] > rise[:-2]) & (rise[1:-1] >= rise[2:]) & (rise[1:-1] > 4.0)) + 1
    best_score, best = 4.0, None
    for at2 in peaks:
        at1 = at2 - np.arange(15, 91)
        at1 = at1[at1 >= 0]
        if at1.size == 0:
            continue
        pick = at1[int(np.argmin(slope[at1]))]
        score = float(min(rise[at2], -slope[pick]))
        if score > best_score:
            best_score, best = score, (float(u[pick]), float(u[at2]))
    return best


def _refine(strip: Strip, shape: NeedleShape) -> tuple[Axis, NeedleShape]:
    """Fit the edges near the silhouette known so far and return the axis and the better silhouette."""
    taper, cylinder = caliper_rows(shape)
    rows = np.concatenate([taper, cylinder])
    rows = rows[rows < -THIN_END_PX]
    points = edge_points(strip, across_slope(strip), shape, (0.0, 0.0), rows, 5)
    axis = fit_axis(points, shape, free_width=True)
    if axis is None or axis.support < 0.5:
        raise ValueError("too little of the needle's edges is seen to teach: use a dark, quiet background")
    better = replace(
        shape,
        end_half_px=shape.end_half_px + axis.taper_wider_px - 0.6 * 100.0 * axis.taper_slope_change,
        taper_slope=shape.taper_slope + axis.taper_slope_change,
        cylinder_half_px=shape.cylinder_half_px + axis.cylinder_wider_px,
    )
    rim_half = float(better.half_width(np.array([-better.end_to_rim_px]))[0])
    if rim_half < 6.0 or not (0.85 * rim_half < better.cylinder_half_px < 1.25 * rim_half):
        raise ValueError(
            f"the needle's taper ({2 * rim_half:.0f} px wide at the marking) and its cylinder "
            f"({2 * better.cylinder_half_px:.0f} px) do not fit each other: use a dark, quiet background"
        )
    return axis, better
