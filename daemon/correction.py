"""One correction: look, move, look again, until the tip is on the pad (thesis figure 5.2; PBVS look-and-move)."""

from __future__ import annotations

import math

from daemon.board import BoardPoint
from daemon.faults import Fault, Kind
from daemon.job import Bench, Job, Outcome
from daemon.messages import Correct
from daemon.sighting import Aim, look_and_aim
from daemon.states import Event
from drivers.gantry import Position
from vision.posemap import PoseMap


async def correct(job: Job, bench: Bench) -> Outcome:
    """Bring the tip onto the test point it missed."""
    request = job.request
    if not isinstance(request, Correct):
        raise TypeError(request)
    point, pose_map, position = await admit(job, bench, request)
    job.fire(Event.ACCEPTED)
    position = await bench.station.to_work_height(position, job.watch, job.deadline)
    aim = await look_and_aim(job, bench, position, point, pose_map)
    before_um = aim.error_um
    job.partial.error_before_um = round(before_um, 2)
    tolerance_um = bench.config.servo.tolerance_um
    if before_um <= tolerance_um:
        return _outcome("already_on_target", point, before_um, aim)
    job.fire(Event.SEEN)
    for moves_left in reversed(range(bench.config.servo.max_moves)):
        position = await _move(job, bench, aim, pose_map)
        job.fire(Event.ARRIVED)
        last_um, aim = aim.error_um, await look_and_aim(job, bench, position, point, pose_map)
        job.partial.error_after_um = round(aim.error_um, 2)
        if aim.error_um <= tolerance_um:
            return _outcome("corrected", point, before_um, aim)
        _must_shrink(last_um, aim.error_um, bench.config.servo.scatter_um)
        if moves_left:
            job.fire(Event.OFF_TARGET)
    raise Fault(
        Kind.NOT_CONVERGING,
        f"still {aim.error_um:.0f} um off after {job.moves} moves (tolerance {tolerance_um:.0f} um)",
        error_um=round(aim.error_um, 1),
    )


async def admit(job: Job, bench: Bench, request: Correct) -> tuple[BoardPoint, PoseMap, Position]:
    """Check all that must hold before anything is done: homing, calibration, the head's place, the envelope."""
    job.partial.test_point = request.test_point
    point = bench.board.point(request.test_point)
    await bench.station.require_homed(job.watch, job.deadline)
    bench.calibrations.require_probe()
    pose_map = bench.calibrations.require_map(bench.config.servo.calibration_days, bench.config.gantry.work_z_um)
    position = await bench.station.position(job.watch, job.deadline)
    bench.station.check(bench.station.position_over(point.x_um, point.y_um, position.theta_deg))
    away_um = math.hypot(*bench.station.tip_from(point.x_um, point.y_um, position))
    if away_um > bench.config.servo.max_placement_um:
        raise Fault(
            Kind.NOT_AT_TEST_POINT,
            f"the head is {away_um / 1000:.1f} mm from {point.name}",
            away_um=round(away_um, 1),
            limit_um=bench.config.servo.max_placement_um,
        )
    return point, pose_map, position


async def _move(job: Job, bench: Bench, aim: Aim, pose_map: PoseMap) -> Position:
    """Go by what the look found: an absolute target, never further than the map was calibrated for."""
    way = aim.correction
    limit_um = min(pose_map.radius_um, bench.config.servo.max_placement_um)
    if not way.distance_um <= limit_um:
        raise Fault(
            Kind.CORRECTION_TOO_LARGE,
            f"the correction would be {way.distance_um:.0f} um; calibrated are {limit_um:.0f} um",
            correction_um=round(way.distance_um, 1),
        )
    here = aim.look.position
    target = Position(here.x_um + way.dx_um, here.y_um + way.dy_um, bench.config.gantry.work_z_um, here.theta_deg)
    bench.station.check(target)
    await bench.station.prepare_white(job.watch, job.deadline)
    job.moves += 1
    reached = await bench.station.go(target, job.watch, job.deadline)
    job.note("move", {"x_um": round(target.x_um, 2), "y_um": round(target.y_um, 2), "theta_deg": here.theta_deg})
    return reached


def _must_shrink(before_um: float, after_um: float, scatter_um: float) -> None:
    """Stop a servo that runs away: a wrong sign or a wrong map makes the error grow.

    The axes do not stop twice at the same place, so an error within that scatter may grow by chance; the number of
    moves bounds it there.
    """
    if not after_um < max(before_um, scatter_um):
        raise Fault(
            Kind.NOT_CONVERGING,
            f"the move turned {before_um:.0f} um into {after_um:.0f} um",
            before_um=round(before_um, 1),
            after_um=round(after_um, 1),
        )


def _outcome(outcome: str, point: BoardPoint, before_um: float, aim: Aim) -> Outcome:
    return Outcome(
        outcome,
        test_point=point.name,
        error_before_um=round(before_um, 2),
        error_after_um=round(aim.error_um, 2),
        detail={
            "sigma_um": round(aim.correction.sigma_um, 2),
            "kind": str(aim.target.kind),
            "decided_by": aim.target.rule,
        },
    )
