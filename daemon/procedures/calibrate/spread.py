"""Spread of the touched places: how surely a plane through them is known where it is used.

A plane through places that lie in a row is known along it, and across it is whatever noise makes of it. The standard
error at a place is the touch's own times the root of the place's leverage (hat matrix of the least-squares plane).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from daemon.domain.board import Board, BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.station.kinematics import EXTRAPOLATED_UM
from vision.geometry import Array

TOUCH_SIGMA_UM = 5.0
"""Of one touch's height: two pictures at each of two depths."""
SURE_WITHIN_UM = 15.0
"""Standard error that a height may have where the plane is used; the needle hovers 200 um above it."""
EASILY_UM = 8.0
"""A choice that is as good as this is taken without looking for a better one."""


def plane_sigma_um(places_um: Array, at_um: Array) -> float:
    """Return the largest standard error of a plane's height at some places (M, 2), touched at others (N, 2), um."""
    middle = places_um.mean(axis=0)
    scale = float(np.abs(places_um - middle).max()) or 1.0

    def terms(where: Array) -> Array:
        found: Array = np.column_stack((np.ones(len(where)), (where - middle) / scale))
        return found

    normal = terms(places_um).T @ terms(places_um)
    if len(places_um) < 3 or np.linalg.cond(normal) > 1e10:
        return math.inf
    wanted = terms(at_um)
    leverage = np.einsum("ij,jk,ik->i", wanted, np.linalg.inv(normal), wanted)
    return TOUCH_SIGMA_UM * float(np.sqrt(leverage.max()))


def corners_um(low: Array, high: Array) -> Array:
    """Return the corners (4, 2) of a box; a leverage is largest at one of them."""
    return np.array([(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])])


def used_um(points: Sequence[BoardPoint], board: Board) -> Array:
    """Return the corners of where a plane through these points is believed: about them, on the board."""
    places = np.array([point.place_um for point in points])
    low = np.maximum(places.min(axis=0) - EXTRAPOLATED_UM, 0.0)
    high = np.minimum(places.max(axis=0) + EXTRAPOLATED_UM, (board.width_um, board.height_um))
    return corners_um(np.minimum(low, places.min(axis=0)), np.maximum(high, places.max(axis=0)))


def require_spread(points: Sequence[BoardPoint], board: Board) -> float:
    """Return the standard error of the plane that these points will give; raise `Fault` where it would be a guess."""
    sigma_um = plane_sigma_um(np.array([point.place_um for point in points]), used_um(points, board))
    if sigma_um > SURE_WITHIN_UM:
        how = "" if math.isinf(sigma_um) else f": heights beside it would be known to {sigma_um:.0f} um only"
        raise Fault(
            FaultCode.CALIBRATION_FAILED,
            f"the surface is no plane: the places lie on a line, or nearly{how}",
            advice="touch more places (`places`); where the board has all its test points in a row, use a board file "
            "with layers, whose parts' pads are touched as well",
            places=[point.name for point in points],
        )
    return sigma_um
