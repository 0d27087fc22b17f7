"""Free needle: after a move a look shows that the pin hovers; one whose tip is not seen is raised until it is.

What was not seen free is not free: another board may lie there, or Z stand lower than its drive counts.
"""

from __future__ import annotations

from dataclasses import replace

from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.height import ABOUT_UM, Go, require_free
from drivers.gantry import Position
from vision import Tip
from vision.geometry import PoseMap

LOOKS_FOR_TIP = 3
"""A glint may hide the tip in one picture."""
STEP_UM = 450.0
"""A pin that is let down so far at a time is seen pushed in before its travel is used up."""


def tip_seen_at(job: JobContext, position: Position) -> bool:
    """Whether the last look saw the tip where the head stands."""
    look = job.last_look
    return look is not None and look.position == position and isinstance(look.tip, Tip)


async def see_free(job: JobContext, context: StationContext, position: Position, go: Go) -> Position:
    """See that the needle hovers where it came to; return where it is, which is higher where the tip was not seen.

    Raises `Fault` for a pin that is pushed in; the needle is then left lifted. Without a map and a taught tip nothing
    is looked at.
    """
    pose_map, probe = context.calibrations.pose_map, context.calibrations.probe
    if pose_map is None or probe is None:
        return position
    for _ in range(LOOKS_FOR_TIP):
        if tip_seen_at(job, position) or await _seen(job, context, position):
            await require_free(job, context, pose_map, go)
            return position
    return await raise_into_sight(job, context, pose_map, position, go)


async def raise_into_sight(
    job: JobContext, context: StationContext, pose_map: PoseMap, hidden: Position, go: Go
) -> Position:
    """Raise a needle whose tip is not seen to the lowest place from which it is seen free; return that place.

    The ground may hide it, and a little higher it is seen. If it is not, it may stand deep in what lies below: then it
    is let down from the safe height step by step, so that it meets that gently, and is seen pushed in (`Fault`).
    Where it is seen nowhere, it stays at the safe height.
    """
    free_um, safe_um = context.gantry.free_z_um, context.gantry.safe_z_um
    above_um = min(free_um if hidden.z_um < free_um - ABOUT_UM else hidden.z_um + STEP_UM, safe_um)
    for z_um in (above_um, safe_um):
        here = await go(replace(hidden, z_um=z_um))
        if await _seen(job, context, here):
            await require_free(job, context, pose_map, go)
            break
    while here.z_um - STEP_UM > above_um and tip_seen_at(job, here):
        lower = await go(replace(hidden, z_um=here.z_um - STEP_UM))
        if not await _seen(job, context, lower):
            return await go(here)
        await require_free(job, context, pose_map, go)
        here = lower
    if not tip_seen_at(job, here):
        context.station.needle.blind = True  # whatever made the pictures no good
    return here


async def _seen(job: JobContext, context: StationContext, here: Position) -> bool:
    job.saw(await context.station.look_white(here, context.calibrations.require_probe(), None, job))
    return tip_seen_at(job, here)
