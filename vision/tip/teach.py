"""Teaching of a probe: from one white image and the operator's click on its end, what `find_tip` relies on.

The end should stand before a dark, quiet background (thesis 5.3.6): edges are taught as they are seen there, and what a
brighter ground does to them later is worked out from that (`background`). The click fixes only the distance h from the
marking's lower rim to the end: across the probe the measured axis is better than any hand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.core import Floats, Gray, Plane, robust_fit
from vision.tip.edges import EdgePoints, edge_points
from vision.tip.end import BEYOND_PX, check_end
from vision.tip.ground import ground_advice
from vision.tip.marking_rim import join_rim, marking_levels, rim_columns, rim_places
from vision.tip.outline import RoughOutline, rough_probe
from vision.tip.shade import dim_side, taught_shade_px
from vision.tip.silhouette import Silhouette, caliper_rows
from vision.tip.strip import ProbeShape, ProbeStrip, across_slope, straighten, upper_median
from vision.tip.width import check_width

AXIS_HINT_RAD = float(np.arctan2(232.0, 119.0))
"""The probe comes into view from the upper left; teaching looks this far to either side of that direction."""
LENGTH_PX, BELOW_PX = 420, 30
REACH_PX = 64
WIDE_REACH_PX = 130
CLICK_REACH_PX = 3.0
"""A hand on a screen hits the end within about a pixel; further off the axis, the click or the axis is wrong."""
LONE_ROW_PX = 1.2
"""A row whose edge moved by this much more than its neighbours' was drawn away by something else."""
MOST_OFF_AXIS_PX = 0.5
BY_LEVEL, BY_RATIO = (False, False), (True, True)
"""Whether the left and the right edge are looked for by ratio (see `across_slope`)."""
SAME_AXIS_PX = 0.3
"""Edges found by level and by ratio lie about the same axis when no farther apart at either end."""
MOST_WIDER_PX, MOST_HEAD_PX = 1.0, 8.0
"""How much wider than the cylinder the taper may be, and the head of a blunt needle, on both sides alike."""
END_ROWS = 5
"""The last rows of the taper: how wide a blunt needle is."""
HEAD_FROM_PX, HEAD_TO_PX, HEAD_SHARE, LEAST_HEAD_PX = 22, 4, 0.7, 1.2
"""Where before the end a wider head is looked for, and what of its rows is as wide or narrower."""
LEAST_RIM_STRENGTH, LEAST_RIM_AGREEMENT = 8.0, 0.5


@dataclass(frozen=True, slots=True)
class Taught:
    """Hold what teaching measured: the tip on the axis, the axis' angle, sizes, outline, the rim's form, levels."""

    x_px: float
    y_px: float
    angle_rad: float
    shape: ProbeShape
    outline: Silhouette
    rim_form_px: Floats
    marking_contrast: float
    click_offset_px: float


def measure(plane: Gray, tip_px: tuple[float, float], hint_rad: float) -> Taught:
    """Measure the probe that ends at `tip_px` in a clean gray image; ValueError says what could not be found.

    It speaks of the ground only where that is not as it should be: on a dark one the shape is what is wrong.
    """
    image = plane.astype(np.float32)
    wide = straighten(image, tip_px, hint_rad, -LENGTH_PX, 20, WIDE_REACH_PX)
    try:
        return _measured(image, wide, tip_px, hint_rad)
    except ValueError as exc:
        advice = ground_advice(wide)
        raise ValueError(f"{exc}; {advice}" if advice else str(exc)) from exc


def _measured(image: Plane, wide: ProbeStrip, tip_px: tuple[float, float], hint_rad: float) -> Taught:
    rough = rough_probe(wide)
    angle = hint_rad + rough.tilt_rad
    strip, outline = _straightened(image, tip_px, angle, rough.outline, BY_LEVEL)
    ratios, by_ratio = _straightened(image, tip_px, angle, rough.outline, BY_RATIO)
    if not _same_axis(strip, ratios, outline):
        dim = dim_side(ratios, by_ratio)
        strip, outline = _straightened(image, tip_px, angle, rough.outline, (dim < 0, dim > 0))
        outline = replace(outline, dim_side=dim, shade_px=taught_shade_px(strip, outline, dim))
    longer = straighten(image, (strip.x_px, strip.y_px), strip.angle_rad, -LENGTH_PX, BEYOND_PX, REACH_PX)
    return _conclude(strip, longer, rough, outline, tip_px)


def _straightened(
    image: Plane, tip_px: tuple[float, float], angle_rad: float, rough: Silhouette, by_ratio: tuple[bool, bool]
) -> tuple[ProbeStrip, Silhouette]:
    """Return the strip along the probe's axis and the outline about it, found from a rough outline.

    by_ratio: whether the left and the right edge are where the brightness changes fastest by ratio, not by levels.
    """
    outline = rough
    strip = straighten(image, tip_px, angle_rad, -LENGTH_PX, BELOW_PX, REACH_PX)
    for reach_px in (4, 4, 3):
        a, b, outline = _refined(strip, outline, reach_px, by_ratio)
        at = strip.to_image(0.0, a)
        strip = straighten(image, at, strip.angle_rad + float(np.arctan(b)), -LENGTH_PX, BELOW_PX, REACH_PX)
    return strip, outline


def _same_axis(levels: ProbeStrip, ratios: ProbeStrip, outline: Silhouette) -> bool:
    """Return whether edges found by level and by ratio lie about the same axis.

    Where the light comes from one side the steepest place of the dim flank is within it, where the light ends; by ratio
    it is the probe's edge. Otherwise the levels are better: they have less noise, and move less with the blur.
    """
    turn = float(np.tan(ratios.angle_rad - levels.angle_rad))
    c, s = np.cos(levels.angle_rad), np.sin(levels.angle_rad)
    aside = float((ratios.y_px - levels.y_px) * c - (ratios.x_px - levels.x_px) * s)
    moved = np.abs(aside + turn * outline.u_px[[0, -1]])
    return float(moved.max()) < SAME_AXIS_PX


def _refined(
    strip: ProbeStrip, outline: Silhouette, reach_px: int, by_ratio: tuple[bool, bool]
) -> tuple[float, float, Silhouette]:
    """Return the axis (a, b) of the measured edges and the outline as seen from it."""
    slopes = {ratio: across_slope(strip, by_ratio=ratio) for ratio in set(by_ratio)}
    points = [edge_points(strip, slopes[ratio], outline, (0.0, 0.0), (0.0, 0.0), reach_px) for ratio in by_ratio]
    left, right = (_by_row(one, outline, side) for one, side in zip(points, (-1.0, 1.0), strict=True))
    seen = np.isfinite(left) & np.isfinite(right)
    if min(np.count_nonzero(seen & outline.on_taper), np.count_nonzero(seen & ~outline.on_taper)) < 8:
        raise ValueError(
            "too little of the needle's two edges is seen, above its marking or below: click its very end, in the "
            "middle of its width"
        )
    u, centre = outline.u_px[seen], (left[seen] + right[seen]) / 2.0
    fit = robust_fit(np.stack([np.ones_like(u), u / 100.0], axis=1), centre)
    if np.mean(fit.weights > 0.3) < 0.5:
        raise ValueError("the needle's two edges do not lie about one axis: it is bent, or something beside it is seen")
    a, b = float(fit.parameters[0]), float(fit.parameters[1]) / 100.0
    axis = a + b * outline.u_px
    return a, b, _smooth(replace(outline, left_px=left - axis, right_px=right - axis), outline)


def _by_row(points: EdgePoints, outline: Silhouette, side: float) -> Floats:
    """Return v of the edge on one side at each row of the outline, NaN where none was found."""
    v = np.full(outline.u_px.size, np.nan)
    own = points.side == side
    v[np.searchsorted(outline.u_px, points.u_px[own])] = points.v_px[own]
    return v


def _smooth(seen: Silhouette, before: Silhouette) -> Silhouette:
    """Return the outline with rows that were not seen, or stand out from their neighbours, put in line."""
    smooth = []
    for now, old in ((seen.left_px, before.left_px), (seen.right_px, before.right_px)):
        kept = now.copy()
        for part in (seen.on_taper, ~seen.on_taper):
            change = (now - old)[part]
            usual = _running_median(change)
            kept[part] = old[part] + np.where(np.abs(change - usual) < LONE_ROW_PX, change, usual)
        smooth.append(kept)
    return replace(seen, left_px=smooth[0], right_px=smooth[1])


def _running_median(values: Floats) -> Floats:
    """Return the median over each value (N,) and its two neighbours on either side, NaN left out."""
    padded = np.pad(values, 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 5)
    whole = float(np.nanmedian(values))
    some = np.any(np.isfinite(windows), axis=1)
    smooth = np.full(values.size, whole)
    smooth[some] = np.nanmedian(windows[some], axis=1)
    return smooth


def _conclude(
    strip: ProbeStrip, longer: ProbeStrip, rough: RoughOutline, outline: Silhouette, click_px: tuple[float, float]
) -> Taught:
    """Measure the rims on the final strip and put the click on the axis; a `longer` one tells whether it ends there."""
    c, s = np.cos(strip.angle_rad), np.sin(strip.angle_rad)
    dx, dy = click_px[0] - strip.x_px, click_px[1] - strip.y_px
    along, across = float(dx * c + dy * s), float(dy * c - dx * s)
    if abs(across) > CLICK_REACH_PX:
        raise ValueError(
            f"the given end lies {abs(across):.1f} px beside the needle's measured axis (at most "
            f"{CLICK_REACH_PX:.0f}): click the very end again, in the middle of its width"
        )
    check_end(longer, along, float(np.mean(outline.half_px[-END_ROWS:])), rough.rim2_u_px)
    rim1_u, rim2_u, form = _rims(strip, rough, outline)
    check_width(strip, max(outline.rim_half_px(rim1_u), outline.rim_half_px(rim2_u)), rim1_u, rim2_u)
    metal, dark = marking_levels(strip, (0.0, 0.0), rim1_u, rim2_u)
    shape, outline = _sizes(outline, along, rim1_u, rim2_u)
    if not shape.tapers:
        head = _head_wider_px(strip, along, shape.end_half_px)
        shape = replace(shape, end_half_px=shape.end_half_px + head, taper_slope=-head / shape.end_to_rim_px)
    x, y = strip.to_image(along, 0.0)
    return Taught(
        x_px=x,
        y_px=y,
        angle_rad=strip.angle_rad,
        shape=shape,
        outline=outline,
        rim_form_px=form,
        marking_contrast=1.0 - dark / max(metal, 1.0),
        click_offset_px=across,
    )


def _head_wider_px(strip: ProbeStrip, end_u_px: float, half_px: float) -> float:
    """Return how much wider than `half_px` the last rows before the end are: the head of a crown, 0 for none."""
    at = round(end_u_px) - strip.u_from_px
    rows = strip.pixels[at - HEAD_FROM_PX : at - HEAD_TO_PX]
    inner = rows[:, strip.reach_px - round(half_px / 2) : strip.reach_px + round(half_px / 2) + 1]
    ground = strip.pixels[at + 6 : at + 16]
    bright = rows > (float(np.median(inner)) + float(np.median(ground))) / 2.0
    reach = min(strip.reach_px, round(2.0 * half_px) + 6)
    sides = []
    for side in (-1, 1):
        line = bright[:, strip.reach_px : strip.reach_px + side * reach : side]
        # Up to the first column outside of the shaft that is dark: what lies beyond is no head.
        outside = ~line[:, round(half_px) - 1 :]
        width = np.where(outside.any(axis=1), np.argmax(outside, axis=1), outside.shape[1])
        sides.append(float(np.quantile(width + round(half_px) - 1, HEAD_SHARE)))
    wider = min(sides) - half_px
    return wider if wider > LEAST_HEAD_PX else 0.0


def _rims(strip: ProbeStrip, rough: RoughOutline, outline: Silhouette) -> tuple[float, float, Floats]:
    """Return u of the upper and the lower rim and the lower one's form over `rim_columns`, 0 at the axis."""
    half = outline.rim_half_px(rough.rim2_u_px)
    columns = rim_columns(half)
    u2, strength2 = rim_places(strip, (0.0, 0.0), columns, np.full(columns.size, rough.rim2_u_px), 9, 1.0)
    form = _smooth_form(columns, u2)
    rim2 = join_rim(columns, half, u2, strength2, form)
    around = np.full(columns.size, rough.rim1_u_px)
    u1, strength1 = rim_places(strip, (0.0, 0.0), columns, around, 9, -1.0)
    rim1 = upper_median(u1[np.abs(columns) <= 4])
    faint = min(rim2.strength, upper_median(strength1))
    if faint < LEAST_RIM_STRENGTH or rim2.agreement < LEAST_RIM_AGREEMENT:
        raise ValueError(
            "the rims of the black marking are too faint or ragged to teach (strength "
            f"{faint:.0f} levels/px, {100 * rim2.agreement:.0f} % agree): renew the marking"
        )
    return rim1, rim2.u_px, form


def _smooth_form(columns: NDArray[np.intp], u_px: Floats) -> Floats:
    """Return the rim's form over the columns, 0 at the axis: wild columns replaced, its centre averaged."""
    bow = np.stack([np.ones(columns.size), columns, columns**2.0], axis=1)
    fit = robust_fit(bow, u_px - upper_median(u_px))
    smooth = bow @ fit.parameters + upper_median(u_px)
    form = np.where(np.abs(u_px - smooth) < 3.0, u_px, smooth)
    return np.asarray(form - float(np.mean(form[np.abs(columns) <= 3])), dtype=np.float64)


def _sizes(outline: Silhouette, end_u_px: float, rim1_u_px: float, rim2_u_px: float) -> tuple[ProbeShape, Silhouette]:
    """Return the sizes and the outline with its rows counted from the end, where the click has put it."""
    h, marking = end_u_px - rim2_u_px, rim2_u_px - rim1_u_px
    u, cylinder_rows = caliper_rows(h, marking)
    left, right = (np.interp(u, outline.u_px - end_u_px, side) for side in (outline.left_px, outline.right_px))
    shade = None if outline.shade_px is None else np.interp(u, outline.u_px - end_u_px, outline.shade_px)
    final = Silhouette(
        u_px=u, left_px=left, right_px=right, cylinder_rows=cylinder_rows, dim_side=outline.dim_side, shade_px=shade
    )
    cylinder = float(np.mean(final.half_px[~final.on_taper]))
    taper_u, taper = u[final.on_taper], final.half_px[final.on_taper]
    narrowing = taper < 0.93 * cylinder
    if np.count_nonzero(narrowing) < 5:
        _check_axis(final, cylinder, MOST_HEAD_PX)
        return ProbeShape(h, marking, float(np.mean(taper[-END_ROWS:])), 0.0, cylinder), final
    slope, end = (float(number) for number in np.polyfit(-taper_u[narrowing], taper[narrowing], 1))
    if not (0.02 < slope < 1.0):
        raise ValueError(
            f"the needle is {cylinder - float(np.mean(taper)):.1f} px thinner each side below its marking than above, "
            f"but narrows there by {slope:.2f} px in each px towards its end (0.02 to 1 can be taught, or one as wide "
            "below as above): click its very end, in the middle of its width, and see that nothing else is seen there"
        )
    _check_axis(final, cylinder, MOST_WIDER_PX)
    return ProbeShape(h, marking, max(end, 0.5), slope, cylinder), final


def _check_axis(outline: Silhouette, cylinder_half_px: float, most_wider_px: float) -> None:
    """Raise ValueError unless cylinder and taper lie about the same axis and fit each other."""
    off_axis = np.abs(outline.left_px + outline.right_px) / 2.0
    thick_taper = outline.on_taper & (outline.half_px > 0.4 * cylinder_half_px)
    worst = max(float(np.mean(off_axis[part])) for part in (~outline.on_taper, thick_taper))
    wider = float(np.max(outline.half_px[outline.on_taper])) - cylinder_half_px
    if worst > MOST_OFF_AXIS_PX:
        raise ValueError(
            f"above its marking and below it the needle does not lie about one axis (off by {worst:.1f} px, at most "
            f"{MOST_OFF_AXIS_PX}): it is bent, or has a long wide head, or something behind it was taken for its edge"
        )
    if wider > most_wider_px:
        raise ValueError(
            f"the needle is {wider:.1f} px wider each side below its marking than above (at most {most_wider_px:g}): "
            "its head is too wide, or something behind it was taken for its edge"
        )
