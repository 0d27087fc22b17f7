"""Measurement of the probe near where template and votes put it: axis, rims, levels. No judgement is made here."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vision.core import Plane, derivative
from vision.tip.background import corrected, without_blind
from vision.tip.edge_vote import Vote, vote
from vision.tip.edges import EdgePoints, ProbeAxis, edge_points, fit_axis
from vision.tip.marking_rim import Rim, join_rim, marking_levels, rim_places
from vision.tip.orientation import Turn, taper_turn
from vision.tip.probe_model import ProbeModel
from vision.tip.strip import ProbeShape, ProbeStrip, across_slope, around, middle_profile, upper_median
from vision.tip.template_search import TemplateMatch

SPARE_PX = 16
"""The rough strip's spare room on every side, px: for where the template may be wrong and for a taper that is
turned."""
SURE_SHARE = 0.7
"""So many edges on the axis are hardly found where no probe is."""
MARKING_REACH_PX = 14
"""How far the marking may lie from where the template puts it."""
LEAST_RIM_SLOPE = 4.0
RIM1_REACH_PX = 8
FIRST_REACH_PX, SECOND_REACH_PX = 4, 2
ENOUGH_SUPPORT, CLEARLY_MORE = 0.7, 0.05
"""Edges before a darker ground are enough where they show on so much of the silhouette (0..1); edges of both signs have
to show on so much more of it."""


@dataclass(frozen=True, slots=True)
class TipSighting:
    """Hold the template's match, the rough strip there, its slope across, and the axis most edges vote for."""

    match: TemplateMatch
    strip: ProbeStrip
    slope: Plane
    vote: Vote

    @property
    def angle_rad(self) -> float:
        """Return the direction of the voted axis in the image."""
        return self.strip.angle_rad + float(np.arctan(self.vote.b))


@dataclass(frozen=True, slots=True)
class MeasuredTip:
    """Hold the straightened probe and what was measured on it.

    axis: fitted as of a straight probe; free: the same with a taper that may turn; turn: where the taper's edges show;
    metal, dark: levels beside and in the marking.
    """

    strip: ProbeStrip
    slope: Plane
    points: EdgePoints
    axis: ProbeAxis
    free: ProbeAxis
    turn: Turn
    rim1_u_px: float
    rim1_strength: float
    rim2: Rim
    metal: float
    dark: float

    @property
    def contrast(self) -> float:
        """Return how much darker the marking is than the metal, 0..1."""
        return 1.0 - self.dark / max(self.metal, 1.0)

    @property
    def sharpness(self) -> float:
        """Return the lower rim's steepest slope over its step, 1/px."""
        return self.rim2.strength / max(self.metal - self.dark, 1.0)


def sight(image: Plane, matches: list[TemplateMatch], model: ProbeModel, origin: tuple[int, int]) -> TipSighting:
    """Lay the probe roughly straight and let its edges vote; try the next match when few of them do."""
    seen: list[TipSighting] = []
    for match in matches:
        at = match.x_px - origin[0], match.y_px - origin[1]
        strip = around(image, at, match.angle_rad, model.shape, SPARE_PX)
        slope = across_slope(strip)
        told = across_slope(strip, by_ratio=True) if model.outline.dim_side else slope
        seen.append(TipSighting(match, strip, slope, vote(strip, told, model.outline, -model.h_px)))
        if seen[-1].vote.share > SURE_SHARE:
            break
    return max(seen, key=lambda one: one.vote.share)


def coarse_shift(sighting: TipSighting, shape: ProbeShape) -> float | None:
    """Return how far the marking lies from where the template puts it (u, px), None if there is none."""
    strip = sighting.strip
    axis = sighting.vote.a_px, sighting.vote.b
    slope = derivative(middle_profile(strip, axis, 5)[None, :], 2.0)[0]
    reach = MARKING_REACH_PX
    lower = round(-shape.end_to_rim_px) - strip.u_from_px
    upper = round(-shape.end_to_rim_px - shape.marking_px) - strip.u_from_px
    rise, fall = slope[lower - reach : lower + reach + 1], -slope[upper - reach : upper + reach + 1]
    # Both rims move together: the marking's length is known.
    grow = np.ones((1, 5), np.uint8)
    both = np.minimum(cv2.dilate(rise[None, :], grow)[0], cv2.dilate(fall[None, :], grow)[0])
    best = int(np.argmax(both))
    if float(both[best]) < LEAST_RIM_SLOPE:
        return None
    near = slice(max(best - 3, 0), best + 4)
    return float(np.argmax(rise[near]) + near.start - reach)


def measure(image: Plane, sighting: TipSighting, shift_px: float, model: ProbeModel) -> MeasuredTip | None:
    """Straighten the probe along the voted axis and measure it; None when too few edges agree on an axis."""
    rough, found = sighting.strip, sighting.vote
    at = rough.to_image(shift_px, found.a_px + found.b * shift_px)
    strip = around(image, at, sighting.angle_rad, model.shape, 0)
    slope = across_slope(strip)
    axis = _first_axis(strip, slope, model)
    if axis is None:
        return None
    wider = axis.cylinder_wider_px, axis.taper_wider_px
    line = axis.a_px, axis.b
    points = edge_points(strip, slope, model.outline, line, wider, SECOND_REACH_PX, either_way=True)
    points = without_blind(strip, corrected(strip, slope, points, line), model.outline, line, wider)
    axis = fit_axis(points, -model.h_px)
    free = fit_axis(points, -model.h_px, straight=False)
    if axis is None or free is None:
        return None
    return _with_rims(strip, slope, points, axis, free, model)


def _first_axis(strip: ProbeStrip, slope: Plane, model: ProbeModel) -> ProbeAxis | None:
    """Return the axis by the edges before a darker ground, or by edges of both signs where those show clearly more."""
    best: ProbeAxis | None = None
    for either_way in (False, True):
        start = (0.0, 0.0), (0.0, 0.0), FIRST_REACH_PX
        axis = fit_axis(edge_points(strip, slope, model.outline, *start, either_way=either_way), -model.h_px)
        if best is None or (axis is not None and axis.support > best.support + CLEARLY_MORE):
            best = axis
        if best is not None and best.support > ENOUGH_SUPPORT:
            break
    return best


def _with_rims(
    strip: ProbeStrip, slope: Plane, points: EdgePoints, axis: ProbeAxis, free: ProbeAxis, model: ProbeModel
) -> MeasuredTip:
    reach = model.rim_form_px.size // 2
    columns = np.arange(-reach, reach + 1)
    line, half = (axis.a_px, axis.b), model.outline.rim_half_px(-model.h_px)
    at = np.full(columns.size, -model.h_px)
    rim2 = join_rim(columns, half, *rim_places(strip, line, columns, at + model.rim_form_px, 6, 1.0), model.rim_form_px)
    inner = columns[np.abs(columns) <= 5]
    at1 = np.full(inner.size, rim2.u_px - model.shape.marking_px)
    u1, strength1 = rim_places(strip, line, inner, at1, RIM1_REACH_PX, -1.0)
    rim1_u = upper_median(u1)
    metal, dark = marking_levels(strip, line, rim1_u, rim2.u_px)
    turn = taper_turn(strip, slope, model.outline, axis, -model.h_px)
    return MeasuredTip(
        strip=strip,
        slope=slope,
        points=points,
        axis=axis,
        free=free,
        turn=turn,
        rim1_u_px=rim1_u,
        rim1_strength=upper_median(strength1),
        rim2=rim2,
        metal=metal,
        dark=dark,
    )
