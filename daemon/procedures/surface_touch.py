"""Surface touch: press the sprung pin onto a surface, and see in the image how far the pin was pushed in.

The thesis tests the plane of the base plate by whether the tip repeats at the same pixel (6.2, end). Between two
stops of X and Y camera and needle flex by as much as the surface differs, so here every place is its own reference:
the tip free, half pressed and pressed, without X or Y having moved in between. From half to full the pin is pushed by
what Z moved, and that tells how many pixels a micrometre of push is; it is not the map's number, for what TEDA sees
moving is the marking, which is nearer to the camera than the tip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.aiming import require_tip
from daemon.procedures.move_sequence import MoveSequence, shifted
from drivers.gantry import Position
from vision.geometry import Array, PoseMap

LOOKS = 2
"""Pictures of the tip at each depth; the mean of two is good to about 4 um of height."""
LEAST_PUSH_UM = 15.0
"""A smaller push cannot be told from none."""
LIKELY = (0.7, 1.5)
"""A micrometre of push beside what the map says of one: a pin that sticks, or tips, lies outside."""
CARD_PLACES_UM = ((2200.0, 0.0), (0.0, 2200.0), (-2200.0, 0.0))
"""Where the print's paper is touched, from its centre: beside the lines."""


@dataclass(frozen=True)
class Push:
    """One touch: how far the tip moved in the image, (2,) px, from free to half pressed and to pressed."""

    place: Position
    half_px: Array
    full_px: Array


async def press(sequence: MoveSequence, place: Position) -> Push:
    """Touch the surface below a place and come back up; `place` is the head's position at working height."""
    gantry = sequence.context.gantry
    down_um = gantry.work_z_um - gantry.touch_z_um
    free = await _tip_px(sequence, await sequence.go(place))
    try:
        half = await _tip_px(sequence, await sequence.go(shifted(place, dz_um=-down_um - gantry.press_um / 2)))
        full = await _tip_px(sequence, await sequence.go(shifted(place, dz_um=-down_um - gantry.press_um)))
    except Fault:
        await sequence.go(place)  # nothing is left standing on a board
        raise
    await sequence.go(place)
    return Push(place, half - free, full - free)


def heights_um(pushes: Sequence[Push], pose_map: PoseMap, press_um: float) -> list[float]:
    """Return the surface's height above the nominal touching plane at each touch, um.

    All touches share one scale, so one touch alone is good to 5 % of the push, a dozen to 2 %. Raises `Fault` if a
    touch met no surface, or if the tip did not move as a pushed pin does.
    """
    # By the map's scale, which is nearly right: what is left is one common factor.
    half = np.array([pose_map.height_from_shift_um(p.half_px) for p in pushes])
    full = np.array([pose_map.height_from_shift_um(p.full_px) for p in pushes])
    for push, pushed_um in zip(pushes, half, strict=True):
        if pushed_um < LEAST_PUSH_UM:
            at = push.place
            raise Fault(
                FaultCode.CALIBRATION_FAILED,
                f"half pressed the pin met no surface at X {at.x_um / 1e3:.2f} mm, Y {at.y_um / 1e3:.2f} mm",
                advice="correct gantry.touch_z_um, or raise gantry.press_um",
                pushed_um=round(float(pushed_um), 1),
            )
    scale = float((full - half).mean()) / (press_um / 2)
    if not LIKELY[0] <= scale <= LIKELY[1]:
        raise Fault(
            FaultCode.CALIBRATION_FAILED,
            f"the tip moved {scale:.2f} times as far as a pushed pin would",
            advice="see that the pin moves freely and the probe sits firmly, then calibrate the map again",
        )
    return [float(h) for h in full / scale - press_um]


async def card_height_um(sequence: MoveSequence, pose_map: PoseMap, over: Position) -> float:
    """Return the height of the control point's paper; 0 if it is not to be touched.

    `over`: where the head stands above its centre.
    """
    press_um = sequence.context.gantry.press_um
    if press_um <= 0.0:
        return 0.0
    pushes = [await press(sequence, shifted(over, dx, dy)) for dx, dy in CARD_PLACES_UM]
    return float(np.median(heights_um(pushes, pose_map, press_um)))


async def _tip_px(sequence: MoveSequence, position: Position) -> Array:
    """Return where the tip is in the image, px (2,), mean of a few."""
    context, job = sequence.context, sequence.job
    probe = context.calibrations.require_probe()
    found = []
    for _ in range(LOOKS):
        look = await context.station.look_white(position, probe, None, job)
        job.saw(look)
        tip = require_tip(look)
        found.append((tip.x_px, tip.y_px))
    mean: Array = np.array(found).mean(axis=0)
    return mean
