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
from daemon.domain.surface_points import LEAST_PLACES
from daemon.station.kinematics import EXTRAPOLATED_UM
from vision.geometry import Array

TOUCH_SIGMA_UM = 5.0
"""Of one touch's height: two pictures at each of two depths."""
SURE_WITHIN_UM = 15.0
"""Standard error that a height may have where the plane is used; the needle hovers 200 um above it."""
NARROW = 0.2
"""Places that spread across by less than this share of what they do along lie nearly on a line."""
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


def sigma_of(points: Sequence[BoardPoint], board: Board) -> float:
    """Return the largest standard error, where it is believed, of a plane through these points; inf: there is none."""
    if len(points) < LEAST_PLACES:
        return math.inf
    return plane_sigma_um(np.array([point.place_um for point in points]), used_um(points, board))


def require_spread(points: Sequence[BoardPoint], board: Board, range_um: float) -> float:
    """Return the standard error of the plane that these points will give; raise `Fault` where it would be a guess.

    range_um: a surface of which nothing is known lies within this of where the configuration has it.
    """
    sigma_um = sigma_of(points, board)
    if sigma_um <= SURE_WITHIN_UM:
        return sigma_um
    known_um = min(sigma_um, range_um)
    if len(points) < LEAST_PLACES:
        raise Fault(
            FaultCode.CALIBRATION_FAILED,
            f"the board has {len(points)} test points; a plane needs {LEAST_PLACES}: "
            f"heights beside them would be known to {known_um:.0f} um only",
            advice="use a board file with layers: parts' pads and pins are touched as well then; where it has layers, "
            "`reprobe board` says why the board's other metal may not be touched",
        )
    raise Fault(
        FaultCode.CALIBRATION_FAILED,
        f"the surface is no plane: {_shape(points)}: heights beside them would be known to {known_um:.0f} um only",
        advice="touch more places (`places`); use a board file with layers: parts' pads and pins are touched as well "
        "then; where it has layers, `reprobe board` says why the board's other metal may not be touched",
        places=[point.name for point in points],
    )


def _shape(points: Sequence[BoardPoint]) -> str:
    """Say how places lie that span no plane."""
    places = np.array([point.place_um for point in points])
    along, across = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return "the places lie on a line, or nearly" if across < NARROW * along else "the places lie close together"
