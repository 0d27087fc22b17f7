"""End of a bent probe: the fault is given in pixels of the image, the truth needs micrometres."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from sim_hw.scene.optics import NEEDLE_DIRECTION, make_optics


@cache
def _head_um_per_px() -> tuple[float, float]:
    """Return the level move of the needle's end in the head frame that shifts it one pixel across its axis."""
    optics = make_optics()
    step_um = 10.0
    end, along_x, along_y = optics.project([[0.0, 0.0, 0.0], [step_um, 0.0, 0.0], [0.0, step_um, 0.0]])
    jacobian = np.column_stack([along_x - end, along_y - end]) / step_um
    # The needle is seen from its end upwards along -NEEDLE_DIRECTION; "across" is that turned by -90 deg in pixels.
    up = -np.array(NEEDLE_DIRECTION)
    move_um = np.linalg.solve(jacobian, np.array([up[1], -up[0]]))
    return float(move_um[0]), float(move_um[1])


def bend_um(bent_px: float, theta_deg: float) -> tuple[float, float]:
    """Return how far the end of a needle bent by so many pixels is from a straight one's, in the robot frame."""
    x_um, y_um = (bent_px * per_px for per_px in _head_um_per_px())
    c, s = math.cos(math.radians(theta_deg)), math.sin(math.radians(theta_deg))
    return c * x_um - s * y_um, s * x_um + c * y_um
