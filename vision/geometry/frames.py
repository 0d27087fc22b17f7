"""Rigid transforms of the plane (thesis 6.4, eq. 6.10..6.14).

Robot frame: right-handed, um, theta counter-clockwise about +Z. Head frame {A}: fixed to the head, origin at the
probe tip, axes along the robot's when theta is 0. Board frame: um, x right and y up as in CAD, seen from the side
that is probed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def rotation(theta_deg: float) -> Array:
    """Return the 2x2 rotation by `theta_deg` counter-clockwise."""
    c, s = math.cos(math.radians(theta_deg)), math.sin(math.radians(theta_deg))
    return np.array([[c, -s], [s, c]])


@dataclass(frozen=True)
class Rigid2:
    """A rotation followed by a translation: `p_to = R p_from + t` (the planar part of eq. 6.10)."""

    theta_deg: float
    tx_um: float
    ty_um: float

    def apply(self, points_um: ArrayLike) -> Array:
        """Map points, shape (2,) or (N, 2), um."""
        p = np.asarray(points_um, dtype=float)
        return p @ rotation(self.theta_deg).T + (self.tx_um, self.ty_um)

    def inverse(self) -> Rigid2:
        """Return the transform the other way (eq. 6.11)."""
        tx, ty = rotation(-self.theta_deg) @ (-self.tx_um, -self.ty_um)
        return Rigid2(-self.theta_deg, float(tx), float(ty))

    def then(self, after: Rigid2) -> Rigid2:
        """Return this transform followed by `after`."""
        tx, ty = after.apply((self.tx_um, self.ty_um))
        return Rigid2(self.theta_deg + after.theta_deg, float(tx), float(ty))
