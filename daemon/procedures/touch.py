"""Touch: lower the needle onto the pad below it, hold it there while somebody measures, and lift it.

It goes down as `daemon.procedures.descent` says. A held needle is a busy machine in `verify`: its
drives are asked all the while, and whatever ends the job raises it.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace

from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.procedures.board_in_nest import require_board
from daemon.procedures.descent import Ground, contact_facts, contact_record, go_straight, hover_free
from daemon.procedures.touch_sense import come_near, refuse_closed_sense
from daemon.procedures.touched_pad import TouchedPad
from daemon.wire.operations.jobs import Touch
from drivers.gantry import Position

ASK_EVERY_S = 0.25
"""So often the drives are asked how they are while the needle is held down."""


@dataclass(frozen=True)
class _Admitted:
    """What a touch needs, all of it there."""

    ground: Ground
    press_um: float
    here: Position
    pad: TouchedPad


async def touch(job: JobContext, context: StationContext, request: Touch) -> Outcome:
    """Touch the point below the needle; a `Fault` says why that could not be done."""
    job.partial.test_point = request.test_point
    admitted = await _admit(job, context, request)
    job.fire(Event.ACCEPTED)
    above = await hover_free(job, context, admitted.here, admitted.ground, is_last=True)
    # Only now: a board that came up closes the sense as well, and is to be lifted off, not left pressing.
    await refuse_closed_sense(job, context, seen_free=True)
    number = await job.touching.book.begin_touch(job.request.id, admitted.pad.board_id, request.test_point)
    context.station.needle.stand.pressed()
    await context.station.lights_off(job)
    surface_z_um = admitted.ground.surface_z_um
    await come_near(job, context, above, admitted.ground)
    down = await go_straight(job, context, replace(above, z_um=surface_z_um - admitted.press_um), admitted.ground)
    await asyncio.sleep(context.config.touch.dwell_ms / 1e3)
    contact = contact_facts(job, context, request.test_point, admitted.pad.board_id, down, surface_z_um)
    _begin_hold(job, request, contact)
    book = job.touching.book
    job.later(book.tell_touch(number, contact_record(contact, context)))
    ended_by = await _hold(job, context, request)
    try:
        await _lift(job, context, above, admitted.ground)
    finally:
        measured = job.touching.held.close()
        job.later(book.tell_touch(number, {"ended_by": ended_by, **measured}))
    if ended_by == "lease_expired":
        raise Fault(FaultCode.LEASE_EXPIRED, f"{request.test_point} was let go of: no `hold` came in time")
    of_pad = await admitted.pad.touches_in_life()
    detail = {
        "contact": contact.model_dump(exclude={"id"}),
        "press": contact.press,
        "ended_by": ended_by,
        "measured": measured or None,
        "touches_of_pad": of_pad,
    }
    return Outcome("touched", test_point=request.test_point, detail=detail)


async def _admit(job: JobContext, context: StationContext, request: Touch) -> _Admitted:
    """Check all that must hold before anything is done; nothing moves."""
    point = context.board.point(request.test_point)
    most_um = context.gantry.overtravel_um
    press_um = request.press_um if request.press_um is not None else context.config.press_um
    if press_um > most_um:
        raise Fault(
            FaultCode.INVALID_REQUEST,
            f"the pin may be pushed in by {most_um:g} um at most (gantry.overtravel_um), {press_um:g} were asked for",
            fields=[{"field": "press_um", "problem": f"at most {most_um:g}"}],
        )
    await context.station.require_homed(job, looks_next=True)
    await require_board(context, request.board_id)
    context.calibrations.require_probe()
    pose_map = context.require_map()
    here = await context.station.position(job)
    within_s = context.config.touch.placed_within_s
    seen = context.station.needle.stand.require(point.name, job.touching.key, here, within_s)
    pad = TouchedPad.below(context, point.name, request.board_id, job.touching.book)
    await pad.refuse_forbidden(context.board)
    await pad.require(context.config.touch, seen=seen)
    height_um = context.geometry.measured_um(context.geometry.tip_um(here))
    if height_um is None:
        raise context.geometry.unmeasured(point.name)
    surface_z_um = context.gantry.touch_z_um + height_um + (point.stands_um or 0.0)
    context.station.check(replace(here, z_um=surface_z_um - press_um))
    return _Admitted(Ground(pose_map, surface_z_um), press_um, here, pad)


def _begin_hold(job: JobContext, request: Touch, contact: ContactFacts) -> None:
    """Tell that the needle stands; from here on the lease runs."""
    job.touching.held.stands(contact, request.lease_ms, request.hold_ms)
    job.touching.made(contact)


async def _lift(job: JobContext, context: StationContext, above: Position, ground: Ground) -> None:
    """Lift the needle to where it hovered, and raise `Fault` if it feels that it was not lifted."""
    await go_straight(job, context, above, ground)
    await context.station.refuse_metal(job)


async def _hold(job: JobContext, context: StationContext, request: Touch) -> str:
    """Keep the needle down until it is to be lifted, asking the drives meanwhile; return by what it is lifted."""
    held = job.touching.held
    try:
        if request.hold_ms <= 0.0:
            return "at_once"
        while (ended_by := await held.wait(ASK_EVERY_S)) is None:
            await context.station.require_homed(job)
            await context.station.position(job)
        return ended_by
    finally:
        held.let_go()
