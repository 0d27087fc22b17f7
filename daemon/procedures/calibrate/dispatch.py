"""Which calibration was asked for, and the two short ones: teach the tip, and map pixels to um at one head angle."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.procedures.calibrate.backlash import measure_backlash
from daemon.procedures.calibrate.commit import keep_probe, tell_old
from daemon.procedures.calibrate.map_walk import Walk
from daemon.procedures.calibrate.planarity import measure_surface
from daemon.procedures.calibrate.pose_map import walk_and_keep
from daemon.procedures.calibrate.rotation import calibrate_rotation
from daemon.procedures.calibrate.targets import choose_mark
from daemon.procedures.move_sequence import MoveSequence
from daemon.wire.operations.jobs import Calibrate
from drivers.lights import Light
from vision import ProbeModel


async def calibrate(job: JobContext, context: StationContext) -> Outcome:
    """Run the calibration that was asked for."""
    if not isinstance(job.request, Calibrate):
        raise TypeError(job.request)
    tell_old(job, context, job.request.what)
    return await _JOBS[job.request.what](job, context, job.request)


async def _teach_tip(job: JobContext, context: StationContext, request: Calibrate) -> Outcome:
    """Take a white picture and learn the probe from the pixel a person pointed at (thesis 5.3.6)."""
    if request.tip_px is None:
        raise Fault(FaultCode.INVALID_REQUEST, "what=tip needs tip_px")
    job.fire(Event.ACCEPTED)
    frame = await context.station.picture(Light.WHITE, job.watch, job.deadline)
    try:
        model = await asyncio.to_thread(ProbeModel.teach, frame.pixels, tip_px=request.tip_px)
    except ValueError as exc:
        raise Fault(FaultCode.CALIBRATION_FAILED, f"the tip cannot be taught: {exc}") from exc
    kept = await keep_probe(job, context, model)
    return Outcome("calibrated", detail={"what": "tip", "tip_px": list(request.tip_px)} | kept)


async def _map(job: JobContext, context: StationContext, request: Calibrate) -> Outcome:
    """Calibrate the map on one resting mark; the old map stays unless the new one is good."""
    job.partial.test_point = request.test_point
    mark = choose_mark(context.config, context.geometry, _point(context, request.test_point))
    context.calibrations.require_probe()
    await context.station.require_homed(job.watch, job.deadline)
    sequence = MoveSequence(job, context)
    walk = Walk(sequence, mark, request.theta_deg)
    for place in walk.extremes():
        context.station.check(place)
    job.fire(Event.ACCEPTED)
    detail = await walk_and_keep(job, context, walk, mark)
    return Outcome("calibrated", test_point=request.test_point, detail=detail)


def _point(context: StationContext, name: str | None) -> BoardPoint | None:
    return context.board.find(name) if name is not None else None


async def _backlash(job: JobContext, context: StationContext, request: Calibrate) -> Outcome:
    mark = choose_mark(context.config, context.geometry, _point(context, request.test_point))
    return await measure_backlash(job, context, mark, request.theta_deg)


_JOBS: Mapping[str, Callable[[JobContext, StationContext, Calibrate], Awaitable[Outcome]]] = {
    "tip": _teach_tip,
    "map": _map,
    "rotation": calibrate_rotation,
    "surface": measure_surface,
    "backlash": _backlash,
}
