"""Jog: one small step of one axis, for a person at the machine; sideways only high up, down only where nothing can be.

Nothing is known of what the person wants, so that everything else must be: each drive has its reference, the needle is
up and was seen free since its last press, and no part of the way leaves the envelope.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.station.needle import HEIGHT_WINDOW_UM, Needle
from daemon.wire.operations.jobs import Jog
from drivers.gantry import Position, axis_theta_deg

SAME_DEG = 1e-6


async def jog(job: JobContext, context: StationContext, request: Jog) -> Outcome:
    """Take one step; what speaks against it is said before anything moves."""
    station = context.station
    await station.require_homed(job)
    here = await station.position(job)
    _refuse_doubt(station.needle)
    target = _target(here, request)
    _refuse_low(context, here, target, request)
    for place in _way(context, target, request):
        station.check(place)
    station.needle.stand.forget()
    job.fire(Event.DEPARTED)
    job.moves += 1
    # Down it is slow all the way: nobody knows what is there.
    reached = await station.go(target, job, slow_z_um=math.inf)
    job.fire(Event.ARRIVED)
    job.note("move", asdict(target))
    return Outcome("jogged", detail={"position": {name: round(value, 4) for name, value in asdict(reached).items()}})


def _refuse_doubt(needle: Needle) -> None:
    """Raise `Fault` unless the needle is known to be up, and free."""
    if not needle.is_up:
        raise needle.fault("no axis is jogged")
    if needle.free_pin is not None:
        raise Fault(
            FaultCode.LOOK_NEEDED, "nobody has seen the needle free since its last press",
            advice="send `place` for any point: it is looked at before the head moves; or `home`",
        )  # fmt: skip


def _target(here: Position, request: Jog) -> Position:
    if request.by_deg is not None:
        theta_deg = here.theta_deg + request.by_deg
        if abs(axis_theta_deg(theta_deg) - theta_deg) > SAME_DEG:
            raise Fault(FaultCode.OUTSIDE_ENVELOPE, f"the head does not turn on to {theta_deg:.2f} deg", axis="theta")
        return replace(here, theta_deg=theta_deg)
    name = f"{request.axis}_um"
    return replace(here, **{name: getattr(here, name) + (request.by_um or 0.0)})


def _refuse_low(context: StationContext, here: Position, target: Position, request: Jog) -> None:
    """Raise `Fault` for a step sideways below the safe height, and for one down to where something may be."""
    gantry = context.gantry
    if request.axis != "z":
        if here.z_um < gantry.safe_z_um - HEIGHT_WINDOW_UM:
            raise Fault(
                FaultCode.OUTSIDE_ENVELOPE, f"Z is at {here.z_um / 1e3:.3f} mm, and nothing is jogged sideways below "
                f"the safe height, {gantry.safe_z_um / 1e3:.3f} mm", advice="send `lift` first", axis=request.axis,
                z_um=here.z_um, least_z_um=gantry.safe_z_um,
            )  # fmt: skip
        return
    lowest_um = lowest_jog_um(context, target)
    if target.z_um < here.z_um and target.z_um < lowest_um:
        raise Fault(
            FaultCode.OUTSIDE_ENVELOPE, f"Z is not jogged lower than {lowest_um / 1e3:.3f} mm: a surface may be there",
            advice="take a smaller step", axis="z", z_um=here.z_um, least_z_um=lowest_um,
        )  # fmt: skip


def lowest_jog_um(context: StationContext, at: Position) -> float:
    """Return down to where Z is jogged, um: above any surface that is possible, and above the one that is known there.

    The reference pad and the brush may stand higher than any board.
    """
    gantry = context.gantry
    known_um = context.geometry.surface_z_um(at) + gantry.work_z_um - gantry.touch_z_um
    return max(gantry.free_z_um, gantry.work_z_um, known_um)


def _way(context: StationContext, target: Position, request: Jog) -> tuple[Position, ...]:
    """Return where the step leads: sideways it goes too far back first, to come from one side."""
    gantry = context.gantry
    if request.axis == "z":
        return (target,)
    if request.axis == "theta":
        return (replace(target, theta_deg=target.theta_deg - gantry.approach_deg), target)
    name = f"{request.axis}_um"
    return (replace(target, **{name: getattr(target, name) - gantry.approach_um}), target)
