"""Surface touch: find a surface from above with the sprung pin, and see in the image how far the pin was pushed in.

The thesis tests the plane of the base plate by whether the tip repeats at the same pixel (6.2, end). Between two
stops of X and Y camera and needle flex by as much as the surface differs, so here every place is its own reference:
the tip free, above the highest surface that is possible, then lower and lower, slowly, until it is pushed, and half a
press deeper; X and Y do not move in between. From the one depth to the other the pin is pushed by what Z moved, and
that tells how many pixels a micrometre of push is; it is not the map's number, for what TEDA sees moving is the
marking, which is nearer to the camera than the tip. Afterwards the free tip is looked for again: that proves the lift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.aiming import require_tip
from daemon.procedures.height import require_free
from daemon.procedures.move_sequence import MoveSequence, shifted
from daemon.procedures.touch_sense import refuse_closed_sense
from daemon.station.free_pin import FreePin
from drivers.gantry import Position
from vision import Tip
from vision.geometry import Array, PoseMap

LOOKS = 2
"""Pictures of the tip at each depth; the mean of two is good to about 4 um of height."""
LEAST_PUSH_UM = 15.0
"""A smaller push cannot be told from none."""
LEAST_PRESS_UM = 4 * LEAST_PUSH_UM
"""With less press than this no push can be measured."""
LIKELY = (0.7, 1.5)
"""A micrometre of push beside what the map says of one: a pin that sticks, or tips, lies outside."""
NEXT_UM = 120.0
"""So far above the surface of the last place the search begins at the next one."""
CARD_PLACES_UM = ((2200.0, 0.0), (0.0, 2200.0), (-2200.0, 0.0))
"""Where the print's paper is touched, from its centre: beside the lines."""


@dataclass(frozen=True)
class Push:
    """One touch: how far the tip moved in the image, (2,) px, from free to two depths half a press apart."""

    place: Position
    """Where the head stood at the greater depth."""
    half_px: Array
    full_px: Array


class SurfaceSearch:
    """Touches of one surface, one place after the other; what one has found is where the next begins."""

    def __init__(self, sequence: MoveSequence, pose_map: PoseMap) -> None:
        self._sequence, self._map = sequence, pose_map
        self._config = sequence.context.config
        self._press_um = self._config.gantry.press_um
        self._found_z_um: list[float] = []
        self._never_free_there = False
        if self._press_um < LEAST_PRESS_UM:
            raise Fault(
                FaultCode.NOT_CALIBRATED,
                f"with gantry.press_um = {self._press_um:g} no push can be measured",
                advice=f"set it to what the pin takes, {LEAST_PRESS_UM:.0f} or more, say 200, and repeat",
            )

    async def press(self, place: Position) -> Push:
        """Touch the surface below a place and lift the needle again, seen to be free; Z of `place` does not count.

        Raises `Fault` if no surface is met within the configured range, or if Z did not lift.
        """
        sequence, station = self._sequence, self._sequence.context.station
        above = replace(place, z_um=self._config.gantry.free_z_um)
        tips = await tips_at(sequence, await sequence.go(above))
        free = mean_px(tips)
        await refuse_closed_sense(sequence.job, sequence.context, seen_free=True)
        station.pressing(self._free_pin(above, tips))
        self._never_free_there = False
        try:
            push = await self._search(above, free)
        except Fault as first:
            if self._never_free_there:  # not there either, so that nothing can be told by where it was seen
                await sequence.go(replace(above, z_um=self._config.gantry.safe_z_um))
                station.needle.free_pin = station.needle.taught_free()
                raise
            here = await sequence.go(above)  # nothing is left standing on a board
            await self._tell_stalled(first)
            await tip_px(sequence, here)  # what was taken for free was not, if it stands higher than it was taught
            await require_free(sequence.job, sequence.context, self._map, sequence.go)
            await sequence.go(replace(above, z_um=self._config.gantry.safe_z_um))  # a push of some um no look tells
            raise
        await sequence.go(above)
        await station.see_lifted(sequence.job)
        return push

    def _free_pin(self, above: Position, tips: Sequence[Tip]) -> FreePin:
        """Return what a lift is judged by: a push that can be told at all."""
        model, (x_px, y_px) = self._sequence.context.calibrations.require_probe(), mean_px(tips)
        free = FreePin.by_map(self._map, model, (float(x_px), float(y_px)), LEAST_PUSH_UM, above.z_um)
        return replace(free, by_marking=any(tip.by_marking for tip in tips))

    async def _search(self, above: Position, free: Array) -> Push:
        """Go down by less than half a press at a time until the pin is pushed, then by half a press once more.

        So it is never pushed in by more than a press.
        """
        half_um = self._press_um / 2
        gantry, step_um = self._config.gantry, half_um - LEAST_PUSH_UM
        lowest_um = max(self._config.lowest_z_um, gantry.touch_z_um - gantry.surface_range_um - self._press_um)
        z_um, here_px = above.z_um, np.zeros(2)
        if self._found_z_um:
            begin_um = min(above.z_um, max(self._found_z_um) + NEXT_UM)
            begin_px = await self._shift_px(above, begin_um, free)
            if self._pushed_um(begin_px) <= half_um:  # else it is higher here than all that was touched before
                z_um, here_px = begin_um, begin_px
        stuck = 0
        while True:
            pushed_um = self._pushed_um(here_px)
            deeper_um = half_um if pushed_um >= LEAST_PUSH_UM else step_um
            if z_um - deeper_um < lowest_um:
                raise self._no_surface(above, pushed_um)
            z_um -= deeper_um
            there_px = await self._shift_px(above, z_um, free)
            grown_um = self._pushed_um(there_px) - pushed_um
            if pushed_um >= LEAST_PUSH_UM and grown_um >= LIKELY[0] * half_um:
                self._found(above, z_um + pushed_um + grown_um)
                return Push(replace(above, z_um=z_um), here_px, there_px)
            # A touch that noise made up does not grow as Z moves, and does not come twice.
            stuck = stuck + 1 if pushed_um >= LEAST_PUSH_UM else 0
            if stuck > 1:
                raise self._stuck(above, pushed_um, grown_um / half_um)
            here_px = there_px

    async def _tell_stalled(self, first: Fault) -> None:
        """After a touch that failed, raise a Z that did not lift: it is the cause, and what is to be mended first."""
        try:
            await self._sequence.context.station.see_lifted(self._sequence.job)
        except Fault as lift:
            if lift.kind is FaultCode.AXIS_STALLED:
                raise lift from first

    async def _shift_px(self, above: Position, z_um: float, free: Array) -> Array:
        """Lower the needle to a height, slowly where any surface may be; return how far the tip then is from free."""
        slow_um = self._config.gantry.highest_surface_um
        position = await self._sequence.go(replace(above, z_um=z_um), slow_z_um=slow_um)
        return await tip_px(self._sequence, position) - free

    def _pushed_um(self, shift_px: Array) -> float:
        """Return by the map's scale, which is nearly right, how far the pin is pushed in."""
        return self._map.height_from_shift_um(shift_px)

    def _no_surface(self, above: Position, pushed_um: float) -> Fault:
        at, range_um = above, self._config.gantry.surface_range_um
        return Fault(
            FaultCode.CALIBRATION_FAILED,
            f"the pin met no surface at X {at.x_um / 1e3:.2f} mm, Y {at.y_um / 1e3:.2f} mm, "
            f"down to {range_um:.0f} um below gantry.touch_z_um",
            advice="see that a board lies there; correct gantry.touch_z_um, or raise gantry.surface_range_um",
            pushed_um=round(pushed_um, 1),
        )

    def _found(self, above: Position, surface_z_um: float) -> None:
        """Count the touch, and begin at the next place just above this one; a pin that was never free tells nothing."""
        self._sequence.context.station.needle.touched()
        if surface_z_um > above.z_um - 2 * LEAST_PUSH_UM:
            self._never_free_there = True
            raise self._never_free(above)
        self._found_z_um.append(surface_z_um)

    def _never_free(self, above: Position) -> Fault:
        return Fault(
            FaultCode.CALIBRATION_FAILED,
            f"the surface at X {above.x_um / 1e3:.2f} mm, Y {above.y_um / 1e3:.2f} mm lies higher than "
            f"{self._config.gantry.surface_range_um:.0f} um above gantry.touch_z_um: the pin was never free",
            advice="see that nothing lies below the board; correct gantry.touch_z_um, or raise gantry.surface_range_um",
        )

    def _stuck(self, above: Position, pushed_um: float, share: float) -> Fault:
        return Fault(
            FaultCode.CALIBRATION_FAILED,
            f"the tip moved {share:.2f} times as far as a pushed pin would at "
            f"X {above.x_um / 1e3:.2f} mm, Y {above.y_um / 1e3:.2f} mm",
            advice="see that Z and the pin move freely and the probe sits firmly, then calibrate the map again",
            pushed_um=round(pushed_um, 1),
        )


def heights_um(pushes: Sequence[Push], pose_map: PoseMap, press_um: float, touch_z_um: float) -> list[float]:
    """Return the surface's height above the nominal touching plane at each touch, um.

    All touches share one scale, so one touch alone is good to 5 % of the push, a dozen to 2 %. Raises `Fault` if the
    tip did not move as a pushed pin does.
    """
    # By the map's scale, which is nearly right: what is left is one common factor.
    half = np.array([pose_map.height_from_shift_um(p.half_px) for p in pushes])
    full = np.array([pose_map.height_from_shift_um(p.full_px) for p in pushes])
    scale = float((full - half).mean()) / (press_um / 2)
    if not LIKELY[0] <= scale <= LIKELY[1]:
        raise Fault(
            FaultCode.CALIBRATION_FAILED,
            f"the tip moved {scale:.2f} times as far as a pushed pin would",
            advice="see that the pin moves freely and the probe sits firmly, then calibrate the map again",
        )
    return [float(p.place.z_um + h - touch_z_um) for p, h in zip(pushes, full / scale, strict=True)]


async def card_height_um(sequence: MoveSequence, pose_map: PoseMap, over: Position) -> float:
    """Return the height of the control point's paper; 0 if it is not to be touched.

    `over`: where the head stands above its centre.
    """
    gantry = sequence.context.gantry
    if gantry.press_um <= 0.0:
        return 0.0
    search = SurfaceSearch(sequence, pose_map)
    pushes = [await search.press(shifted(over, dx, dy)) for dx, dy in CARD_PLACES_UM]
    return float(np.median(heights_um(pushes, pose_map, gantry.press_um, gantry.touch_z_um)))


async def tip_px(sequence: MoveSequence, position: Position, *, measured: bool = False) -> Array:
    """Return where the tip is in the image, px (2,), mean of a few looks; `measured`: as in `Station.look`."""
    return mean_px(await tips_at(sequence, position, measured=measured))


async def tips_at(sequence: MoveSequence, position: Position, *, measured: bool = False) -> list[Tip]:
    """Look at the tip a few times; raise `Fault` where a look does not show it."""
    context, job = sequence.context, sequence.job
    probe = context.calibrations.require_probe()
    found = []
    for _ in range(LOOKS):
        look = await context.station.look_white(position, probe, None, job, measured=measured)
        job.saw(look)
        found.append(require_tip(look))
    return found


def mean_px(tips: Sequence[Tip]) -> Array:
    """Return the mean place of tips, px (2,)."""
    mean: Array = np.array([(tip.x_px, tip.y_px) for tip in tips]).mean(axis=0)
    return mean
