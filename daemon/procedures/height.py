"""Height of the board: what is known of it, what not knowing it may cost, and whether the pin is free over it."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import JobContext, StationContext
from daemon.station.free_pin import FLEX_WITHIN_UM, LOST_STEPS_UM
from daemon.station.station import LookResult
from drivers.gantry import Position
from vision import Tip
from vision.geometry import Array, PoseMap

SUSPECT_UM = 55.0
"""A tip that stands so much higher in the picture than it was taught may be pushed in: 2.4 sigma of the stops' flex."""
PUSHED_UM = FLEX_WITHIN_UM
"""So much is a push, for a look that must move nothing and cannot ask further: 3.5 sigma."""
NO_FLEX_UM = 120.0
"""So much is no flex any more: five sigma."""
ABOUT_UM = 5.0
RISEN_UM = 20.0
"""A pin that was pushed in comes out by more than this when it is lifted where it stands."""

Go = Callable[[Position], Awaitable[Position]]


class StoodOn(Fault):
    """The needle stood on something where it should hover, and was lifted off it: to `freed`, straight above.

    What it stood on is a board that lies too high, or a part on which a way ended that went astray.
    """

    def __init__(self, by_um: float, freed: Position) -> None:
        told = _touching(by_um)
        super().__init__(told.kind, told.message, **told.detail)
        self.freed = freed


def describe_height(context: StationContext, position: Position) -> dict[str, object]:
    """Return for an answer what is known of the board's height below the tip.

    `parallax_um`: how far a surface at the end of the configured range seems to lie aside in a slanting view.
    """
    tip_um = context.geometry.tip_um(position)
    height_um, told = context.geometry.measured_um(tip_um), _pad_height(context, tip_um)
    if height_um is not None:
        return told | {"height": "measured", "height_um": round(height_um, 1)}
    range_um = context.gantry.surface_range_um
    told |= {"height": "unknown", "height_within_um": range_um}
    pose_map, probe = context.calibrations.pose_map, context.calibrations.probe
    if pose_map is not None and probe is not None:
        below_px = np.add(probe.tip_px, pose_map.below_px())
        aside_um = pose_map.from_tip_um(below_px, probe.tip_px, 0.0, height_um=range_um)
        told["parallax_um"] = round(math.hypot(*aside_um), 1)
    return told


def _pad_height(context: StationContext, tip_um: Array) -> dict[str, object]:
    """Return what is known of how high the pad below stands above the board; nothing of one that lies flat."""
    stands_um = context.geometry.stands_um(tip_um)
    if stands_um:
        return {"pad_stands_um": round(stands_um, 1)}
    return {"pad_height": "unknown"} if context.geometry.stands_unknown(tip_um) else {}


def pushed_um(context: StationContext, look: LookResult | None, pose_map: PoseMap) -> float:
    """Return how much higher in a look the tip stands than it was taught, um of push; 0 where no tip was seen."""
    if look is None or not isinstance(look.tip, Tip):
        return 0.0
    taught = context.calibrations.require_probe().tip_px
    return pose_map.height_from_shift_um((look.tip.x_px - taught[0], look.tip.y_px - taught[1]))


def refuse_pushed(context: StationContext, look: LookResult, pose_map: PoseMap) -> None:
    """Raise `Fault` if a look shows a pin that is certainly pushed in; for looks that must move nothing."""
    up_um = pushed_um(context, look, pose_map)
    if up_um > LOST_STEPS_UM and _no_board_reaches(context, look.position):
        raise _lower_than_counted(look.position, up_um)
    if up_um > PUSHED_UM:
        context.station.needle.board.end()
        raise _touching(up_um)


async def require_free(
    job: JobContext, context: StationContext, pose_map: PoseMap, go: Go, *, feel: bool = True
) -> None:
    """Raise `Fault` if the last look shows a pushed pin; the needle is then left lifted (`StoodOn`: seen free there).

    Camera and needle flex from stop to stop by as much as a small push, so a suspect is lifted where it stands: only a
    pushed pin comes out. A free one is brought back down. What flex may hide is felt by a touch sense, where one is
    fitted: it is asked before a board is trusted, unless the caller does so next (`feel`). Where no board is so high, a
    pushed pin tells that Z lost steps: its drive counts on, and nothing else tells so before the next press.
    """
    look = job.last_look
    up_um = pushed_um(context, look, pose_map)
    if look is None or not isinstance(look.tip, Tip):
        return
    if up_um <= SUSPECT_UM:
        await _trust_board(job, context, look.position, go if feel else None)
        return
    here, too_high, safe_um = look.position, _no_board_reaches(context, look.position), context.gantry.safe_z_um
    above_um = max(context.gantry.free_z_um, here.z_um + context.gantry.surface_range_um)
    lifted = await _look_from(
        job, context, pose_map, await go(replace(here, z_um=safe_um if too_high else min(above_um, safe_um)))
    )
    risen_um = up_um - lifted.up_um
    if not too_high and lifted.up_um > (SUSPECT_UM if risen_um > RISEN_UM else NO_FLEX_UM):
        await _refuse_lost_steps(job, context, pose_map, go, lifted)
    if risen_um > RISEN_UM:
        context.station.needle.board.end()
        raise _lower_than_counted(here, risen_um) if too_high else StoodOn(risen_um, lifted.position)
    if too_high and up_um > LOST_STEPS_UM:
        raise _lower_than_counted(here, up_um)
    if not too_high and up_um > NO_FLEX_UM:
        raise Fault(
            FaultCode.WRONG_HEIGHT,
            f"the tip stands {up_um:.0f} um higher in the picture than it was taught, lifted or not",
            advice="see that Z moves and the probe sits as it was taught, then teach the tip again",
            pushed_um=round(up_um, 1),
        )
    again = await _look_from(job, context, pose_map, await go(here))
    if again.up_um - up_um > RISEN_UM:  # steps were lost on the way up and down
        await go(replace(here, z_um=safe_um))
        raise _lower_than_counted(here, again.up_um)


@dataclass(frozen=True)
class _Seen:
    """Where a needle was looked at, and how much higher than taught its tip stood."""

    position: Position
    up_um: float


async def _look_from(job: JobContext, context: StationContext, pose_map: PoseMap, at: Position) -> _Seen:
    """Look at the tip; raise `Fault` if it is not seen."""
    look = await context.station.look_white(at, context.calibrations.require_probe(), None, job)
    job.saw(look)
    if not isinstance(look.tip, Tip):
        raise Fault(
            FaultCode.TIP_NOT_FOUND,
            f"whether the needle touched the board cannot be told, for its tip is not seen: {look.tip}",
        )
    return _Seen(at, pushed_um(context, look, pose_map))


async def _refuse_lost_steps(
    job: JobContext, context: StationContext, pose_map: PoseMap, go: Go, lifted: _Seen
) -> None:
    """Raise `Fault` if a needle that was lifted to where no board is comes out further when it is lifted more."""
    safe = replace(lifted.position, z_um=context.gantry.safe_z_um)
    highest = await _look_from(job, context, pose_map, await go(safe))
    if lifted.up_um - highest.up_um > RISEN_UM or highest.up_um > LOST_STEPS_UM:
        context.station.needle.board.end()
        raise _lower_than_counted(lifted.position, lifted.up_um)


async def _trust_board(job: JobContext, context: StationContext, position: Position, go: Go | None) -> None:
    """Where a higher board than was measured would have pushed the pin in, a free one shows that none lies there."""
    if _no_board_reaches(context, position):
        return
    board = context.station.needle.board
    station = context.station
    if go is not None and not board.holds and station.has_sense and await station.senses_metal(job):
        await lift_off_metal(context, position, go, partial(station.senses_metal, job), back=True)
    board.seen_free()


async def lift_off_metal(
    context: StationContext, here: Position, go: Go, feels: Callable[[], Awaitable[bool]], *, back: bool
) -> None:
    """Lift a needle that feels metal where it hovers; raise `Fault` if it then feels none: it stood on a board.

    Else what tells so is closed for good and says nothing of the board. `back`: the needle is brought back then.
    """
    await go(replace(here, z_um=context.gantry.safe_z_um))
    if not await feels():
        context.station.needle.board.end()
        raise Fault(
            FaultCode.WRONG_HEIGHT,
            "the needle felt metal where it should hover, and was lifted off it",
            advice="see that this board lies flat in its nest, then `calibrate surface`",
        )
    if back:
        await go(here)


def _no_board_reaches(context: StationContext, position: Position) -> bool:
    """Whether the needle is free by Z's count whatever board lies below."""
    return position.z_um >= context.gantry.free_z_um - ABOUT_UM


def _lower_than_counted(here: Position, by_um: float) -> Fault:
    return Fault(
        FaultCode.AXIS_STALLED,
        f"Z may stand lower than it counts: at {here.z_um / 1e3:.2f} mm, where no board can be, the tip stood "
        f"{by_um:.0f} um higher in the picture than a free one",
        advice="see that nothing blocks Z, then `reset` and `home`; if it comes again, the board is higher than "
        "gantry.surface_range_um allows, or the needle is not the one that was taught",
        axis="z",
        pushed_um=round(by_um, 1),
    )


def _touching(by_um: float) -> Fault:
    return Fault(
        FaultCode.WRONG_HEIGHT,
        f"the board lies higher than it should: the pin was pushed in by {by_um:.0f} um where it should hover",
        pushed_um=round(by_um, 1),
    )
