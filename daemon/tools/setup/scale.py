"""Scale of an axis: drive increments per um or degree, from its mechanics and from a measured move."""

from __future__ import annotations

import math

INCREMENTS_PER_TURN = 50 * 65536
"""50 pole pairs of 65536 increments each (manual of the drive, 2030h)."""
MOST_OFF, LEAST_MOVED = 5.0, 0.05
"""A measured move that is more than so many times what was asked, or less than such a part of it, is no measurement."""


def increments_per_unit(units_per_turn: float) -> float:
    """Return increments per unit of an axis that moves so many units (um, degrees) with one turn of its motor.

    ValueError for a travel that no axis has.
    """
    if not (math.isfinite(units_per_turn) and units_per_turn != 0):
        raise ValueError("an axis that moves nothing in a turn has no scale")
    return INCREMENTS_PER_TURN / units_per_turn


def corrected_increments(now: float, asked: float, moved: float) -> float:
    """Return the increments per unit with which the same move is as long as asked; a negative one turns the axis round.

    `asked`, `moved`: in one unit; `moved` as measured, negative where it went the other way. ValueError if that is no
    measurement.
    """
    if not (math.isfinite(moved) and LEAST_MOVED * abs(asked) <= abs(moved) <= MOST_OFF * abs(asked)):
        raise ValueError(f"{moved:g} is no measurement of a move of {asked:g}; measure again, or look at its drive")
    return now * asked / moved
