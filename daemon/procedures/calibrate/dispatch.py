"""Dispatch of calibrations, and the two short ones: teach the tip, map pixels to um at one head angle."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, ProcedureFor, StationContext
from daemon.procedures.calibrate.backlash import measure_backlash
from daemon.procedures.calibrate.commit import keep_probe, tell_old
from daemon.procedures.calibrate.map_walk import MapAcquisition
from daemon.procedures.calibrate.planarity import measure_surface
from daemon.procedures.calibrate.pose_map import acquire_and_store
from daemon.procedures.calibrate.rotation import calibrate_rotation
from daemon.procedures.calibrate.targets import choose_target
from daemon.procedures.move_sequence import MoveSequence
from daemon.station.needle_health import NeedleHealth
from daemon.wire.operations.jobs import Calibrate
from drivers.lights import Light
from vision import ProbeModel


async def calibrate(job: JobContext, context: StationContext, request: Calibrate) -> Outcome:
    """Run the calibration that was asked for."""
    tell_old(job, context, request.what)
    return await _CALIBRATIONS[request.what](job, context, request)


async def _teach_tip(job: JobContext, context: StationContext, request: Calibrate) -> Outcome:
    """Take a white frame and learn the probe from the pixel a person pointed at (thesis 5.3.6)."""
    if request.tip_px is None:
        raise Fault(FaultCode.INVALID_REQUEST, "what=tip needs tip_px")
    job.fire(Event.ACCEPTED)
    frame = await context.station.capture(Light.WHITE, job)
    try:
        model = await asyncio.to_thread(ProbeModel.teach, frame.pixels, tip_px=request.tip_px)
    except ValueError as exc:
        advice = (
            "do what the message says; if the click was right, take the picture again where nothing bright lies below "
            "the needle, as after `home`, and teach it there"
        )
        raise Fault(FaultCode.CALIBRATION_FAILED, f"the tip cannot be taught: {exc}", advice=advice) from exc
    kept = await keep_probe(job, context, model)
    context.station.needle.health = NeedleHealth()  # what the reference pad said was of the needle before
    return Outcome("calibrated", detail={"what": "tip", "tip_px": list(request.tip_px)} | kept)


async def _map(job: JobContext, context: StationContext, request: Calibrate) -> Outcome:
    """Calibrate the map on one resting target; the old map stays unless the new one is good."""
    job.partial.test_point = request.test_point
    target = choose_target(context, _point(context, request.test_point))
    context.calibrations.require_probe()
    await context.station.require_homed(job)
    sequence = MoveSequence(job, context)
    acquisition = MapAcquisition(sequence, target, request.theta_deg)
    for place in acquisition.extremes():
        context.station.check(place)
    job.fire(Event.ACCEPTED)
    detail = await acquire_and_store(job, context, acquisition, target)
    return Outcome("calibrated", test_point=request.test_point, detail=detail)


def _point(context: StationContext, name: str | None) -> BoardPoint | None:
    return context.board.find(name) if name is not None else None


async def _backlash(job: JobContext, context: StationContext, request: Calibrate) -> Outcome:
    target = choose_target(context, _point(context, request.test_point))
    return await measure_backlash(job, context, target, request.theta_deg)


_CALIBRATIONS: Mapping[str, ProcedureFor[Calibrate]] = {
    "tip": _teach_tip,
    "map": _map,
    "rotation": calibrate_rotation,
    "surface": measure_surface,
    "backlash": _backlash,
}
