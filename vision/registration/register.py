"""Registration of CAD to a red picture: coarse search, refinement, wide check in pairs, fine, the target alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vision.core import Bgr, NotFound, check_bgr, check_exposure, red_signal
from vision.registration import spectra, wide
from vision.registration.answer import NotRegistered, Refusal, Registration, Rival, Target
from vision.registration.edges import LEAST_CONFIRMED, LEAST_NEAR, LEAST_SOLDERED
from vision.registration.fine import judge
from vision.registration.lean import beside_parts
from vision.registration.rectify import Picture, Pose
from vision.registration.reference import Reference
from vision.registration.refine import Fit, Problem, refine
from vision.registration.sheet import Levels

LEAST_ODDS = 9.2
"""1 : 10,000 by the picture alone."""
LEAST_AGREEMENT, MOST_CONTRADICTED = 0.6, 0.3
LEAST_ALONE = 0.75
"""Agreement of a look for the board alone: it settles side and turn, and can be taken at another place as well."""
SURE_EDGES = 0.65
"""Metal edges near, with which and with nearly all metal seen such a look may agree as little as one for a target: what
is seen and not in CAD (flux, parts as they are) moves no pad."""
SURE_AGREEMENT, LEAST_METAL, LEAST_METAL_BESIDE_PARTS = 0.85, 0.91, 0.75
"""Dirt is seen and not in CAD, and hides little of its metal; of another side or turn with the same header some metal
is always missing. Where so much agrees that there is little of either, metal is not asked. Parts that are larger or
taller than CAD has them hide some too."""
PLACE_AGREEMENT, PLACE_CONFIRMED = 0.4, 0.8
MOST_OFF_REST_UM = 100.0
LEAST_SEEN = 0.25
"""Of the target's edge."""
SAME_UM = 70.0
"""Hypotheses nearer than this are one."""
REFINE_STEPS, STILL_CELLS = 3, 0.15
"""Hypotheses are compared in cells of 96 um: 7 um are near enough."""
_DARK_LEVEL, _DARK_PERCENTILE, _CLIPPED_SHARE = 12.0, 99.5, 0.6

Candidate = tuple[Fit, wide.View]


def register(
    reference: Reference,
    red_bgr: Bgr,
    board_to_px: NDArray[np.float64],
    target: Target | None,
    hidden_px: Sequence[NDArray[np.float64]] = (),
) -> Registration | NotRegistered:
    """Find where the board lies, within 3.3 mm of where it was assumed, and where the target is.

    reference: drawn about the target. target: None asks for the board alone (`target_um` is then the reference's
    place). red_bgr: (H, W, 3) uint8 under the red lamp. board_to_px: (3, 3) homography of
    the board frame (um) as assumed. hidden_px: polygons (N, 2) of what stands before the board (the needle).
    """
    picture = open_picture(red_bgr, board_to_px, hidden_px)
    if isinstance(picture, NotRegistered):
        return picture
    reference = beside_parts(reference, picture)
    per_um = 1.0 / picture.um_per_px(*reference.about_um)
    cell_um = reference.wide.planes.grid.cell_um
    shown = wide.look(picture, reference.about_um, cell_um, cell_um * per_um)
    fits = _hypotheses(reference, picture, shown, per_um, alone=target is None)
    if not fits:
        return NotRegistered(
            Refusal.NO_BOARD, "the red picture shows nothing in which CAD's neighbourhood of the target could be found"
        )
    candidates, odds, winner = _compare(reference, shown, fits)
    if float(odds.min()) < LEAST_ODDS:
        # The end of a long row may be in the frame, but farther off.
        broad = wide.look(picture, reference.about_um, cell_um, cell_um * per_um, wide.WIDEST_UM)
        candidates, odds, winner = _compare(reference, broad, fits)
    place_um = reference.about_um if target is None else (target.x_um, target.y_um)
    rivals = _rivals(candidates, odds, winner, place_um)
    agrees = wide.agreement(reference.wide, shown, _laid(reference, shown, candidates[winner][0]))
    return decide(judge(reference, picture, candidates[winner][0], target, rivals, agrees))


def place_known(answer: Registration | NotRegistered) -> Registration | None:
    """Return where the board lies by an answer that is accepted, or refused only for how little agrees.

    Ink and openings that lie off their copper make much disagree though every metal edge is where it should be: where
    that is so, `fit_layers` may ask how far off they are.
    """
    if isinstance(answer, Registration):
        return answer
    best = answer.best
    if best is None or answer.reason is not Refusal.NOT_THIS_BOARD:
        return None
    sure = best.log_odds >= LEAST_ODDS and best.near.cells > 0 and best.agreement >= PLACE_AGREEMENT
    return best if sure and best.near.confirmed >= PLACE_CONFIRMED else None


def open_picture(
    red_bgr: Bgr, board_to_px: NDArray[np.float64], hidden_px: Sequence[NDArray[np.float64]]
) -> Picture | NotRegistered:
    """Check the picture and take its red signal."""
    plane = red_signal(check_bgr(red_bgr))
    # One pixel of sixteen is enough to see how bright it is.
    bad = check_exposure(plane[::4, ::4], _DARK_LEVEL, _DARK_PERCENTILE, _CLIPPED_SHARE)
    if isinstance(bad, NotFound):
        return NotRegistered(Refusal.FRAME_UNUSABLE, bad.message)
    return Picture.of(plane, board_to_px, hidden_px)


def _hypotheses(reference: Reference, picture: Picture, shown: wide.Shown, per_um: float, *, alone: bool) -> list[Fit]:
    """Return all places that the neighbourhood allows, refined, no two the same.

    alone: the board is asked for, and not a target: near the place there need be no metal, nor much else.
    """
    searched = reference.spectra
    middle = reference.middle
    per_cell = middle.planes.grid.cell_um * per_um
    problem = Problem(middle, picture, per_cell, REFINE_STEPS, most=600, still_cells=STILL_CELLS)
    border = (shown.grid.rows - searched.window.rows) // 2
    part = np.s_[border : border + searched.window.rows, border : border + searched.window.columns]
    broad = replace(problem, sheet=reference.wide, px_per_cell=reference.wide.planes.grid.cell_um * per_um, most=1500)
    fits: list[Fit] = []
    for peak in spectra.search(searched, shown.levels[part], shown.seen[part], metal=not alone):
        start = Pose(peak.x_um, peak.y_um, 0.0, reference.about_um)
        fit = refine(problem, start)
        if reference.has_parts or alone:
            # There may be too little near to tell the turn.
            wider = refine(broad, start if fit is None else fit.pose)
            fit = fit if wider is None else _with_near_levels(wider, problem)
        if fit is not None and all(_apart(fit.pose, other.pose) > SAME_UM for other in fits):
            fits.append(fit)
    return sorted(fits, key=lambda fit: -fit.explained)


def _with_near_levels(fit: Fit, near: Problem) -> Fit:
    """Return a fit of wide cells with levels by those near, as far as these have them: they hold narrow ink alone."""
    sheet = near.sheet
    levels = sheet.estimate(*near.picture.on(sheet.planes.grid, fit.pose, near.px_per_cell))
    grey = np.where(levels.measured, levels.grey, fit.levels.grey)
    return replace(fit, levels=Levels(grey, levels.measured | fit.levels.measured))


def _apart(one: Pose, other: Pose) -> float:
    return math.hypot(one.x_um - other.x_um, one.y_um - other.y_um)


def _compare(
    reference: Reference, shown: wide.Shown, fits: list[Fit]
) -> tuple[list[Candidate], NDArray[np.float64], int]:
    """Compare the best with every hypothesis and every alias that CAD has of it; whoever beats it is the next best.

    Return the candidates, the log odds of the last best against each, and which it is. It may not be the best of all
    (a beats b beats c beats a): then it has an odds below 0 and is refused.
    """
    candidates = [(fit, _laid(reference, shown, fit)) for fit in fits]
    best, tried = 0, {-1}
    while best not in tried:
        tried.add(best)
        fresh = _aliases(reference, candidates[best][0], [fit for fit, _ in candidates])
        # An alias is the same picture elsewhere: its levels are those of what it is an alias of.
        levels = candidates[best][1].levels
        candidates += [(fit, wide.draw_view(reference.wide, shown, fit.pose, levels)) for fit in fresh]
        odds = np.array([wide.log_odds(candidates[best][1], other, shown) for _, other in candidates])
        odds[best] = np.inf
        if odds.min() < 0.0 and int(odds.argmin()) not in tried:
            best = int(odds.argmin())
    return candidates, odds, best


def _laid(reference: Reference, shown: wide.Shown, fit: Fit) -> wide.View:
    levels = wide.wide_levels(reference.wide, shown, fit.pose, fit.levels)
    return wide.draw_view(reference.wide, shown, fit.pose, levels)


def _aliases(reference: Reference, best: Fit, known: list[Fit]) -> list[Fit]:
    """Return the places at which CAD would look like this near the target, out of the search's reach included."""
    turn = best.pose.matrix[:2, :2]
    fresh = []
    for lag in reference.aliases_um:
        dx, dy = turn @ lag
        pose = replace(best.pose, x_um=best.pose.x_um - float(dx), y_um=best.pose.y_um - float(dy))
        if all(_apart(pose, fit.pose) > SAME_UM for fit in known):
            fresh.append(replace(best, pose=pose))
    return fresh


def _rivals(
    candidates: list[Candidate], odds: NDArray[np.float64], winner: int, place_um: tuple[float, float]
) -> tuple[Rival, ...]:
    rivals = [
        Rival((fit.pose.x_um, fit.pose.y_um), fit.pose.apply(*place_um), float(odds[k]))
        for k, (fit, _) in enumerate(candidates)
        if k != winner
    ]
    return tuple(sorted(rivals, key=lambda rival: rival.log_odds))


def decide(found: Registration | None) -> Registration | NotRegistered:
    """Accept what was found, or say why not."""
    if found is None:
        return NotRegistered(Refusal.NO_BOARD, "too little of the board can be seen about the target")
    near = found.near
    if found.log_odds < LEAST_ODDS:
        rival = found.rivals[0]
        apart = math.hypot(rival.shift_um[0] - found.shift_um[0], rival.shift_um[1] - found.shift_um[1])
        message = (
            f"two places fit alike, {apart:.0f} um apart (log odds {found.log_odds:.1f}, "
            f"{LEAST_ODDS} are needed): look where more of the board tells them apart"
        )
        return NotRegistered(Refusal.AMBIGUOUS, message, found)
    least_metal = LEAST_METAL_BESIDE_PARTS if found.assembled else LEAST_METAL
    least_confirmed = LEAST_SOLDERED if near.soldered else LEAST_CONFIRMED
    metal_missing = found.agreement < SURE_AGREEMENT and found.metal_seen < least_metal
    few_edges = near.cells > 0 and near.confirmed < least_confirmed
    sure = found.metal_seen >= LEAST_METAL and near.cells >= LEAST_NEAR and near.confirmed >= SURE_EDGES
    least = LEAST_AGREEMENT if sure or found.at_target is not None else LEAST_ALONE
    if found.agreement < least or metal_missing or few_edges:
        message = (
            f"the picture is not what CAD says: {found.agreement:.2f} of what is seen or expected agrees "
            f"({least} needed), {found.metal_seen:.2f} of its metal is seen ({least_metal} needed), "
            f"{near.confirmed:.2f} of the metal edges near are confirmed ({least_confirmed} needed)"
        )
        return NotRegistered(Refusal.NOT_THIS_BOARD, message, found)
    return _target_confirmed(found)


def _target_confirmed(found: Registration) -> Registration | NotRegistered:
    at_target = found.at_target
    if at_target is None:
        if found.near.cells >= LEAST_NEAR:
            return found
        message = (
            "too little metal or ink is near to say where the board is "
            f"({found.near.cells} cells of edge): look elsewhere"
        )
        return NotRegistered(Refusal.AMBIGUOUS, message, found)
    off_um = float(np.hypot(*found.off_rest_um))
    if at_target.hidden > 1.0 - LEAST_SEEN or at_target.cells == 0:
        message = (
            f"{100 * at_target.hidden:.0f} % of the target's edge is hidden or out of sight: look from another place"
        )
    elif at_target.confirmed < LEAST_CONFIRMED or at_target.contradicted > MOST_CONTRADICTED:
        message = (
            f"the board is where it was found, but the target is missing or covered: {at_target.confirmed:.2f} of its "
            f"edge is confirmed ({LEAST_CONFIRMED} needed), {at_target.contradicted:.2f} contradicted"
        )
    elif off_um > MOST_OFF_REST_UM:
        message = f"the target lies {off_um:.0f} um off the rest of the board ({MOST_OFF_REST_UM:.0f} um at most)"
    else:
        return found
    return NotRegistered(Refusal.TARGET_NOT_CONFIRMED, message, found)
