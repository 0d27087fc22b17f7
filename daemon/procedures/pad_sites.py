"""Room on a pad for a second site: how far beside its middle the needle may stand and still be on the pad's metal."""

from __future__ import annotations

import math

from daemon.config.sections.motion import ServoSection
from daemon.domain.board import BoardPoint

MARGIN_UM, LEAST_SHIFT_UM = 20.0, 40.0
"""Beside all errors so much metal is left; a site nearer than this to the first is none of its own."""
DIRECTION_RAD = math.radians(45.0)


def metal_radius_um(point: BoardPoint) -> float | None:
    """Return the radius of free bare metal about a target; None where the board file does not tell."""
    if point.room_um is not None:
        return point.room_um
    solid = point.diameter_um is not None and point.hole_um is None and point.centre_um is None
    return point.diameter_um / 2 if solid and point.diameter_um is not None else None


def on_metal_within_um(point: BoardPoint, servo: ServoSection) -> float | None:
    """Return how far off the target the tip still stands on its metal with most of its end."""
    radius_um = metal_radius_um(point)
    return None if radius_um is None else max(0.0, radius_um - servo.tip_radius_um)


def second_site(point: BoardPoint, servo: ServoSection) -> BoardPoint | None:
    """Return the target shifted within its metal; None where there is no room for tip, landing error and margin."""
    radius_um = metal_radius_um(point)
    if radius_um is None:
        return None
    shift_um = radius_um - servo.tip_radius_um - servo.landing_um - MARGIN_UM
    if shift_um <= LEAST_SHIFT_UM:
        return None
    x_um = point.x_um + shift_um * math.cos(DIRECTION_RAD)
    y_um = point.y_um + shift_um * math.sin(DIRECTION_RAD)
    middle_um = point.middle_um if point.diameter_um is not None else None
    return point.model_copy(update={"x_um": x_um, "y_um": y_um, "centre_um": middle_um})
