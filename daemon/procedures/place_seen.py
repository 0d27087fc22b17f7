"""Confirmation of a place: after a move the camera sees by CAD where the tip is, for a drive's count may lie."""

from __future__ import annotations

import math
from typing import Any

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.aiming import require_tip
from daemon.procedures.look_numbers import describe
from daemon.procedures.registered import believe, board_search, look_by_cad, recognise
from daemon.procedures.registration_faults import refusal_fault
from drivers.gantry import Position
from vision.registration import Registration

AGREES = 0.6
NO_ANSWER = frozenset({FaultCode.TIP_NOT_FOUND, FaultCode.AMBIGUOUS, FaultCode.NOT_ALIGNED})
"""What leaves open where the tip is; the answer then says that the drives alone vouch for it, and why."""


async def confirm_place(
    job: JobContext, context: StationContext, position: Position, point: BoardPoint | None
) -> dict[str, Any]:
    """Look and return for the answer what was seen; where nothing can be, for want of a probe or a valid map, why.

    {} where nothing is to be seen: a place that is no point, or with all that is needed a board without layers.
    What the picture left open and the verified seat decided confirms nothing: the seat goes by the drives' count.
    Raises `Fault` for what lies there instead of the place: another board, one that is turned or moved, or none.
    """
    if point is None:
        return {}
    try:
        probe, pose_map = context.calibrations.require_probe(), context.require_map()
    except Fault as missing:
        return _unconfirmed(missing)
    if not context.by_cad:
        return {}
    search = await board_search(context, position, point, pose_map, alone=True)
    look = await look_by_cad(job, context, position, probe, search, by_seat=True)
    job.note("look", describe(look, None, None))
    try:
        require_tip(look)
        seen = await believe(look, context, point)
    except Fault as unseen:
        if unseen.kind in NO_ANSWER or _too_little(unseen):
            return _unconfirmed(unseen)
        raise
    off_um = _off_um(context, position, seen.found)
    away_um = math.hypot(*off_um)
    told = {"off_um": [round(v, 1) for v in off_um], "away_um": round(away_um, 1)}
    if (beside_um := too_far_um(context, away_um)) is not None:
        # Where the seat is not verified the board may lie farther off than a first landing ends.
        return _unconfirmed(_beside(context, point, beside_um)) | told
    if look.board is not None and look.board.left_open is not None:
        return _unconfirmed(refusal_fault(look.board.left_open, point, context.board))
    recognise(context, look)
    return {"confirmed_by": "picture"} | told


def too_far_um(context: StationContext, away_um: float) -> float | None:
    """Return how far a look saw the point beside the tip, if that is too far to touch it from there."""
    return round(away_um, 1) if away_um > context.servo.first_landing_um else None


def _beside(context: StationContext, point: BoardPoint, beside_um: float) -> Fault:
    most_um = context.servo.first_landing_um
    why = f"{point.name} was seen {beside_um:.0f} um beside the tip (servo.first_landing_um: {most_um:g})"
    return Fault(
        FaultCode.NOT_AT_TEST_POINT, why, advice="send `correct` for it; where more lie so far off, `align` first"
    )


def _unconfirmed(why: Fault) -> dict[str, Any]:
    """Return what the answer says beside that the drives alone vouch for the place."""
    return {"unconfirmed": {"name": why.kind.wire_name, "message": why.message, "advice": why.advice}}


def _too_little(unseen: Fault) -> bool:
    """Whether what is seen agrees, and is only too little to say where the board is."""
    agreement = float(unseen.detail.get("agreement", 0.0))
    return unseen.kind is FaultCode.NOT_THIS_BOARD and agreement >= AGREES


def _off_um(context: StationContext, position: Position, found: Registration) -> tuple[float, float]:
    """Return by how much the target lies off the tip, robot frame."""
    dx_um, dy_um = context.geometry.from_tip_um((found.target_um[0], found.target_um[1]), position)
    return float(dx_um), float(dy_um)
