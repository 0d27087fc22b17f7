"""Decisions by the verified seat: what a picture leaves open, the seat may settle, and the look says so.

It breaks a tie only if one place of it alone is where the seat has the board, and lets a view count that is too poor to
say which board this is. All that is asked of other registrations is asked of these as well.
"""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace

from daemon.jobs.context import StationContext
from daemon.procedures.seat_state import limit_um, verified
from daemon.station.board_view import accept, settle
from daemon.station.station import LookResult
from vision import Tip
from vision.registration import NotRegistered, Refusal, Registration

TIE_ODDS = 9.2
"""Log odds below which a rival counts as one of a tie; 1 : 10,000, as registration has it."""
SHOWN, MOST_CONTRADICTED = 0.6, 0.3
SHOWN_ASTRAY, EDGES_ASTRAY = 0.75, 0.8
"""Agreement, and share of the metal edges near, where the head may stand elsewhere than its drives believe: as much as
of a look for the board alone. The seat then says which board this is and how it is turned, and not where."""


async def decide_by_seat(look: LookResult, context: StationContext, astray_um: float | None = None) -> LookResult:
    """Return the look with what the verified seat decided, `left_open` tells what; else the look as it is.

    astray_um: so far from where its drives have it the head may stand.
    """
    seen = look.board
    if seen is None or look.red is None or not isinstance(look.tip, Tip) or not verified(context):
        return look
    best = seen.found.best if isinstance(seen.found, NotRegistered) else None
    if not isinstance(seen.found, NotRegistered) or best is None:
        return look
    within_um, pixels = limit_um(context), look.red.pixels
    poor = seen.found.reason is Refusal.NOT_THIS_BOARD and _shows_target(best)
    if poor and (math.hypot(*best.shift_um) <= within_um or _shows_it_astray(best, astray_um)):
        return replace(look, board=await asyncio.to_thread(accept, seen, pixels, look.tip, best))
    at_seat = _of_tie_at_seat(best, within_um) if seen.found.reason is Refusal.AMBIGUOUS else None
    if at_seat is None:
        return look
    return replace(look, board=await asyncio.to_thread(settle, seen, pixels, look.tip, at_seat))


def _of_tie_at_seat(best: Registration, within_um: float) -> tuple[float, float] | None:
    """Return the one shift of a tie that is where the seat has the board; None where there is none, or several."""
    shifts = [best.shift_um, *(r.shift_um for r in best.rivals if r.log_odds < TIE_ODDS)]
    near = [shift for shift in shifts if math.hypot(*shift) <= within_um]
    return near[0] if len(near) == 1 else None


def _shows_it_astray(best: Registration, astray_um: float | None) -> bool:
    """Whether a view that shows the target shows so much more of this board that its place in it may be believed."""
    if astray_um is None or math.hypot(*best.shift_um) > astray_um:
        return False
    edges = best.near.cells > 0 and best.near.confirmed >= EDGES_ASTRAY
    return edges and best.agreement >= SHOWN_ASTRAY


def _shows_target(best: Registration) -> bool:
    """Whether a view too poor to say which board this is shows the target.

    So much of the view, of the metal edges near and of the target's own edge must agree as of any other board.
    """
    if best.at_target is None:
        return False
    there = best.at_target.confirmed >= SHOWN and best.at_target.contradicted <= MOST_CONTRADICTED
    return there and _shows_board(best)


def shows_place(best: Registration) -> bool:
    """Whether such a view shows its place: the target if one was asked for, else the metal edges near."""
    return _shows_board(best) and best.near.cells > 0 if best.at_target is None else _shows_target(best)


def _shows_board(best: Registration) -> bool:
    near = not best.near.cells or best.near.confirmed >= SHOWN
    return near and best.agreement >= SHOWN and best.log_odds >= TIE_ODDS
