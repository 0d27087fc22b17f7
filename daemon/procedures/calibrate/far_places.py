"""Far places of the map's walk: where the head may stand, some millimetres from the target, to see it far from the tip.

The needle comes down there as low as beside the target, where nobody asked for it: a place is left out where anything
that is known stands below needle or barrel. The target was chosen for what is near it; what is far off was not.
"""

from __future__ import annotations

import asyncio
import math

from daemon.config.sections.motion import ClearanceSection
from daemon.jobs.context import StationContext
from daemon.procedures.move_sequence import shifted
from drivers.errors import EnvelopeViolation
from drivers.gantry import Position
from vision.geometry import Array

FAR_UM, FAR_COUNT = 3_000.0, 8
"""Places of the far ring."""
FAR_REACH_PX = 25.0
"""What the near rings leave open out there is a third of this, one sigma."""


def far_places(centre: Position) -> list[Position]:
    """Return the places of the far ring."""
    angles = (2 * math.pi * (k + 0.5) / FAR_COUNT for k in range(FAR_COUNT))
    return [shifted(centre, FAR_UM * math.cos(angle), FAR_UM * math.sin(angle)) for angle in angles]


def in_picture(context: StationContext, size_um: float, expected_px: Array) -> bool:
    """Whether a whole target is in the picture, wherever it is within reach of where it is expected."""
    camera = context.camera
    margin_px = FAR_REACH_PX + size_um / camera.pitch_um
    inside = (expected_px >= margin_px) & (expected_px <= (camera.width - margin_px, camera.height - margin_px))
    return bool(inside.all())


async def may_stand(context: StationContext, place: Position) -> bool:
    """Whether the axes reach a place, from below as they come to it, and nothing that is known stands there."""
    room_um = context.gantry.approach_um
    try:
        context.station.check(place)
        context.station.check(shifted(place, -room_um, -room_um))
    except EnvelopeViolation:
        return False
    return await asyncio.to_thread(_nothing_stands, context, place)


def _nothing_stands(context: StationContext, place: Position) -> bool:
    """Ask reference pad, brush and the board's file; the board may lie as far off as can be corrected."""
    geometry, tip_um = context.geometry, context.geometry.tip_um(place)
    head = context.config.clearance or ClearanceSection()
    reach_um = head.barrel_radius_um + context.servo.max_placement_um
    if geometry.highest_pad_z_um(tip_um[None], reach_um) > (place.z_um + context.gantry.touch_z_um) / 2:
        return False
    if not context.by_cad:
        return True
    at_um = geometry.robot_to_board_um(tip_um)
    return not context.references.sides.obstacles.covers_near(at_um - reach_um, at_um + reach_um)
