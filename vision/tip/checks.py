"""Checks of a measured probe against the taught one: each finds what would make a wrong tip look right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.core import Floats, NotFound, Reason
from vision.tip.edges import EdgePoints
from vision.tip.measure import MeasuredTip
from vision.tip.probe_model import ProbeModel
from vision.tip.shade import shade_px
from vision.tip.side_checks import check_sides
from vision.tip.straight import check_straight
from vision.tip.strip import upper_median
from vision.tip.verdicts import blurred, no_marking, wrong

LEAST_SUPPORT = 0.5
"""Share of the calipers that must lie on the fitted silhouette."""
MOST_METAL_BEYOND = 0.9
"""Share of the cylinder's length along which it may be as bright beyond its edge as within."""
SAME_GROUND = 0.6
"""Beside the marking a bright ground is at least so bright, as a share of what it is beside the metal."""
# How far things may differ from what was taught before the probe counts as another or as damaged.
TURN_LIMIT_DEG = 4.0
WIDTH_LIMIT_PX, BLUNT_WIDTH_LIMIT_PX = 1.5, 0.8
"""Of a blunt needle there is no taper to tell that a highlight was taken for one of its edges."""
MARKING_LENGTH_LIMIT_PX = 2.5
SHIFTED_MARKING_LIMIT_PX, SHIFTED_BETWEEN_GROUNDS_PX = 3.5, 4.5
SHADE_LIMIT_PX, LEAST_SHADE_SHARE = 3.0, 0.35
"""A glint may hide where the light ends along half of the taper."""
LEAST_MARKING_CONTRAST = 0.35
LEAST_RIM_AGREEMENT = 0.5
LEAST_UPPER_RIM = 0.4
"""The upper rim need not be as sharp as the lower one, but it should be a rim."""
LEAST_SIDE_POINTS = 10
"""Edge points a side of taper or cylinder needs before its own width means something."""
SIDES_AGREE_PX, SIDES_AGREE_SHARE = 4.0, 0.5
LEAST_SHARPNESS = 0.12
"""The rim's steepest slope over the step from marking to metal, 1/px: 0.22 at a lens blur of 1 px, 0.19 at 1.4 px, 0.14
at 2.5 px (a Gaussian of the blur and the caliper's 1.5 px together)."""


def check_direction(angle_rad: float, model: ProbeModel) -> NotFound | None:
    """Return why the probe's direction is not the taught one, or None."""
    turn = float(np.degrees(angle_rad - model.angle_rad))
    if abs(turn) <= TURN_LIMIT_DEG:
        return None
    return NotFound(
        Reason.BENT, f"the needle is turned by {turn:+.1f} degrees against the taught one: straighten or replace it"
    )


def first_problem(probe: MeasuredTip, model: ProbeModel) -> NotFound | None:
    """Return the first thing that makes the measured probe another than the taught one, or None."""
    for check in (check_light, check_marking, check_straight, check_sides, check_shape):
        problem = check(probe, model)
        if problem is not None:
            return problem
    return None


def check_light(probe: MeasuredTip, _: ProbeModel) -> NotFound | None:
    """Return why the probe's image cannot be measured, or None."""
    if probe.contrast >= LEAST_MARKING_CONTRAST and probe.sharpness < LEAST_SHARPNESS:
        return blurred(probe.sharpness, LEAST_SHARPNESS)
    return None


def check_marking(probe: MeasuredTip, model: ProbeModel) -> NotFound | None:
    """Return why the marking is not the taught one, or None."""
    rim2 = probe.rim2
    if probe.contrast < LEAST_MARKING_CONTRAST:
        return no_marking(f"the marking is only {100 * probe.contrast:.0f} % darker than the metal")
    if rim2.agreement < LEAST_RIM_AGREEMENT:
        return no_marking(f"the lower rim is seen on only {100 * rim2.agreement:.0f} % of the needle's width")
    if probe.rim1_strength < LEAST_UPPER_RIM * rim2.strength:
        return no_marking("the marking's upper rim is not where it was taught")
    length = rim2.u_px - probe.rim1_u_px
    if abs(length - model.shape.marking_px) > MARKING_LENGTH_LIMIT_PX:
        return no_marking(f"the marking is {length:.1f} px long, {model.shape.marking_px:.1f} px were taught")
    return None


def check_shape(probe: MeasuredTip, model: ProbeModel) -> NotFound | None:
    """Return why the silhouette is not the taught one, or None."""
    axis = probe.axis
    if axis.support < LEAST_SUPPORT:
        return wrong(f"only {100 * axis.support:.0f} % of the edge points lie on the taught silhouette")
    if abs(axis.cylinder_wider_px) > (WIDTH_LIMIT_PX if model.shape.tapers else BLUNT_WIDTH_LIMIT_PX):
        return NotFound(
            Reason.WRONG_NEEDLE,
            f"the needle is {2 * axis.cylinder_wider_px:+.1f} px wider than the taught one: teach this needle",
        )
    problem = check_shade(probe, model)
    if problem is not None:
        return problem
    beyond = metal_beyond(probe, model)
    if beyond > MOST_METAL_BEYOND:
        return wrong(f"the metal goes on beyond the taught edge along {100 * beyond:.0f} % of the cylinder")
    moved, limit = _moved(probe, model)
    if abs(moved) > limit:
        return no_marking(f"the marking sits {moved:+.1f} px from where the taper's width says it was taught")
    return None


def check_shade(probe: MeasuredTip, model: ProbeModel) -> NotFound | None:
    """Return why the light on the dim side of a probe lit from one side ends elsewhere than taught, or None.

    The other edge alone gives the axis of such a probe, so this is all that tells of its width.
    """
    outline = model.outline
    if outline.shade_px is None:
        return None
    shade = shade_px(probe.strip, (probe.axis.a_px, probe.axis.b), outline)
    moved = shade - outline.shade_px
    for part in (outline.on_taper, ~outline.on_taper):
        share = float(np.mean(np.abs(moved[part]) < SHADE_LIMIT_PX))
        if share < LEAST_SHADE_SHARE:
            fact = "the light on the needle's dim side ends where it was taught on only"
            return wrong(f"{fact} {100 * share:.0f} % of its length")
    return None


def metal_beyond(probe: MeasuredTip, model: ProbeModel) -> float:
    """Return along how much (0..1) of the probe it is as bright outside as the metal is, on the worse side.

    A thicker probe whose highlight was taken for an edge does that all along its cylinder, and beside the thick half
    of its taper, or its marking goes on there too. A pad or lettering behind it may do so beside one of them, and a
    bright ground does so beside both: but the black band of the probe's own marking would go on through its metal,
    where a ground stays as bright as it is.
    """
    outline, axis = model.outline, probe.axis
    half_px = outline.rim_half_px(-model.h_px)
    thick = outline.half_px > 0.6 * half_px
    taper, cylinder = thick & outline.on_taper, thick & ~outline.on_taper
    worst = 0.0
    for side, edge, wider in ((-1.0, outline.left_px, -1.0), (1.0, outline.right_px, 1.0)):
        if side == outline.dim_side:
            continue
        grown = edge + wider * np.where(outline.on_taper, axis.taper_wider_px, axis.cylinder_wider_px)
        shares, levels = [], []
        for part in (taper, cylinder):
            inside = upper_median(_levels(probe, outline.u_px[part], grown[part] - 3.0 * side))
            outside = _levels(probe, outline.u_px[part], grown[part] + 4.0 * side)
            bright = int(np.count_nonzero(outside > 0.75 * min(inside, probe.metal)))
            shares.append(bright / max(outside.size, 1))
            levels.append(upper_median(outside))
        marked = np.arange(probe.rim1_u_px + 8.0, probe.rim2.u_px - 8.0, 2.0)
        beside = upper_median(_levels(probe, marked, np.full(marked.size, side * (half_px + 4.0))))
        if beside > SAME_GROUND * min(levels):
            continue
        goes_on = beside < probe.dark + 0.25 * (probe.metal - probe.dark)
        worst = max(worst, shares[1] if goes_on else min(shares))
    return worst


def _levels(probe: MeasuredTip, u_px: Floats, off_axis_px: Floats) -> Floats:
    """Return the brightness of the strip at those of the rows `u_px` it holds, `off_axis_px` from the axis."""
    strip, axis = probe.strip, probe.axis
    rows = np.rint(u_px).astype(np.intp) - strip.u_from_px
    keep = (rows >= 0) & (rows < strip.pixels.shape[0])
    columns = np.rint(axis.a_px + axis.b * u_px + off_axis_px).astype(np.intp) + strip.reach_px
    columns = np.clip(columns, 0, strip.pixels.shape[1] - 1)
    return np.asarray(strip.pixels[rows[keep], columns[keep]], dtype=np.float64)


def _moved(probe: MeasuredTip, model: ProbeModel) -> tuple[float, float]:
    """Return how far the marking lies from where it was taught, by the taper's width, and how far it may, px.

    A bright ground or more blur makes taper and cylinder look wider or narrower alike: the cylinder tells by how much.
    Half a pixel of width is 3 px of place, so edges of taper and cylinder are compared before grounds that are both
    darker, or both brighter, than the metal, and where too few are, before both, which tells less. Both sides must say
    it: a moved marking shows on both, a line of silkscreen beside the probe on one. 0 when unknown, as it is of a blunt
    needle: as wide all along, its width tells nothing of a place on it.
    """
    if not model.shape.tapers:
        return 0.0, SHIFTED_MARKING_LIMIT_PX
    points, axis = probe.points, probe.axis
    beyond = points.side * (points.v_px - axis.a_px - axis.b * points.u_px - points.taught_px)
    sides, limit = [], SHIFTED_MARKING_LIMIT_PX
    for side in (-1.0, 1.0):
        own = points.side == side
        wider = _taper_wider(points, beyond, own & points.brightens)
        if wider is None:
            wider = _taper_wider(points, beyond, own & ~points.brightens)
        if wider is None:
            wider, limit = _taper_wider(points, beyond, own), SHIFTED_BETWEEN_GROUNDS_PX
        if wider is None:
            return 0.0, limit
        sides.append(wider / model.shape.taper_slope - probe.rim2.u_px - model.h_px)
    apart = max(SIDES_AGREE_PX, SIDES_AGREE_SHARE * max(abs(sides[0]), abs(sides[1])))
    agree = sides[0] * sides[1] > 0.0 and abs(sides[0] - sides[1]) < apart
    return (min(sides, key=abs) if agree else 0.0), limit


def _taper_wider(points: EdgePoints, beyond_px: Floats, own: NDArray[np.bool_]) -> float | None:
    """Return how much wider the taper is than the cylinder by the `own` points (N,), px; None when they are too few."""
    parts = [own & (points.on_taper == on_taper) for on_taper in (True, False)]
    if min(int(np.count_nonzero(part)) for part in parts) < LEAST_SIDE_POINTS:
        return None
    return upper_median(beyond_px[parts[0]]) - upper_median(beyond_px[parts[1]])
