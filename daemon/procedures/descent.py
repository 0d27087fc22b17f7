"""Descent: straight down onto a measured surface, slowly at its end, and straight up again.

The position limits: the target is the surface minus the push that was asked for, and never lower. The needle goes down
at full speed to a little above the surface, and slowly from there on (two speeds, the soft landing of flying probers).
Before it goes down the tip is seen free: by that place in the picture the lift is judged, before any move sideways.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from daemon.domain.contact import ContactFacts
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, StationContext
from daemon.platform.clock import utc_now
from daemon.procedures.aiming import require_tip
from daemon.procedures.free_needle import LOOKS_FOR_TIP, raise_into_sight
from daemon.procedures.height import require_free
from daemon.station.free_pin import FreePin
from drivers.gantry import Position
from vision import Tip
from vision.geometry import PoseMap

FREE_WITHIN_UM = 40.0
"""A pin that came out of a press is seen as near as this to where it stood free; single looks scatter by 8 um."""


@dataclass(frozen=True)
class Ground:
    """What lies below the needle: Z at which it is met, and the map by which a push is seen."""

    pose_map: PoseMap
    surface_z_um: float


async def go_straight(job: JobContext, context: StationContext, target: Position, ground: Ground) -> Position:
    """Move straight up or down, slowly below where the needle may meet the surface."""
    near_um = ground.surface_z_um + context.config.touch.approach_um
    slow_um = max(context.geometry.slow_z_um(target), near_um)
    job.fire(Event.OFF_TARGET if job.moves else Event.SEEN)
    job.moves += 1
    reached = await context.station.go(target, job, slow_z_um=slow_um)
    job.note("move", {"z_um": round(target.z_um, 2)})
    job.fire(Event.ARRIVED)
    return reached


async def hover_free(
    job: JobContext, context: StationContext, here: Position, ground: Ground, *, is_last: bool = False
) -> Position:
    """Look at the free tip at the height of looks, and see that no board pushes it in; return where the head stands.

    A touch sense is to be asked next. is_last: no look follows the press; where one does the lamp stays on.
    """
    station = context.station
    above_um = context.geometry.look_z_um(context.geometry.tip_um(here))
    above = here
    if here.z_um > above_um + 1.0:
        above = await go_straight(job, context, replace(here, z_um=above_um), ground)
    model = context.calibrations.require_probe()
    for _ in range(LOOKS_FOR_TIP):
        look = await station.look_white(above, model, None, job, is_last=is_last)
        job.saw(look)
        if isinstance(look.tip, Tip):
            break

    async def go(target: Position) -> Position:
        return await go_straight(job, context, target, ground)

    if not isinstance(look.tip, Tip):
        await raise_into_sight(job, context, ground.pose_map, above, go)
    tip = require_tip(look)

    await require_free(job, context, ground.pose_map, go, feel=False)
    remember_free(context, tip, above, ground.pose_map)
    return above


def remember_free(context: StationContext, tip: Tip, above: Position, pose_map: PoseMap) -> None:
    """Have the station remember where the free tip is seen: from now on the pin may be pushed in."""
    model = context.calibrations.require_probe()
    free = FreePin.by_map(pose_map, model, (tip.x_px, tip.y_px), FREE_WITHIN_UM, above.z_um)
    context.station.pressing(replace(free, by_marking=tip.by_marking))


def contact_facts(
    job: JobContext, context: StationContext, point: str, board_id: str | None, down: Position, surface_z_um: float
) -> ContactFacts:
    """Return how the needle stands in a press that begins, by where Z is and the measured surface."""
    pressed_um = max(0.0, surface_z_um - down.z_um)
    return ContactFacts(
        id=job.request.id, press=job.touching.held.next_press(), test_point=point, board_id=board_id,
        z_um=round(down.z_um, 2), pressed_um=round(pressed_um, 1),
        force_n=round(context.config.pin.force_n(pressed_um), 3), since=utc_now(),
    )  # fmt: skip


def contact_record(contact: ContactFacts, context: StationContext) -> dict[str, float]:
    """Return a contact by the names of the journal's columns."""
    return {
        "z_end_um": contact.z_um, "pressed_um": contact.pressed_um, "force_n": contact.force_n,
        "speed_um_s": context.gantry.descent_speed,
    }  # fmt: skip
