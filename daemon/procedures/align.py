"""Board alignment: look at the fiducials, or at the places of the seat, and fit CAD to what was seen.

Three points align the board. Where the board file has layers, the looks are registered, and places that are found once
on the board verify the seat.
"""

from __future__ import annotations

import math

import numpy as np

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.procedures.aiming import UNCLEAR, Aim, look_and_aim
from daemon.procedures.calibrate.commit import Began, keep, on_disk, tell_old
from daemon.procedures.correct import sidestep_um
from daemon.procedures.height import require_free
from daemon.procedures.move_sequence import MoveSequence, shifted
from daemon.procedures.seat import seat_points, seat_stop, see_seat
from daemon.storage.alignment_void import Void
from daemon.storage.calibration_records import Aligned, AlignmentLimits, AlignmentRecord, Seat
from daemon.wire.operations.jobs import Align
from drivers.gantry import Position
from vision.geometry import Alignment, Array, PoseMap
from vision.geometry import align as fit_board

LEAST = 3
MAX_RESIDUAL_UM = 60.0
"""Of one fiducial: what two head angles may differ by, and five sigma of the stops."""
MAX_SCALE_ERROR = 0.002
"""A board is etched to better than this; more says that the wrong things were seen."""
MAX_TURN_DEG = 3.0
SCATTER_UM = 6.0
"""Of a fiducial's coordinate, one sigma; what three fiducials' residuals say of it is next to nothing."""


async def align(job: JobContext, context: StationContext, request: Align) -> Outcome:
    """Look at the fiducials from the head angles asked for and keep the board's pose; else none is in force."""
    tell_old(job, context, "alignment")
    context.calibrations.require_probe()
    by_seat = context.by_cad and request.fiducials is None
    points = await seat_points(context, request.thetas_deg) if by_seat else _fiducials(request, context)
    pose_map = context.require_map()
    await context.station.require_homed(job)
    stops = [(p, seat_stop(context, p.place_um, theta)) for theta in request.thetas_deg for p in points]
    _check_reach(context, [place for _, place in stops])
    await _begin(job, context, request)
    job.fire(Event.ACCEPTED)
    sequence, began = MoveSequence(job, context), Began.now(job)
    seat: Seat | None = None
    views: dict[str, list[Array]] = {p.name: [] for p in points}
    if context.by_cad:
        try:
            seen = await see_seat(sequence, points, request.thetas_deg, pose_map, named=not by_seat)
        except Fault as unseen:
            await _void(context, request, f"did not pass: {unseen.message}")
            raise
        seat, views, stops = seen.seat(), seen.views, []
        points = [p for p in points if p.name in views]
    for n, (point, place) in enumerate(stops):
        job.progress(n, len(stops), f"looking at {point.name}")
        views[point.name].append(await _place_um(sequence, point, place, pose_map))
    fitted = _fit(points, views, context)
    record = _record(
        fitted, points, views, context, began.facts(job, context) | {"board_id": request.board_id, "seat": seat}
    )
    kept = await keep(job, context, record)
    return Outcome("aligned", detail=_told(record, context) | kept)


async def _begin(job: JobContext, context: StationContext, request: Align) -> None:
    """Hold the old pose for void: who aligns doubts it, and however this ends, only one that passes is true."""
    await _void(context, request, "did not pass")
    tell_old(job, context, "alignment")


async def _void(context: StationContext, request: Align, how: str) -> None:
    which = f" of board {request.board_id}" if request.board_id is not None else ""
    why = f"the last alignment{which} (job {request.id[:64]}) {how}"
    await on_disk(context.calibrations.void_alignment, Void(why, request.board_id))


def _fiducials(request: Align, context: StationContext) -> list[BoardPoint]:
    """Return the targets to look at: those named, else the board's own fiducials."""
    if request.fiducials is not None:
        twice = {name for name in request.fiducials if request.fiducials.count(name) > 1}
        if twice:
            raise Fault(FaultCode.INVALID_REQUEST, f"{', '.join(sorted(twice))} is named twice")
        return [context.board.find(name) for name in request.fiducials]
    found = [p for p in context.board.points if p.kind == "fiducial"]
    if len(found) < LEAST:
        raise Fault(
            FaultCode.INVALID_REQUEST,
            f"board {context.board.name} has {len(found)} fiducials on its {context.board.side}; {LEAST} are needed",
            advice="name three or more round targets far apart that stand alone",
        )
    return found


def _check_reach(context: StationContext, places: list[Position]) -> None:
    """Raise where a place, as far off as a board may lie, is out of the machine's reach."""
    r = context.servo.max_placement_um
    for place in places:
        context.station.check(shifted(place, -r, -r))
        context.station.check(shifted(place, r, r))


async def _place_um(sequence: MoveSequence, point: BoardPoint, place: Position, pose_map: PoseMap) -> Array:
    """Look at one fiducial and return where it is in the robot frame."""
    try:
        aim = await _aim(sequence, point, place, pose_map)
    except Fault as unclear:
        raise Fault(
            unclear.kind,
            f"{point.name} was not seen at {place.theta_deg:.0f} deg: {unclear.message}",
            advice="see that this board lies in its nest, this side up; name other round targets if that one is dirty",
            **{k: v for k, v in unclear.detail.items() if k != "advice"},
        ) from unclear
    await require_free(sequence.job, sequence.context, pose_map, sequence.go)
    here = aim.look.position
    way = aim.correction.dx_um, aim.correction.dy_um
    seen: Array = sequence.context.geometry.tip_um(here) + way
    return seen


async def _aim(sequence: MoveSequence, point: BoardPoint, place: Position, pose_map: PoseMap) -> Aim:
    """Look; if the needle stands in the way, look once more from beside."""
    position = await sequence.go(place)
    try:
        return await look_and_aim(sequence.job, sequence.context, position, point, pose_map)
    except Fault as unclear:
        if unclear.kind not in UNCLEAR:
            raise
    dx, dy = sidestep_um(sequence.context, point, pose_map, place.theta_deg)
    longest = sequence.context.servo.max_placement_um / max(1.0, math.hypot(dx, dy))
    share = min(1.0, longest)
    position = await sequence.go(shifted(place, dx * share, dy * share))
    return await look_and_aim(sequence.job, sequence.context, position, point, pose_map)


def _fit(points: list[BoardPoint], views: dict[str, list[Array]], context: StationContext) -> Alignment:
    """Fit the board's pose to the mean of each fiducial's views, or say what speaks against it."""
    try:
        return fit_board(
            np.array([p.place_um for p in points]),
            np.array([np.mean(views[p.name], axis=0) for p in points]),
            names=[p.name for p in points],
            max_residual_um=MAX_RESIDUAL_UM,
            max_scale_error=MAX_SCALE_ERROR,
            nominal=context.config.board.pose(),
            max_shift_um=context.servo.max_placement_um,
            max_turn_deg=MAX_TURN_DEG,
            least_scatter_um=SCATTER_UM,
        )
    except ValueError as exc:
        raise Fault(FaultCode.CALIBRATION_FAILED, f"the board cannot be aligned: {exc}") from exc


def _record(
    fitted: Alignment,
    points: list[BoardPoint],
    views: dict[str, list[Array]],
    context: StationContext,
    facts: dict[str, object],
) -> AlignmentRecord:
    pose = fitted.pose
    seen = [np.mean(views[p.name], axis=0) for p in points]
    return AlignmentRecord(
        **facts,  # type: ignore[arg-type]  # checked by the model
        board=context.board.name,
        side=context.board.side,
        theta_deg=pose.theta_deg,
        scale=pose.scale,
        tx_um=pose.tx,
        ty_um=pose.ty,
        rms_um=fitted.rms_um,
        fiducials=tuple(
            Aligned(
                name=p.name,
                board_um=p.place_um,
                robot_um=(float(at[0]), float(at[1])),
                residual_um=(float(r[0]), float(r[1])),
                views=len(views[p.name]),
            )
            for p, at, r in zip(points, seen, fitted.residuals_um, strict=True)
        ),
        limits=AlignmentLimits(residual_um=MAX_RESIDUAL_UM, scale_error=MAX_SCALE_ERROR, turn_deg=MAX_TURN_DEG),
    )


def _told(record: AlignmentRecord, context: StationContext) -> dict[str, object]:
    """Return the figures for the answer: how the board lies beside where the configuration has it."""
    middle = np.array((context.board.width_um / 2, context.board.height_um / 2))
    shift = context.geometry.board_to_robot_um(middle) - context.geometry.nominal_um(middle)
    seat = record.seat
    told = {"verified": seat.verified, "places": seat.places, "agreement": seat.agreement} if seat is not None else None
    return ({} if told is None else {"seat": told}) | {
        "board": record.board,
        "side": record.side,
        "fiducials": len(record.fiducials),
        "shift_um": [round(float(v), 1) for v in shift],
        "turn_deg": round(record.theta_deg - context.config.board.rotation_deg, 4),
        "scale_ppm": round((record.scale - 1.0) * 1e6),
        "rms_um": round(record.rms_um, 1),
    }
