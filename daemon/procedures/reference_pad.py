"""Reference pad and brush: whether the needle is good, and what to do where it is not.

A good needle reads next to nothing on gold. One that does not is brushed and asked again; one that is still bad makes
every net look open, so that nothing goes on with it (`probe_bad`).
"""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace

from daemon.config.sections.touching import BrushSection, ReferenceSection
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.descent import Ground, go_straight, hover_free
from daemon.procedures.head_angle import reachable
from daemon.procedures.meter_readings import MeterReadings
from daemon.procedures.tare import what_was_read
from daemon.procedures.touch_sense import come_near, refuse_closed_sense
from daemon.station.needle_health import NeedleHealth
from drivers.gantry import Position

BRUSHINGS = 2
"""What one leaves on the needle, or the pad puts there at once, another takes off: a bad needle stops a whole run."""


async def check_needle(job: JobContext, context: StationContext, meter: MeterReadings, health: NeedleHealth) -> bool:
    """Touch the reference pad, and where that is bad the brush and the pad again; return whether it had to be brushed.

    Raises `Fault` (probe_bad) for a needle that is bad all the same. The head is left over the pad, the needle up.
    """
    reference, brush = context.config.reference, context.config.brush
    if reference is None:
        raise Fault(FaultCode.NOT_CALIBRATED, "there is no reference pad ([reference])")
    if await _good(job, context, reference, meter, health):
        return False
    if brush is not None:
        for _ in range(BRUSHINGS):
            health.brushings += 1
            for _ in range(brush.touches):
                await _touch(job, context, brush, None)
            if await _good(job, context, reference, meter, health):
                return True
    raise Fault(
        FaultCode.PROBE_BAD,
        f"the needle reads {_told(health.last_ohm)} on the reference pad, and {reference.max_ohm:g} ohm is the most"
        + (" (reference.max_ohm), after the brush too" if brush is not None else " (reference.max_ohm)"),
        ohm=None if health.last_ohm is None or math.isinf(health.last_ohm) else round(health.last_ohm, 3),
        limit_ohm=reference.max_ohm,
    )


async def _good(
    job: JobContext, context: StationContext, place: ReferenceSection, meter: MeterReadings, health: NeedleHealth
) -> bool:
    ohm = await _touch(job, context, place, meter)
    good = ohm <= place.max_ohm
    health.read(ohm, good=good, of=what_was_read(context))
    job.note("move", {"on": "reference pad", "ohm": None if math.isinf(ohm) else round(ohm, 4), "good": good})
    return good


async def _touch(
    job: JobContext, context: StationContext, place: ReferenceSection | BrushSection, meter: MeterReadings | None
) -> float:
    """Go there, down, read if there is a meter, and up; return the ohms."""
    here = await context.station.position(job)
    target = reachable(context, lambda theta_deg: context.geometry.position_at(place.place_um, theta_deg), here)
    pose_map = context.require_map()
    surface_z_um = place.z_um if place.z_um is not None else context.gantry.touch_z_um
    ground = Ground(pose_map, surface_z_um)
    await context.station.may_go(target, job)  # a tip that is hidden is a point's verdict, and the head did not move
    job.fire(Event.OFF_TARGET if job.moves else Event.SEEN)
    job.moves += 1
    reached: Position = await context.station.go(target, job, slow_z_um=context.geometry.slow_z_um(target))
    job.fire(Event.ARRIVED)
    above = await hover_free(job, context, reached, ground)
    await refuse_closed_sense(job, context)
    if meter is not None:  # what a brush's bristles close, and where, says nothing
        await come_near(job, context, above, ground)
    await go_straight(job, context, replace(above, z_um=surface_z_um - context.config.press_um), ground)
    await asyncio.sleep(context.config.touch.dwell_ms / 1e3)
    ohm = math.inf if meter is None else await meter.ohms_to_return(meter.press_deadline())
    await go_straight(job, context, above, ground)
    await context.station.see_lifted(job)
    return ohm


def _told(ohm: float | None) -> str:
    return "nothing" if ohm is None or math.isinf(ohm) else f"{ohm:.3g} ohm"
