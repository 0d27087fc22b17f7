"""Checks of both sides of the probe, all the way down: where the ground hides one, the other must tell."""

from __future__ import annotations

import numpy as np

from vision.core import NotFound
from vision.tip.edges import fit_axis
from vision.tip.measure import MeasuredTip
from vision.tip.probe_model import ProbeModel
from vision.tip.strip import upper_median
from vision.tip.verdicts import wrong

LEAST_FOUND, LEAST_AGREEMENT, MOST_OFF_PX = 10, 0.3, 0.75
"""Of so many edges found on one side of the taper so much (0..1) has to lie on the fit, or all of them near it."""
LEAST_USED = 6
"""With fewer than so many edges on the fit a side tells nothing: what the other one tells has to be plainer then. The
bend at the end, its 1-sigma, and where the taper's width puts the marking, px."""
ONE_SIDED_BEND_PX, ONE_SIDED_SIGMA_PX, ONE_SIDED_MOVED_PX = 1.0, 0.5, 6.0
ONE_SIDED_WIDER_PX = 0.6
"""How much the half width of a cylinder seen on one side may differ, px."""
LEAST_THIN_FOUND, LEAST_THIN_NEAR, NEAR_PX, PLAIN_USED = 6, 4, 0.8, 8
"""The thin half of the taper shows a shorter or a longer one: of so many edges found there more than half, or so many,
have to lie near the fit. Asked where a side has fewer than so many on the fit: others show the taper's length."""


def check_sides(probe: MeasuredTip, model: ProbeModel) -> NotFound | None:
    """Return why the sides of the taper do not tell of one and the same taught probe, or None.

    Edges that are there but lie elsewhere speak against the probe. Where one side does not stand out from the ground
    the other one alone has to tell a bend, another width and a moved marking apart, and is asked for each.
    """
    if model.outline.dim_side:
        return None
    points, axis = probe.points, probe.axis
    wider = np.where(points.on_taper, axis.taper_wider_px, axis.cylinder_wider_px)
    beyond = points.side * (points.v_px - axis.a_px - axis.b * points.u_px - points.taught_px) - wider
    least_used = points.u_px.size
    for side in (-1.0, 1.0):
        own = points.on_taper & (points.side == side)
        found, used = int(np.count_nonzero(own)), int(np.count_nonzero(own & (axis.weights > 0.3)))
        if found >= LEAST_FOUND and used < LEAST_AGREEMENT * found and abs(upper_median(beyond[own])) > MOST_OFF_PX:
            return wrong(f"only {used} of {found} edges on one side of the taper lie on the taught silhouette")
        least_used = min(least_used, used)
    thin = points.on_taper & (points.u_px > -model.h_px / 2.0)
    found, near = int(np.count_nonzero(thin)), int(np.count_nonzero(thin & (np.abs(beyond) < NEAR_PX)))
    doubtful = found >= LEAST_THIN_FOUND and near < LEAST_THIN_NEAR and 2 * near <= found
    if doubtful and least_used < PLAIN_USED:
        return wrong(f"only {near} of {found} edges of the taper's thin half lie on the taught silhouette")
    return _one_sided(probe, model) if least_used < LEAST_USED else _one_sided_cylinder(probe)


def _one_sided(probe: MeasuredTip, model: ProbeModel) -> NotFound | None:
    """Return why one side of the taper alone does not tell enough, or None."""
    free = probe.free
    fact = "one side of the taper does not stand out from the ground, and by the other one"
    if abs(free.bend_px) > ONE_SIDED_BEND_PX or free.bend_sigma_px > ONE_SIDED_SIGMA_PX:
        return wrong(f"{fact} its axis misses the cylinder's by {free.bend_px:+.1f} +- {free.bend_sigma_px:.1f} px")
    loose = fit_axis(probe.points, -model.h_px, straight=False, same_width=False)
    if loose is None:
        return wrong(f"{fact} too little is seen")
    wider = loose.taper_wider_px - loose.cylinder_wider_px
    if not model.shape.tapers:
        return _one_sided_cylinder(probe)
    moved = wider / model.shape.taper_slope - probe.rim2.u_px - model.h_px
    if abs(moved) > ONE_SIDED_MOVED_PX:
        return wrong(f"{fact} the marking sits {moved:+.1f} px from where it was taught")
    return _one_sided_cylinder(probe)


def _one_sided_cylinder(probe: MeasuredTip) -> NotFound | None:
    """Return why one side of the cylinder alone does not tell enough, or None: another width would move the axis."""
    points, axis = probe.points, probe.axis
    used = ~points.on_taper & (axis.weights > 0.3)
    least_used = min(int(np.count_nonzero(used & (points.side == side))) for side in (-1.0, 1.0))
    if least_used >= LEAST_USED or abs(axis.cylinder_wider_px) < ONE_SIDED_WIDER_PX:
        return None
    fact = "one side of the cylinder does not stand out from the ground, and by the other one it is"
    return wrong(f"{fact} {2 * axis.cylinder_wider_px:+.1f} px wider than the taught one")
