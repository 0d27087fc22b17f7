"""Touch sense in a descent: an input that closes on metal. It ends a descent early, and never makes one longer.

The measured surface stays the limit of every descent. A sense that is closed while the needle is up says nothing any
more, so that nothing is lowered; one that closes well above the surface has found a part, or a board that lies higher
than it did.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.descent import Ground, go_straight
from daemon.procedures.height import ABOUT_UM, lift_off_metal
from drivers.gantry import Position

EARLY_UM = 100.0
"""Metal so far above the measured surface is not that surface."""


async def refuse_closed_sense(job: JobContext, context: StationContext, *, seen_free: bool = False) -> None:
    """Raise `Fault` if the sense feels metal although the needle is up; call it before each way down.

    A board that came up closes it as well: the needle is lifted off then, straight up, before anything goes sideways.
    No look spares that: the stops' flex hides a push of as much as two sigma of it. `seen_free`: a look has just shown
    the pin free where it hovers, so that it comes back to there where the lift opens nothing.
    """
    if not context.station.has_sense or not await context.station.senses_metal(job):
        return
    await leave_metal(job, context, partial(context.station.senses_metal, job), back=seen_free)
    raise Fault(
        FaultCode.CONTACT_BEFORE_DESCENT,
        "the touch sense is closed while the needle is up ([sense])",
        advice="see that the needle and its wire touch nothing, and that [sense] names the right input and level",
    )


async def leave_metal(
    job: JobContext, context: StationContext, feels: Callable[[], Awaitable[bool]], *, back: bool = False
) -> None:
    """Lift a needle that feels metal where it should hover to where no board can be.

    Raises `Fault` if it feels none there: then it stood on a board. Else what tells so is closed for good. `back`: it
    is brought back to where it hovered then, for it was free there.
    """
    here = await context.station.position(job)
    if here.z_um >= context.gantry.free_z_um - ABOUT_UM:
        return
    if job.moves == 0 and job.triggered:
        job.fire(Event.ACCEPTED)
    await lift_off_metal(context, here, partial(_straight_to, job, context), feels, back=back)


async def _straight_to(job: JobContext, context: StationContext, target: Position) -> Position:
    job.fire(Event.OFF_TARGET if job.moves else Event.SEEN)
    job.moves += 1
    reached = await context.station.go(target, job)
    job.note("move", {"z_um": round(target.z_um, 2)})
    job.fire(Event.ARRIVED)
    return reached


async def come_near(job: JobContext, context: StationContext, above: Position, ground: Ground) -> None:
    """Lower the needle to just above the surface, and raise `Fault` if the sense feels metal there already.

    Without a sense nothing is done. The needle is left where it is, for the job's end to lift.
    """
    near_z_um = ground.surface_z_um + EARLY_UM
    if not context.station.has_sense or above.z_um <= near_z_um:
        return
    await go_straight(job, context, replace(above, z_um=near_z_um), ground)
    if await context.station.senses_metal(job):
        raise Fault(
            FaultCode.WRONG_HEIGHT,
            f"the touch sense feels metal {EARLY_UM:g} um above the measured surface",
            advice="see what stands there; does the board lie flat in its nest? Then `calibrate surface`",
            above_um=EARLY_UM,
        )
