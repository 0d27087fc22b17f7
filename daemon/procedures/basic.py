"""Basic procedures: home, lift, place, look. They walk the same states as a correction."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.procedures.aiming import known_beforehand, look_and_aim
from daemon.procedures.board_in_nest import require_board
from daemon.procedures.free_needle import see_free
from daemon.procedures.height import describe_height, refuse_pushed
from daemon.procedures.look_numbers import describe
from daemon.procedures.place_seen import confirm_place, too_far_um
from daemon.procedures.seat_state import seat_shifts
from daemon.procedures.sites import sited
from daemon.station.station import Search
from daemon.wire.operations.jobs import Home, Lift, Look, Place
from drivers.gantry import Position

ARRIVED_WITHIN_UM = 10.0
FREE_LOOK_REACH_UM = 1000.0


async def home(job: JobContext, context: StationContext, _request: Home) -> Outcome:
    """Home all axes and see that the drives agree."""
    job.fire(Event.DEPARTED)
    job.moves += 1
    await context.station.home(job)
    job.fire(Event.ARRIVED)
    await context.station.require_homed(job)
    position = await context.station.position(job)
    if context.station.needle.may_be_down:
        raise context.station.needle.fault("the axes were homed, and Z is below the height of looks")
    return Outcome("homed", detail={"position": _numbers(position)})


async def lift(job: JobContext, context: StationContext, _request: Lift) -> Outcome:
    """Raise the needle straight up to the safe height, from wherever it is; nothing else moves."""
    await context.station.require_homed(job)
    job.fire(Event.DEPARTED)
    job.moves += 1
    with job.watch.spend("motion"):
        position = await context.station.retract(job.deadline)
    job.fire(Event.ARRIVED)
    if not context.station.needle.is_up:
        raise context.station.needle.fault("it was raised, and is not where it should be")
    await context.station.refuse_metal(job)
    return Outcome("lifted", detail={"position": _numbers(position)})


async def place(job: JobContext, context: StationContext, request: Place) -> Outcome:
    """Put the tip over a test point by the head model and the board's nominal pose.

    Where the board file has layers, the camera confirms the place; else it is what the drives say, and the answer tells
    which.
    """
    job.partial.test_point = request.test_point
    point = await _point_of(request, context)
    place_um = request.board_um if point is None else point.place_um
    if place_um is None:
        raise Fault(FaultCode.INVALID_REQUEST, "neither a test point nor a place was named")
    if request.board_id is not None:
        await require_board(context, request.board_id)
    await context.station.require_homed(job)
    target = context.geometry.position_over(place_um, request.theta_deg)
    context.station.check(target)
    if point is not None and context.by_cad:
        context.references.begin(point.place_um, seat_shifts(context))  # drawn while the head travels
    job.fire(Event.ACCEPTED)
    job.fire(Event.SEEN)
    job.moves += 1
    position = await context.station.go(
        target, job, slow_z_um=context.geometry.slow_z_um(target), clear=await context.clearance.by_calibration()
    )
    job.fire(Event.ARRIVED)
    away_um = math.dist((position.x_um, position.y_um, position.z_um), (target.x_um, target.y_um, target.z_um))
    if away_um > ARRIVED_WITHIN_UM:
        raise Fault(FaultCode.MOTION_FAILED, f"the axes stand {away_um:.0f} um from where they were sent")
    job.note("move", _numbers(target))
    position, seen = await _seen_there(job, context, position, point)
    target_um = [round(v, 1) for v in place_um]
    detail: dict[str, object] = {"position": _numbers(position), "confirmed_by": "drives", "target_um": target_um}
    detail |= describe_height(context, position)
    beside_um = too_far_um(context, seen.get("away_um", 0.0))
    return Outcome("placed", test_point=request.test_point, detail=detail | seen, beside_um=beside_um)


async def _seen_there(
    job: JobContext, context: StationContext, position: Position, point: BoardPoint | None
) -> tuple[Position, dict[str, Any]]:
    """See that the tip is over the place, and free; return where the head stands then, and what the answer tells."""

    async def go(target: Position) -> Position:
        job.fire(Event.OFF_TARGET)
        job.moves += 1
        reached = await context.station.go(target, job, slow_z_um=context.geometry.slow_z_um(target))
        job.fire(Event.ARRIVED)
        return reached

    try:
        seen = await confirm_place(job, context, position, point)
    except Fault:
        await see_free(job, context, position, go)  # what lies there instead may be higher
        raise
    return await see_free(job, context, position, go), seen


async def look(job: JobContext, context: StationContext, request: Look) -> Outcome:
    """Look once and tell what is seen. Nothing moves; without a taught probe only the frames are taken."""
    job.partial.test_point = request.test_point
    job.fire(Event.ACCEPTED)
    position = await context.station.position(job)
    if request.test_point is not None:
        point = await sited(context, context.board.point(request.test_point))
        pose_map = context.require_map()
        aim = await look_and_aim(job, context, position, point, pose_map, known_beforehand(context))
        refuse_pushed(context, aim.look, pose_map)
        return Outcome(
            "looked",
            test_point=point.name,
            error_before_um=round(aim.error_um, 2),
            detail=describe(aim.look, aim.target, aim.correction) | describe_height(context, position),
            beside_um=too_far_um(context, aim.error_um),
        )
    return Outcome("looked", detail=await _look_freely(job, context, position))


async def _look_freely(job: JobContext, context: StationContext, position: Position) -> dict[str, object]:
    """Look without expecting any size; the answer lists all that was taken."""
    probe, pose_map = context.calibrations.probe, context.calibrations.pose_map
    below_px = pose_map.below_px(context.geometry.height_below_um(position)) if pose_map else (0.0, 0.0)
    search = Search(below_px, FREE_LOOK_REACH_UM / context.camera.pitch_um, None)
    look = await context.station.look(position, probe, search, job)
    job.saw(look)
    body = describe(look, None, None)
    if pose_map is not None:
        refuse_pushed(context, look, pose_map)
    if look.seen is not None:
        body["taken"] = [
            {"x_px": round(p.x_px, 2), "y_px": round(p.y_px, 2), "kind": str(p.kind), "rule": p.rule}
            for p in look.seen.taken
        ]
    job.note("look", body)
    return body


async def _point_of(request: Place, context: StationContext) -> BoardPoint | None:
    """Return the target asked for; None for a place. Fiducials may be looked at, though never touched."""
    if request.board_um is not None:
        return None
    point = context.board.find(request.test_point or "")
    return await sited(context, point) if point.probeable else point


def _numbers(position: Position) -> dict[str, float]:
    return {name: round(value, 4) for name, value in asdict(position).items()}
