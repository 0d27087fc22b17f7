"""Whether the taper points where the cylinder does: a bent needle would put the tip elsewhere than it is."""

from __future__ import annotations

import numpy as np

from vision.core import NotFound, Reason
from vision.tip.edges import fit_axis
from vision.tip.measure import MeasuredTip
from vision.tip.probe_model import ProbeModel
from vision.tip.verdicts import wrong

TURNED_LEAD, DOUBTFUL_LEAD, LEAST_TURN_DEG, LEAST_SHOWN_STRAIGHT = 0.25, 0.1, 3.5, 0.38
"""A taper that shows both edges on so much more of its length (0..1) elsewhere than straight ahead is turned there; one
that shows fewer than the least straight ahead may point anywhere. Smaller turns are left to the fit."""
BEND_LIMIT_PX, BEND_CERTAIN_SIGMAS = 2.0, 4.0
LEAST_EDGES = 8
"""So many edges of the cylinder say where it points, and so many of one side of the taper which way it is bent."""


def check_straight(probe: MeasuredTip, model: ProbeModel) -> NotFound | None:
    """Return why the taper does not point where the cylinder does, or None."""
    turn, free = probe.turn, probe.free
    if turn.turned > turn.straight + TURNED_LEAD and abs(turn.turn_deg) >= LEAST_TURN_DEG:
        return NotFound(
            Reason.BENT,
            f"the taper is not where the cylinder points: it is turned by {turn.turn_deg:+.1f} degrees: "
            "replace the needle",
        )
    certain = abs(free.bend_px) > BEND_CERTAIN_SIGMAS * free.bend_sigma_px
    if abs(free.bend_px) > BEND_LIMIT_PX and certain and _is_the_needles(probe, model):
        return NotFound(
            Reason.BENT,
            f"the taper's axis misses the cylinder's by {free.bend_px:+.1f} px at the end: replace the needle",
        )
    shown = (turn.edges + _taper_support(probe)) / 2.0
    if shown < LEAST_SHOWN_STRAIGHT:
        fact = f"the taper shows on only {100 * shown:.0f} % of its length where the cylinder points"
        if turn.turned > turn.straight + DOUBTFUL_LEAD:
            return NotFound(Reason.BENT, f"{fact}, more of it elsewhere: straighten or replace the needle")
        return wrong(fact)
    return None


def _is_the_needles(probe: MeasuredTip, model: ProbeModel) -> bool:
    """Whether a bend is one of the needle: one that the ground pretends shows on one side of the taper.

    By the other side alone the taper then turns the other way, if at all. A side without edges says nothing. Without
    the cylinder nobody knows where the taper should point.
    """
    points, free = probe.points, probe.free
    if np.count_nonzero(~points.on_taper & (free.weights > 0.3)) < LEAST_EDGES:
        return False
    for side in (-1.0, 1.0):
        own = points.on_taper & (points.side == side)
        if np.count_nonzero(own) < LEAST_EDGES:
            continue
        alone = fit_axis(
            points.where(own | ~points.on_taper, points.offered, points.offered_on_taper), -model.h_px, straight=False
        )
        if alone is None or alone.bend_px * free.bend_px < 0.0:
            return False
    return True


def _taper_support(probe: MeasuredTip) -> float:
    """Return the share (0..1) of the taper's calipers whose edge lies on the fit."""
    used = probe.points.on_taper & (probe.axis.weights > 0.3)
    return float(np.count_nonzero(used)) / max(probe.points.offered_on_taper, 1)
