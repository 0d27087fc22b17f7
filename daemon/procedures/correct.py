"""Correction: look, move, look again, until the tip is on the pad (thesis figure 5.2; PBVS look-and-move)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.procedures.aiming import Aim, Prior, another_view_helps, known_beforehand, look_and_aim
from daemon.procedures.board_in_nest import require_board
from daemon.procedures.free_needle import see_free
from daemon.procedures.height import StoodOn, describe_height, require_free
from daemon.procedures.pad_sites import on_metal_within_um
from daemon.procedures.registered import recognise
from daemon.procedures.sites import extent_um, sited
from daemon.station.device_errors import as_fault
from daemon.station.safe_shutdown import UNSURE
from daemon.wire.operations.jobs import Correct
from drivers.errors import DeviceError
from drivers.gantry import ClearHeight, Position
from vision.geometry import PoseMap

SIDESTEP_MARGIN_PX = 4.0
ASIDE_SHARE = 0.8


async def correct(job: JobContext, context: StationContext, request: Correct) -> Outcome:
    """Bring the tip onto the test point it missed; a `Fault` says why that could not be done."""
    point, pose_map, start = await admit(job, context, request)
    job.fire(Event.ACCEPTED)
    start = await _to_look_height(job, context, start)
    landed = await bring_onto(job, context, start, point, pose_map)
    outcome = "corrected" if landed.steps else "already_on_target"
    return _outcome(outcome, point, landed.before_um, landed.aim, context)


@dataclass(frozen=True)
class Landed:
    """The tip is on the target, as the last look showed: how far it was off before, and how many steps it took."""

    before_um: float
    aim: Aim
    steps: int
    begun_elsewhere: bool = False
    """Whether the head was put elsewhere first, so that `before_um` says nothing of where it stood."""


async def bring_onto(
    job: JobContext, context: StationContext, start: Position, point: BoardPoint, pose_map: PoseMap,
    *, astray: bool = False, stood: StoodOn | None = None,
) -> Landed:  # fmt: skip
    """Look, and move until a look shows the tip on the target; a `Fault` says why that could not be done.

    `astray`: any way may have ended beside its place, and what is seen off it says nothing of the board.
    `stood`: the needle was just lifted off what it stood on; `start` is counted for nothing.
    """
    begun, prior = job.steps, known_beforehand(context, astray=astray)
    if stood is None:
        aim = await _first_aim(job, context, start, point, pose_map, prior)
    else:
        aim, start = await _look_off(job, context, stood, point, pose_map, prior), stood.freed
    before_um = math.dist(aim.place_um, (start.x_um, start.y_um))
    job.partial.error_before_um = round(before_um, 2)
    tolerance_um = context.servo.tolerance_um
    if aim.error_um <= tolerance_um:
        return Landed(before_um, aim, job.steps - begun)
    while job.steps - begun < context.servo.max_moves:
        clear = await context.clearance.as_seen(aim.shift_um)
        position = await _step(job, context, aim.look.position, _way(aim), pose_map, clear)
        last_um = aim.error_um
        aim = await _look_or_leave(job, context, position, point, pose_map, aim.firm)
        job.partial.error_after_um = round(aim.error_um, 2)
        if aim.error_um <= tolerance_um:
            return Landed(before_um, aim, job.steps - begun)
        _must_shrink(last_um, aim.error_um, context.servo.scatter_um)
    raise Fault(
        FaultCode.NOT_CONVERGING,
        f"still {aim.error_um:.0f} um off after {job.steps - begun} moves (tolerance {tolerance_um:.0f} um)",
        error_um=round(aim.error_um, 1),
    )


async def _first_aim(
    job: JobContext, context: StationContext, start: Position, point: BoardPoint, pose_map: PoseMap,
    prior: Prior | None,
) -> Aim:  # fmt: skip
    """Look; if the scene is not clear from here, step aside, to one side and the other, and look again.

    The needle may stand in front of the pad, or cut something else into a shape that cannot be told. A known step
    sideways uncovers it; it is a move like any other, checked and bounded. From where the pad is seen farther off than
    one step may go, it goes to the other side. What is unclear from there too is a fault,
    and so is what kept the step, or the look from there, from being taken; the head goes back to where it was.
    """
    begun = job.steps
    try:
        return await _look_or_leave(job, context, start, point, pose_map, prior)
    except Fault as fault:
        if not another_view_helps(context, fault, prior):
            raise
        unclear = fault
    dx, dy = sidestep_um(context, point, pose_map, start.theta_deg)
    failed: Fault | None = None
    for aside_um in ((dx, dy), (-dx, -dy)):
        try:
            position = await _step(job, context, start, aside_um, pose_map)
            aim = await _look(job, context, position, point, pose_map, prior)
            if aside_um == (dx, dy) and math.hypot(*_way(aim)) > _farthest_um(context, pose_map):
                continue  # it stands aside on the side that lies away from the pad
            return aim
        except (Fault, DeviceError) as exc:
            failed = as_fault(exc)
            if failed.kind in UNSURE or failed.kind is FaultCode.WRONG_HEIGHT:
                raise  # no axis is to be moved any more, or not down again
            if not another_view_helps(context, failed, prior):
                break
    if job.steps > begun:
        await _step(job, context, start, (0.0, 0.0), pose_map)
        # Nobody looks there: that way too may have ended on a part, and the next one is to begin straight up.
        context.station.needle.board.end()
    raise _first_cause(unclear, failed, told=failed is None or another_view_helps(context, failed, prior))


def _first_cause(unclear: Fault, aside: Fault | None, *, told: bool) -> Fault:
    """Return why the scene was not clear, with what kept it so unless that is `told`; a latched fault is not hidden."""
    if aside is None or told:
        return unclear
    cause, other = (aside, unclear) if aside.kind.latched else (unclear, aside)
    name = "first_cause" if cause is aside else "aside"
    return Fault(cause.kind, cause.message, **cause.detail, **{name: ErrorBody.of(other).model_dump(mode="json")})


def _look_z_um(context: StationContext, here: Position) -> float:
    """Return Z for looks at a place: by its measured surface, else where Z is, from working height to free of any."""
    geometry = context.geometry
    z_um = geometry.look_z_um(geometry.tip_um(here))
    if geometry.measured_um(geometry.tip_um(here)) is not None:
        return z_um
    return min(max(here.z_um, context.gantry.work_z_um + geometry.stands_um(geometry.tip_um(here))), z_um)


async def _to_look_height(job: JobContext, context: StationContext, here: Position) -> Position:
    """Bring Z to where looks are taken at this place, unless it is there; what was let down is seen to be free."""
    slow_um = context.geometry.slow_z_um(here)

    async def go(target: Position) -> Position:
        return await context.station.go(target, job, slow_z_um=slow_um)

    at = await context.station.to_height(here, _look_z_um(context, here), job, slow_z_um=slow_um)
    return await see_free(job, context, at, go) if at.z_um < here.z_um else at


async def _look(
    job: JobContext,
    context: StationContext,
    position: Position,
    point: BoardPoint,
    pose_map: PoseMap,
    prior: Prior | None,
) -> Aim:
    """Look and aim; a look that shows the pin pushed in is a fault, whatever else it shows."""

    async def go(target: Position) -> Position:
        job.fire(Event.OFF_TARGET if job.moves else Event.SEEN)
        job.moves += 1
        job.lifts += 1
        reached = await context.station.go(target, job, slow_z_um=context.geometry.slow_z_um(target))
        job.fire(Event.ARRIVED)
        return reached

    try:
        # After a look that nothing was known before, it is hardly ever there already
        first = prior is None or not prior.firm
        aim = await look_and_aim(job, context, position, point, pose_map, prior, moves_next=first, is_last=not first)
    except Fault:
        await require_free(job, context, pose_map, go)
        raise
    await context.station.seen_at(position, aim.tip, job)
    recognise(context, aim.look)
    await require_free(job, context, pose_map, go)
    return aim


async def _look_or_leave(
    job: JobContext, context: StationContext, position: Position, point: BoardPoint, pose_map: PoseMap,
    prior: Prior | None,
) -> Aim:  # fmt: skip
    """Look and aim; of a needle that came down on something, from where it was lifted off it."""
    try:
        return await _look(job, context, position, point, pose_map, prior)
    except StoodOn as stood:
        return await _look_off(job, context, stood, point, pose_map, prior)


async def _look_off(
    job: JobContext, context: StationContext, stood: StoodOn, point: BoardPoint, pose_map: PoseMap,
    prior: Prior | None,
) -> Aim:  # fmt: skip
    """Look and aim from where the needle was lifted off what it stood on; raise `stood` unless it stood beside the pad.

    Beside the pad a part stands, and the way went astray; the board lies too high where it stood on the pad itself, or
    where nothing tells. Whether it does shows when the needle comes down over the pad.
    """
    metal_um = on_metal_within_um(point, context.servo) if context.by_cad else None
    if metal_um is None:
        raise stood
    try:
        aim = await _look(job, context, stood.freed, point, pose_map, prior)
    except Fault as unseen:
        if unseen.kind.latched:
            raise  # Z lost steps: to lift the needle is no cure then, and nobody may move on by its count
        raise stood from unseen
    if aim.error_um <= max(metal_um, context.servo.tolerance_um):
        raise stood
    job.note("look", {"stood_aside_um": round(aim.error_um, 1), **stood.detail})
    return aim


async def _step(
    job: JobContext, context: StationContext, here: Position, way_um: tuple[float, float], pose_map: PoseMap,
    clear: ClearHeight | None = None,
) -> Position:  # fmt: skip
    """Take one step of the machine's from wherever it is: a move, and the arrival after it.

    What keeps it from beginning is raised before the state changes: the head is where it was.
    clear: who knows how low it may go across, where a look has shown what is below; None: nobody does.
    """
    target = _target(context, here, way_um, pose_map)
    await context.station.may_go(target, job)
    await context.station.prepare_white(job)
    job.fire(Event.OFF_TARGET if job.moves else Event.SEEN)
    job.moves += 1
    reached = await context.station.go(target, job, slow_z_um=context.geometry.slow_z_um(target), clear=clear)
    job.note("move", {"x_um": round(target.x_um, 2), "y_um": round(target.y_um, 2), "theta_deg": here.theta_deg})
    job.fire(Event.ARRIVED)
    return reached


def sidestep_um(context: StationContext, point: BoardPoint, pose_map: PoseMap, theta_deg: float) -> tuple[float, float]:
    """Return the head's step, robot frame, that shifts a pad behind the taper's middle out from behind it."""
    probe = context.calibrations.require_probe()
    size_um = extent_um(point) if context.by_cad else point.round_um
    radius_px = size_um / 2 * pose_map.scale_px_per_um(probe.tip_px)
    clear_px = probe.shape.cylinder_half_px / 2 + radius_px + SIDESTEP_MARGIN_PX
    across = (-math.sin(probe.angle_rad) * clear_px, math.cos(probe.angle_rad) * clear_px)
    below = np.add(probe.tip_px, pose_map.below_tip_px)
    # The scene moves against the head.
    dx, dy = -pose_map.from_tip_um((below[0] + across[0], below[1] + across[1]), probe.tip_px, theta_deg)
    if context.by_cad:  # of a large pad a part is enough, and a step farther than the map's radius is none
        share = min(1.0, ASIDE_SHARE * _farthest_um(context, pose_map) / math.hypot(dx, dy))
        dx, dy = share * dx, share * dy
    return float(dx), float(dy)


def _farthest_um(context: StationContext, pose_map: PoseMap) -> float:
    """Return how far one step may go."""
    return min(pose_map.radius_um, context.servo.max_placement_um)


async def admit(job: JobContext, context: StationContext, request: Correct) -> tuple[BoardPoint, PoseMap, Position]:
    """Check all that must hold before anything is done: homing, calibration, the head's place, the envelope."""
    job.partial.test_point = request.test_point
    board = context.board
    named = board.point(request.test_point) if context.by_cad else board.round_point(request.test_point)
    point = await sited(context, named)
    context.calibrations.require_probe()
    await require_board(context, request.board_id)
    pose_map = context.require_map()
    await context.station.require_homed(job, looks_next=True)
    position = await context.station.position(job)
    context.station.check(context.geometry.position_over(point.place_um, position.theta_deg))
    away_um = math.hypot(*context.geometry.from_tip_um(point.place_um, position))
    if away_um > context.servo.max_placement_um:
        raise Fault(
            FaultCode.NOT_AT_TEST_POINT,
            f"the head is {away_um / 1000:.1f} mm from {point.name}",
            away_um=round(away_um, 1),
            limit_um=context.servo.max_placement_um,
        )
    return point, pose_map, position


def _way(aim: Aim) -> tuple[float, float]:
    """Return the way that a look found."""
    return aim.correction.dx_um, aim.correction.dy_um


def _target(context: StationContext, here: Position, way_um: tuple[float, float], pose_map: PoseMap) -> Position:
    """Return the absolute target of a step, never further than the map was calibrated for, and within reach."""
    length_um, most_um = math.hypot(*way_um), context.servo.max_placement_um
    if not length_um <= _farthest_um(context, pose_map):
        message = f"the correction would be {length_um:.0f} um; allowed are {most_um:.0f} um (servo.max_placement_um)"
        if pose_map.radius_um < most_um:
            message = f"the correction would be {length_um:.0f} um; calibrated are {pose_map.radius_um:.0f} um"
        raise Fault(FaultCode.CORRECTION_TOO_LARGE, message, correction_um=round(length_um, 1))
    level = Position(here.x_um + way_um[0], here.y_um + way_um[1], here.z_um, here.theta_deg)
    target = replace(level, z_um=_look_z_um(context, level))
    context.station.check(target)
    return target


def _must_shrink(before_um: float, after_um: float, scatter_um: float) -> None:
    """Stop a servo that runs away: a wrong sign or a wrong map makes the error grow.

    The axes do not stop twice at the same place, so an error within that scatter may grow by chance; the number of
    moves bounds it there.
    """
    if not after_um < max(before_um, scatter_um):
        raise Fault(
            FaultCode.NOT_CONVERGING,
            f"the move turned {before_um:.0f} um into {after_um:.0f} um",
            before_um=round(before_um, 1),
            after_um=round(after_um, 1),
        )


def _outcome(outcome: str, point: BoardPoint, before_um: float, aim: Aim, context: StationContext) -> Outcome:
    return Outcome(
        outcome,
        test_point=point.name,
        error_before_um=round(before_um, 2),
        error_after_um=round(aim.error_um, 2),
        detail={
            "sigma_um": round(aim.correction.sigma_um, 2),
            "kind": str(aim.target.kind),
            "decided_by": aim.target.rule,
            "target_um": [round(v, 1) for v in point.place_um],
        }
        | describe_height(context, aim.look.position),
    )
