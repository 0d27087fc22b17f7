"""Faults of registration, in words for the operator: what happened, what it means, what to do."""

from __future__ import annotations

import math
from typing import Literal

from daemon.domain.board import Board, BoardPoint
from daemon.domain.errors import Fault, FaultCode
from vision.registration import NotRegistered, Refusal, Registration

CODES = {
    Refusal.FRAME_UNUSABLE: FaultCode.FRAME_UNUSABLE,
    Refusal.AMBIGUOUS: FaultCode.AMBIGUOUS,
    Refusal.WRONG_PLACE: FaultCode.WRONG_PLACE,
    Refusal.BOARD_TURNED: FaultCode.BOARD_TURNED,
    Refusal.WRONG_SIDE: FaultCode.WRONG_SIDE,
    Refusal.NO_BOARD: FaultCode.NO_BOARD,
    Refusal.NOT_THIS_BOARD: FaultCode.NOT_THIS_BOARD,
    Refusal.TARGET_NOT_CONFIRMED: FaultCode.TARGET_NOT_CONFIRMED,
}
NAMED_WITHIN_UM = 200.0
MOST_RIVALS = 3
LAMP_IN_DOUBT = frozenset({"too_dark", Refusal.FRAME_UNUSABLE.value})


def refusal_fault(refused: NotRegistered, point: BoardPoint, board: Board) -> Fault:
    """Return the fault that a refusal of registration is; `point`: what was looked at."""
    best = refused.best
    detail: dict[str, object] = {"test_point": point.name}
    message = f"{point.name}: {refused.message}"
    if refused.reason is Refusal.FRAME_UNUSABLE:
        return unusable_frame(refused.message, refused.reason.value, "red", **detail)
    if best is not None:
        detail |= _numbers(best)
        if refused.reason is Refusal.AMBIGUOUS and best.rivals:
            message += _taken_for(best, point, board)
    if refused.reason is Refusal.AMBIGUOUS:
        detail["advice"] = "send `align`: a verified seat tells such places apart; or touch another point of its net"
    return Fault(CODES[refused.reason], message, **detail)


def unusable_frame(why: str, reason: str, lamp: Literal["white", "red"], **detail: object) -> Fault:
    """Return the fault of a picture that cannot be worked with; it names the lamp under which it was taken."""
    if reason in LAMP_IN_DOUBT:
        detail["advice"] = (
            f"see whether the {lamp} ring shines during a look: if not, check its plug, its lamp and its relay channel "
            f"(lights.{lamp}); if it does, see that nothing covers lens or ring, and that the exposure is as it was"
        )
    message = f"the picture under {lamp} light cannot be used: {why}"
    return Fault(FaultCode.FRAME_UNUSABLE, message, lamp=lamp, reason=reason, **detail)


def board_away(
    point: BoardPoint,
    shift_um: tuple[float, float],
    where: str,
    *,
    since_um: tuple[float, float] = (0.0, 0.0),
) -> Fault:
    """Return the fault of a board that lies elsewhere, or of a head that is not where its drives count it to be."""
    dx, dy = shift_um[0] - since_um[0], shift_um[1] - since_um[1]
    return Fault(
        FaultCode.WRONG_PLACE,
        f"{point.name}: the board lies {math.hypot(dx, dy):.0f} um ({dx:+.0f}, {dy:+.0f} on the board) off {where}: "
        "it was moved, lifted or exchanged, or an axis lost steps",
        off_um=[round(dx, 1), round(dy, 1)],
        test_point=point.name,
    )


def _numbers(best: Registration) -> dict[str, object]:
    rivals = [
        {"target_um": [round(v, 1) for v in rival.target_um], "log_odds": round(rival.log_odds, 1)}
        for rival in best.rivals[:MOST_RIVALS]
    ]
    return {
        "off_um": [round(v, 1) for v in best.shift_um],
        "target_um": [round(v, 1) for v in best.target_um],
        "agreement": round(best.agreement, 3),
        "edges_confirmed": round(best.near.confirmed, 3),
        "log_odds": round(best.log_odds, 1),
        "rivals": rivals,
    }


def _taken_for(best: Registration, point: BoardPoint, board: Board) -> str:
    """Say which other pad the one that was found would be, if the nearest rival were true."""
    rival = best.rivals[0]
    there = (
        point.x_um + best.shift_um[0] - rival.shift_um[0],
        point.y_um + best.shift_um[1] - rival.shift_um[1],
    )
    near = min(board.points, key=lambda p: math.dist(p.middle_um, there), default=None)
    if near is None or near.name == point.name or math.dist(near.middle_um, there) > NAMED_WITHIN_UM:
        return ""
    return f"; what was found as {point.name} may be {near.name}"
