"""Height of the board: what is known of it, what not knowing it may cost, and whether the pin is free over it."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import replace

import numpy as np

from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import JobContext, StationContext
from daemon.station.station import LookResult
from drivers.gantry import Position
from vision import Tip
from vision.geometry import PoseMap

SUSPECT_UM = 45.0
"""A tip that stands so much higher in the picture than it was taught may be pushed in: two sigma of the stops' flex."""
PUSHED_UM = 100.0
"""So much is no flex any more: more than four sigma."""
RISEN_UM = 20.0
"""A pin that was pushed in comes out by more than this when it is lifted where it stands."""

Go = Callable[[Position], Awaitable[Position]]


def describe_height(context: StationContext, position: Position) -> dict[str, object]:
    """Return for an answer what is known of the board's height below the tip.

    `parallax_um`: how far a surface at the end of the configured range seems to lie aside in a slanting view.
    """
    height_um = context.geometry.measured_um(context.geometry.tip_um(position))
    if height_um is not None:
        return {"height": "measured", "height_um": round(height_um, 1)}
    range_um = context.gantry.surface_range_um
    told: dict[str, object] = {"height": "unknown", "height_within_um": range_um}
    pose_map, probe = context.calibrations.pose_map, context.calibrations.probe
    if pose_map is not None and probe is not None:
        below_px = np.add(probe.tip_px, pose_map.below_px())
        aside_um = pose_map.from_tip_um(below_px, probe.tip_px, 0.0, height_um=range_um)
        told["parallax_um"] = round(math.hypot(*aside_um), 1)
    return told


def pushed_um(context: StationContext, look: LookResult | None, pose_map: PoseMap) -> float:
    """Return how much higher in a look the tip stands than it was taught, um of push; 0 where no tip was seen."""
    if look is None or not isinstance(look.tip, Tip):
        return 0.0
    taught = context.calibrations.require_probe().tip_px
    return pose_map.height_from_shift_um((look.tip.x_px - taught[0], look.tip.y_px - taught[1]))


def refuse_pushed(context: StationContext, look: LookResult, pose_map: PoseMap) -> None:
    """Raise `Fault` if a look shows a pin that is certainly pushed in; for looks that must move nothing."""
    up_um = pushed_um(context, look, pose_map)
    if up_um > PUSHED_UM:
        raise _touching(up_um)


async def require_free(job: JobContext, context: StationContext, pose_map: PoseMap, go: Go) -> None:
    """Raise `Fault` if the last look shows a pushed pin; the needle is then left lifted.

    Camera and needle flex from stop to stop by as much as a small push, so a suspect is lifted where it stands: only a
    pushed pin comes out. A free one is brought back down.
    """
    look = job.last_look
    up_um = pushed_um(context, look, pose_map)
    if look is None or not isinstance(look.tip, Tip) or up_um <= SUSPECT_UM:
        return
    here, tip = look.position, look.tip
    above_um = max(context.gantry.free_z_um, here.z_um + context.gantry.surface_range_um)
    above = await go(replace(here, z_um=min(above_um, context.gantry.safe_z_um)))
    lifted = await context.station.look_white(above, context.calibrations.require_probe(), None, job)
    job.saw(lifted)
    if not isinstance(lifted.tip, Tip):
        raise Fault(FaultCode.TIP_NOT_FOUND, f"tip not found above a suspect of a touch: {lifted.tip}")
    risen_um = pose_map.height_from_shift_um((tip.x_px - lifted.tip.x_px, tip.y_px - lifted.tip.y_px))
    if risen_um > RISEN_UM:
        raise _touching(risen_um)
    if up_um > PUSHED_UM:
        raise Fault(
            FaultCode.WRONG_HEIGHT,
            f"the tip stands {up_um:.0f} um higher in the picture than it was taught, lifted or not",
            advice="see that Z moves and the probe sits as it was taught, then teach the tip again",
            pushed_um=round(up_um, 1),
        )
    await go(here)


def _touching(by_um: float) -> Fault:
    return Fault(
        FaultCode.WRONG_HEIGHT,
        f"the board lies higher than it should: the pin was pushed in by {by_um:.0f} um where it should hover",
        pushed_um=round(by_um, 1),
    )
