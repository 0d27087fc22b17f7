"""TEDA: find the end of the needle in a white-lit picture (thesis 5.3).

The end itself is a few dull pixels before a busy board, so it is not looked for. The needle is (golden template),
its two straight edges give the bisector, the marking's lower rim gives a sharp mark on it, and the end lies the taught
h px further along. Every step that does not look as taught ends the search: no answer is better than a wrong one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from vision.caliper import Line, derivative
from vision.image import Bgr, Gray, Plane, check_bgr, check_exposure, despike, gray, highlight
from vision.notfound import NotFound, Reason
from vision.probe_model import ProbeModel
from vision.tip_checks import consistency, metal_beyond, side_shares, turned_taper
from vision.tip_search import Match, region, search
from vision.tip_strip import (
    CALIPER_STEP_PX,
    CYLINDER_LENGTH_PX,
    END_CLEARANCE_PX,
    RIM_CLEARANCE_PX,
    THIN_END_PX,
    Axis,
    EdgePoints,
    NeedleShape,
    Rim,
    Strip,
    across_slope,
    caliper_rows,
    edge_points,
    fit_axis,
    join_rim,
    middle_profile,
    quantiles,
    rim_columns,
    rim_places,
    straighten,
    vote_axis,
)
from vision.tip_teach import marking_levels

# A lit board or base plate is brighter than this; the needle may be missing, so it is not asked.
DARK_LEVEL = 12.0
LEAST_SCORE = 0.45
# Share of the calipers that must find the taught silhouette.
LEAST_VOTE, LEAST_SUPPORT = 0.35, 0.4
# The same for each edge of the cylinder and of the taper by itself.
LEAST_SIDE_SUPPORT = 0.25
# A taper that shows both edges on this share of its length elsewhere than straight ahead is bent.
LEAST_SHOWN_ELSEWHERE = 0.5
# Share of the cylinder's length along which it may be as bright beyond its edge as within.
MOST_METAL_BEYOND = 0.8
# How far things may differ from what was taught before the needle counts as another or as damaged.
TURN_LIMIT_DEG = 4.5
BEND_LIMIT_PX = 2.5
WIDTH_LIMIT_PX = 1.5
MARKING_LENGTH_LIMIT_PX = 2.5
SHIFTED_MARKING_LIMIT_PX = 3.5
LEAST_MARKING_CONTRAST = 0.35
LEAST_RIM_AGREEMENT = 0.5
# The rim's steepest slope over the step from marking to metal, 1/px: 0.22 at a lens blur of 1 px, 0.19 at 1.4 px,
# 0.14 at 2.5 px (a Gaussian of the blur and the caliper's 1.5 px together).
LEAST_SHARPNESS = 0.135
# The same of the whole strip, before the needle is measured: only for telling why nothing was found.
LEAST_STRIP_SHARPNESS = 0.08
# What stays of errors the fit cannot see: the teaching's own noise, interpolation, light across the needle.
SYSTEMATIC_SIGMA_PX = 0.06
BLURRED_ADVICE = "clean the lens, check its focus, or wait longer for the head to settle"


@dataclass(frozen=True, slots=True)
class Tip:
    """Hold the needle's end and what was measured on the way.

    x_px, y_px: the end; angle_rad: direction of the needle towards it; sigma_px: honest 1-sigma of each coordinate.
    edges: L1 (found from the right) and L2 (from the left); intersection_px: where they would meet (eq. 5.7);
    rim1_px, rim2_px: upper and lower rim of the marking on the bisector; score: correlation with the golden template;
    marking_contrast: 0..1; width_px: of the cylinder; bend_px: how far taper and cylinder disagree at the end;
    sharpness: steepest slope of the lower rim over its step, 1/px (it falls as the picture blurs); edge_support: share
    of calipers that lie on the fitted silhouette; shape: that silhouette.
    """

    x_px: float
    y_px: float
    angle_rad: float
    sigma_px: float
    score: float
    edges: tuple[Line, Line]
    intersection_px: tuple[float, float]
    rim1_px: tuple[float, float]
    rim2_px: tuple[float, float]
    marking_contrast: float
    width_px: float
    bend_px: float
    sharpness: float
    edge_support: float
    shape: NeedleShape


def find_tip(white_bgr: Any, model: ProbeModel) -> Tip | NotFound:
    """Find the needle's end in a white frame (H, W, 3) uint8 BGR, in the frame's pixels.

    Accurate to about 0.1 px on clean pictures; `Tip.sigma_px` says how well this time. Returns NotFound with one of
    too_dark, saturated, blurred, out_of_frame, no_needle, wrong_needle, no_marking, bent. ValueError for an array of
    another shape or type.
    """
    image = check_bgr(white_bgr)
    x, y, width, height = region(model)
    if x < 0 or y < 0 or x + width > image.shape[1] or y + height > image.shape[0]:
        return NotFound(
            Reason.OUT_OF_FRAME,
            f"the needle is expected within x {x}..{x + width}, y {y}..{y + height} px, the picture has only "
            f"{image.shape[1]} x {image.shape[0]}: set the camera's size as it was when the needle was taught",
        )
    part: Bgr = image[y : y + height, x : x + width]
    plane = gray(part)
    problem = check_exposure(plane, dark_level=DARK_LEVEL, dark_percentile=50.0, clipped_share=0.25)
    if problem is not None:
        return problem
    match = search(plane, model, (x, y))
    if match.score < LEAST_SCORE:
        return NotFound(
            Reason.NO_NEEDLE,
            f"nothing looks like the taught needle near ({model.tip_px[0]:.0f}, {model.tip_px[1]:.0f}) px (best "
            f"correlation {match.score:.2f}, {LEAST_SCORE:.2f} is needed): is it mounted, is the white lamp on?",
        )
    found = _measure(despike(plane), match, model, (x, y))
    return found if isinstance(found, NotFound) else _shifted(found, x, y)


def _measure(plane: Gray, match: Match, model: ProbeModel, origin: tuple[int, int]) -> Tip | NotFound:
    """Measure the needle near the match; everything here is in the pixels of the region."""
    at = match.x_px - origin[0], match.y_px - origin[1]
    shape = model.shape
    rough = _strip(highlight(plane).astype(np.float32), at, match.angle_rad, shape, 16)
    a, b, vote = vote_axis(rough, across_slope(rough), shape, 10)
    image = plane.astype(np.float32)
    angle = match.angle_rad + float(np.arctan(b))
    strip = _strip(image, rough.to_image(0.0, a), angle, shape, 10)
    if vote < LEAST_VOTE:
        fact = f"the edges of the taught needle show on only {100 * vote:.0f} % of its length"
        wrong = NotFound(Reason.WRONG_NEEDLE, f"{fact}: is another needle mounted? Then teach it")
        return _blurred_or(strip, wrong)
    turn = float(np.degrees(angle - model.angle_rad))
    if abs(turn) > TURN_LIMIT_DEG:
        return NotFound(
            Reason.BENT, f"the needle is turned by {turn:+.1f} degrees against the taught one: straighten or replace it"
        )
    shift = _coarse_rim(strip, shape)
    if shift is None:
        return _blurred_or(strip, _no_marking("no dark band with a rim on each side was found on the needle"))
    return _fine(_strip(image, strip.to_image(shift, 0.0), angle, shape, 0), model, match)


def _strip(image: Plane, at: tuple[float, float], angle: float, shape: NeedleShape, spare_px: int) -> Strip:
    top = shape.end_to_rim_px + shape.marking_px + RIM_CLEARANCE_PX + CYLINDER_LENGTH_PX + CALIPER_STEP_PX
    return straighten(
        image, at, angle, -int(top) - spare_px, 24 + spare_px, int(shape.cylinder_half_px) + 10 + spare_px
    )


def _blurred_or(strip: Strip, problem: NotFound) -> NotFound:
    """Return `blurred` when nothing across the strip is sharp, else the problem as it is."""
    slope = np.abs(derivative(np.ascontiguousarray(strip.pixels[::2]), 1.0))
    low, high = quantiles(strip.pixels[::4, ::4], 0.02, 0.99)
    sharpness = quantiles(slope[:, ::2], 0.0, 0.99)[1] / max(high - low, 1.0)
    return problem if sharpness > LEAST_STRIP_SHARPNESS else _blurred(sharpness, LEAST_STRIP_SHARPNESS)


def _blurred(sharpness: float, least: float) -> NotFound:
    return NotFound(
        Reason.BLURRED, f"the picture is blurred (sharpness {sharpness:.3f}, {least:.3f} is needed): {BLURRED_ADVICE}"
    )


def _coarse_rim(strip: Strip, shape: NeedleShape) -> float | None:
    """Return how far the marking lies from where the match puts it (u, px), None if there is none."""
    slope = derivative(middle_profile(strip, (0.0, 0.0), 5)[None, :], 2.0)[0]
    lower = round(-shape.end_to_rim_px) - strip.u_from_px
    upper = round(-shape.end_to_rim_px - shape.marking_px) - strip.u_from_px
    reach = 14
    if upper - reach < 0:
        return None
    rise = slope[lower - reach : lower + reach + 1]
    fall = -slope[upper - reach : upper + reach + 1]
    # Both rims move together: the marking's length is known.
    both = np.minimum(
        cv2.dilate(rise[None, :], np.ones((1, 5), np.uint8))[0], cv2.dilate(fall[None, :], np.ones((1, 5), np.uint8))[0]
    )
    shift = int(np.argmax(both)) - reach
    if float(both[shift + reach]) < 4.0:
        return None
    near = slice(max(shift + reach - 3, 0), shift + reach + 4)
    return float(np.argmax(rise[near]) + near.start - reach)


def _fine(strip: Strip, model: ProbeModel, match: Match) -> Tip | NotFound:
    """Fit the edges, the bisector and the rims, check them against what was taught, and place the end."""
    shape = model.shape
    slope = across_slope(strip)
    taper_u, cylinder_u = caliper_rows(shape)
    rows = np.concatenate([taper_u, cylinder_u])
    points = edge_points(strip, slope, shape, (0.0, 0.0), rows, 4)
    axis = _thick_axis(points, shape)
    if axis is not None:
        points = edge_points(strip, slope, shape, (axis.a_px, axis.b), rows, 3, either_way=True)
        axis = _thick_axis(points, shape)
    if axis is None or axis.support < LEAST_SUPPORT:
        share = 0.0 if axis is None else axis.support
        fact = f"only {100 * share:.0f} % of the edge points lie on the taught silhouette"
        advice = (
            "is another needle mounted, or is the background too busy here? Look from another place, or teach again"
        )
        return _blurred_or(strip, NotFound(Reason.WRONG_NEEDLE, f"{fact}: {advice}"))
    columns = rim_columns(shape)
    line = axis.a_px, axis.b
    at = np.full(columns.size, -shape.end_to_rim_px) + model.rim_form_px
    rim2 = join_rim(*rim_places(strip, line, columns, at, 6, 1.0), model.rim_form_px)
    u1, _ = rim_places(strip, line, columns, at - model.rim_form_px - shape.marking_px, 6, -1.0)
    middle = columns.size // 2
    rim1_u = float(np.median(u1[middle - 3 : middle + 4]))
    metal, dark = marking_levels(strip, line, rim1_u, rim2.u_px)
    contrast, sharpness = 1.0 - dark / max(metal, 1.0), rim2.strength / max(metal - dark, 1.0)
    if contrast >= LEAST_MARKING_CONTRAST and sharpness < LEAST_SHARPNESS:
        return _blurred(sharpness, LEAST_SHARPNESS)
    shares = side_shares(points, axis, shape)
    if min(shares[0]) < LEAST_SIDE_SUPPORT:
        return _wrong(strip, f"the cylinder's two edges show on only {_percent(shares[0])} of their length")
    beyond = metal_beyond(strip, axis, shape)
    if beyond > MOST_METAL_BEYOND:
        return _wrong(strip, f"the metal goes on beyond the taught edge along {100 * beyond:.0f} % of the cylinder")
    if min(shares[1]) < LEAST_SIDE_SUPPORT:
        turn, shown, straight = turned_taper(strip, slope, axis, shape)
        if shown >= LEAST_SHOWN_ELSEWHERE and shown > straight + 0.2:
            return NotFound(
                Reason.BENT,
                f"the taper is not where the cylinder points: it is turned by {turn:+.1f} degrees: replace the needle",
            )
    bend, moved = consistency(points, axis, rim2, shape)
    problem = _check(axis, rim1_u, rim2, contrast, bend, moved, shape)
    if problem is not None:
        return problem
    return _conclude(strip, axis, rim1_u, rim2, contrast, bend, match, shape, sharpness)


def _check(
    axis: Axis, rim1_u: float, rim2: Rim, contrast: float, bend: float, moved: float, shape: NeedleShape
) -> NotFound | None:
    """Return why the measured needle cannot be trusted, or None."""
    if contrast < LEAST_MARKING_CONTRAST:
        return _no_marking(f"the marking is only {100 * contrast:.0f} % darker than the metal")
    if rim2.agreement < LEAST_RIM_AGREEMENT:
        return _no_marking(f"the lower rim is seen on only {100 * rim2.agreement:.0f} % of the needle's width")
    length = rim2.u_px - rim1_u
    if abs(length - shape.marking_px) > MARKING_LENGTH_LIMIT_PX:
        return _no_marking(f"the marking is {length:.1f} px long, {shape.marking_px:.1f} px were taught")
    if max(abs(axis.cylinder_wider_px), abs(axis.taper_wider_px)) > WIDTH_LIMIT_PX:
        return NotFound(
            Reason.WRONG_NEEDLE,
            f"the needle is {2 * axis.cylinder_wider_px:+.1f} px wider than the taught one: teach this needle",
        )
    if abs(bend) > BEND_LIMIT_PX:
        return NotFound(
            Reason.BENT, f"the taper's axis misses the cylinder's by {bend:+.1f} px at the end: replace the needle"
        )
    if abs(moved) > SHIFTED_MARKING_LIMIT_PX:
        return _no_marking(f"the marking sits {moved:+.1f} px from where the taper's width says it was taught")
    return None


def _wrong(strip: Strip, fact: str) -> NotFound:
    advice = "is another needle mounted, or is the background too busy here? Look from another place, or teach again"
    return _blurred_or(strip, NotFound(Reason.WRONG_NEEDLE, f"{fact}: {advice}"))


def _percent(shares: tuple[float, float]) -> str:
    return " and ".join(f"{100 * share:.0f} %" for share in shares)


def _thick_axis(points: EdgePoints, shape: NeedleShape) -> Axis | None:
    """Fit the axis to the needle's thick part."""
    offered = points.offered - 2 * int((THIN_END_PX - END_CLEARANCE_PX) / CALIPER_STEP_PX)
    return fit_axis(points.where(points.u_px < -THIN_END_PX, offered), shape)


def _conclude(
    strip: Strip,
    axis: Axis,
    rim1_u: float,
    rim2: Rim,
    contrast: float,
    bend: float,
    match: Match,
    shape: NeedleShape,
    sharpness: float,
) -> Tip:
    """Place the end h px beyond the lower rim on the bisector and gather what was measured."""
    stretch = float(np.sqrt(1.0 + axis.b**2))
    end_u = rim2.u_px + shape.end_to_rim_px / stretch
    x, y = strip.to_image(end_u, axis.v_px(end_u))
    lever = np.array([1.0, end_u])
    across = float(lever @ axis.covariance @ lever)
    sigma = float(np.sqrt((across + rim2.sigma_px**2) / 2.0 + SYSTEMATIC_SIGMA_PX**2))
    half = shape.end_half_px + axis.taper_wider_px - 60.0 * axis.taper_slope_change
    slope = shape.taper_slope + axis.taper_slope_change
    measured = NeedleShape(
        shape.end_to_rim_px, rim2.u_px - rim1_u, half, slope, shape.cylinder_half_px + axis.cylinder_wider_px
    )
    return Tip(
        x,
        y,
        strip.angle_rad + float(np.arctan(axis.b)),
        sigma,
        match.score,
        (_edge_line(strip, axis, measured, -1.0), _edge_line(strip, axis, measured, 1.0)),
        strip.to_image(half / slope, axis.v_px(half / slope)),
        strip.to_image(rim1_u, axis.v_px(rim1_u)),
        strip.to_image(rim2.u_px, axis.v_px(rim2.u_px)),
        contrast,
        2.0 * measured.cylinder_half_px,
        bend,
        sharpness,
        axis.support,
        measured,
    )


def _edge_line(strip: Strip, axis: Axis, shape: NeedleShape, side: float) -> Line:
    """Return the taper's edge on one side as a line in the image, through its point at u = 0."""
    x, y = strip.to_image(0.0, axis.a_px + side * shape.end_half_px)
    angle = strip.angle_rad + float(np.arctan(axis.b - side * shape.taper_slope))
    return Line(x, y, angle, float(np.sqrt(axis.covariance[0, 0])), round(100 * axis.support), 100)


def _no_marking(fact: str) -> NotFound:
    return NotFound(Reason.NO_MARKING, f"{fact}: clean the needle or renew the marking, then teach again")


def _shifted(tip: Tip, x: int, y: int) -> Tip:
    """Return `tip` moved from the region's pixels to the frame's."""

    def moved(point: tuple[float, float]) -> tuple[float, float]:
        return point[0] + x, point[1] + y

    first, second = (replace(line, x_px=line.x_px + x, y_px=line.y_px + y) for line in tip.edges)
    return replace(
        tip,
        x_px=tip.x_px + x,
        y_px=tip.y_px + y,
        edges=(first, second),
        intersection_px=moved(tip.intersection_px),
        rim1_px=moved(tip.rim1_px),
        rim2_px=moved(tip.rim2_px),
    )
