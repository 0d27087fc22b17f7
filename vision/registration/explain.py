"""Why a picture could not be registered: the board turned, the other side up, elsewhere, another one, or none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.core import Bgr
from vision.registration import wide
from vision.registration.answer import NotRegistered, Refusal
from vision.registration.rectify import Picture, Pose
from vision.registration.refine import Problem, refine
from vision.registration.register import open_picture
from vision.registration.sheet import Sheet, make_sheet
from vision.registration.whole import Place, Whole, find_places

EXPLAINS, NOT_SO = 0.6, 0.4
"""Another lie of the board is named when it explains so much and this one less than that (or by so much less)."""
MARGIN = 0.2
DISTINCT = 0.1
"""Of two ways to lie that have different names, and explain the picture so nearly alike, neither is named."""
IN_NEST_UM, EXPLAINS_FAR = 10_000.0, 0.75
"""A nest holds the board's middle within this, however the board lies in it. Of ways that explain the picture alike
those are meant that the nest allows; any other has to explain more."""
MOST_BESIDE, MUCH_BRIGHT = 0.5, 0.05
"""What has more of all that is bright beside the board explains nothing, for agreement asks for what lies on it alone;
where so much of the view is bright."""
PEAKS = 2
_SAME_UM = 100.0
BRIGHT, LEAST_BRIGHT, LEAST_GREY = 0.9, 0.003, 6.0
"""Metal and ink are brighter than all else by this share; of less of the view a bench's own grain is all there is."""
LEAST_STRUCTURE = 0.01
"""Of the cells in view: less that stands out is no board."""


@dataclass(frozen=True, slots=True)
class Lie:
    """A way the board may lie: side, turn, where CAD's place seen at the target is, how much that explains.

    middle_off_um: how far the board's middle is off where it should be, as far as a corner's stops do not make it.
    """

    other_side: bool
    turn_deg: float
    x_um: float
    y_um: float
    agreement: float
    off_um: tuple[float, float]
    middle_off_um: float


def explain(
    refused: NotRegistered,
    red_bgr: Bgr,
    board_to_px: NDArray[np.float64],
    about_um: tuple[float, float],
    here: Whole,
    other: Whole | None = None,
    hidden_px: Sequence[NDArray[np.float64]] = (),
) -> NotRegistered:
    """Return the refusal with the reason that the whole board gives: all sides, turns and places are tried.

    about_um: the place that was looked at. here, other: the sides, drawn whole. Some tenths of a second.
    """
    picture = open_picture(red_bgr, board_to_px, hidden_px)
    if isinstance(picture, NotRegistered):
        return picture
    if _empty(picture, about_um, here):
        return NotRegistered(Refusal.NO_BOARD, "no board is seen: the red picture is one dark plane", refused.best)
    ranked = find_lies(picture, about_um, here, other)
    own = refused.best.agreement if refused.best is not None else 0.0
    best = ranked[0] if ranked else None
    if best is None or best.agreement < EXPLAINS:
        if _standing_out(picture, about_um, here, BRIGHT, LEAST_GREY) < LEAST_BRIGHT:
            return NotRegistered(
                Refusal.NO_BOARD, "no board is seen: nothing as bright as metal or ink is in view", refused.best
            )
        if own >= EXPLAINS:
            return refused  # as it should lie the board explains it well enough; what else was wrong is said already
        reached = max([own, *(lie.agreement for lie in ranked)])
        message = (
            "what is seen is on neither side of this board, however turned: "
            f"{reached:.2f} of it agrees at best ({EXPLAINS} needed)"
        )
        return NotRegistered(Refusal.NOT_THIS_BOARD, message, refused.best)
    return named(refused, ranked, own)


def named(refused: NotRegistered, ranked: list[Lie], own: float) -> NotRegistered:
    """Return the refusal by the name of what explains the picture; none where ways of different names explain it alike.

    ranked: ways the board may lie, most explained first, one at least. own: how much is explained as it should lie.
    """
    alike = [lie for lie in ranked if lie.agreement > max(ranked[0].agreement - DISTINCT, EXPLAINS)]
    alike = [lie for lie in alike if lie.middle_off_um <= IN_NEST_UM] or alike
    best = alike[0] if alike else ranked[0]
    plain = own < NOT_SO or best.agreement > own + MARGIN
    name = _name(best)
    if not plain or name is None:
        return refused
    rival = next((lie for lie in alike if _name(lie) is not name), None)
    if best.middle_off_um > IN_NEST_UM and best.agreement < EXPLAINS_FAR and own < NOT_SO:
        message = (
            f"what is seen is not how the board should lie; the board {_told(best)} explains "
            f"{best.agreement:.2f} of it, too little for one so far off its nest ({EXPLAINS_FAR} needed)"
        )
        return NotRegistered(Refusal.NOT_THIS_BOARD, message, refused.best)
    if rival is not None and own < NOT_SO:
        message = (
            f"the board does not lie as it should, and how it does cannot be told from here: {_told(best)} explains "
            f"{best.agreement:.2f} of what is seen, and {_told(rival)} {rival.agreement:.2f}"
        )
        return NotRegistered(Refusal.NOT_THIS_BOARD, message, refused.best)
    return NotRegistered(name, f"the board lies {_told(best)}", refused.best)


def _name(lie: Lie) -> Refusal | None:
    """Return what a lie is called; None: the board lies as it should."""
    if lie.other_side:
        return Refusal.WRONG_SIDE
    if abs(lie.turn_deg) > 45.0:
        return Refusal.BOARD_TURNED
    return Refusal.WRONG_PLACE if float(np.hypot(*lie.off_um)) > _SAME_UM else None


def _told(lie: Lie) -> str:
    """Return a lie in words that follow "the board lies"."""
    turn = f"turned by {lie.turn_deg:.0f} degrees" if abs(lie.turn_deg) > 45.0 else ""
    if lie.other_side:
        return f"with its other side up, {turn}" if turn else "with its other side up"
    return turn or f"{lie.off_um[0]:.0f}, {lie.off_um[1]:.0f} um off where it should"


def find_lies(picture: Picture, about_um: tuple[float, float], here: Whole, other: Whole | None) -> list[Lie]:
    """Return how the board may lie, most explained first."""
    lies: list[Lie] = []
    for whole, other_side in ((here, False), (other, True)):
        if whole is None:
            continue
        cell = whole.search.grid.cell_um
        grid = wide.window(about_um, cell)
        shown, seen = picture.on(grid, Pose(), cell / picture.um_per_px(*about_um))
        lies += [_lie(picture, about_um, whole, place, other_side=other_side)
                 for place in find_places(whole, shown, seen, PEAKS)]  # fmt: skip
    return sorted(lies, key=lambda lie: -lie.agreement)


def _lie(picture: Picture, about_um: tuple[float, float], whole: Whole, place: Place, *, other_side: bool) -> Lie:
    """Refine one place and say how much of the picture it explains."""
    # Rows run with y: a quarter of `rot90` turns the picture clockwise until it fits, so CAD lies counter-clockwise.
    turn = 90.0 * place.quarters if place.quarters < 3 else -90.0
    start = Pose(about_um[0] - place.x_um, about_um[1] - place.y_um, turn, (place.x_um, place.y_um))
    cell_um = whole.wide.grid.cell_um
    per_cell = cell_um / picture.um_per_px(*about_um)
    # Levels are sampled all over a sheet: it must be no larger than what is seen.
    sheet = make_sheet(whole.wide.around(place.x_um, place.y_um, 1.2 * wide.WIDE_UM))
    fit = refine(Problem(sheet, picture, per_cell, 4, turn_deg=turn), start)
    shown = wide.look(picture, about_um, cell_um, per_cell)
    agrees = 0.0
    if fit is not None:
        start = fit.pose
        levels = wide.wide_levels(sheet, shown, fit.pose, fit.levels)
        if _bright_beside(sheet, shown, fit.pose) <= MOST_BESIDE:
            agrees = wide.agreement(sheet, shown, wide.draw_view(sheet, shown, fit.pose, levels)).all
    there = start.apply(*about_um)
    off = (there[0] - about_um[0], there[1] - about_um[1])
    return Lie(other_side, start.turn_deg, place.x_um, place.y_um, agrees, off, _middle_off_um(whole, start))


def _bright_beside(sheet: Sheet, shown: wide.Shown, pose: Pose) -> float:
    """Return which share of what is as bright as metal or ink a hypothesis has beside the board; 0 where little is."""
    levels = shown.levels[shown.seen]
    middle = float(np.median(levels)) if len(levels) else 0.0
    bright = shown.seen & (shown.levels - middle > max(BRIGHT * middle, LEAST_GREY))
    count = np.count_nonzero(bright)
    if count <= MUCH_BRIGHT * len(levels):
        return 0.0
    return float(np.count_nonzero(bright & wide.beside_board(sheet, shown, pose)) / count)


def _middle_off_um(whole: Whole, pose: Pose) -> float:
    """Return how far a board's middle is off; of a quarter's turn by no more than the stops of a corner account for.

    Both sides have their middle at the same place of their own frames.
    """
    x0, y0, x1, y1 = whole.box_um
    middle = ((x0 + x1) / 2, (y0 + y1) / 2)
    there = pose.apply(*middle)
    off = np.abs(np.subtract(there, middle))
    if 45.0 < abs(pose.turn_deg) < 135.0:
        off = np.maximum(off - abs((x1 - x0) - (y1 - y0)) / 2, 0.0)
    return float(np.hypot(*off))


def _empty(picture: Picture, about_um: tuple[float, float], here: Whole) -> bool:
    """Whether nothing stands out: no structure beyond the noise."""
    return _standing_out(picture, about_um, here, 0.15, 3.0) < LEAST_STRUCTURE


def _standing_out(picture: Picture, about_um: tuple[float, float], here: Whole, share: float, least: float) -> float:
    """Return how much of what is seen is off the middle level by more than that share of it, and `least` grey."""
    cell_um = here.wide.grid.cell_um
    shown = wide.look(picture, about_um, cell_um, cell_um / picture.um_per_px(*about_um))
    levels = shown.levels[shown.seen]
    if not len(levels):
        return 0.0
    middle = float(np.median(levels))
    return float(np.mean(np.abs(levels - middle) > max(share * middle, least)))
