"""User-defined units of a drive (60A8h position, 60A9h speed): what one unit is in the machine's own units."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_hw.plant.axis import INCREMENTS_PER_REV, AxisSpec

_PER_REV = {
    0xB4: 1.0,
    0xB5: float(INCREMENTS_PER_REV),
    0xAC: 200.0,
    0x40: 400.0,
    0x10: 2.0 * math.pi,
    0x41: 360.0,
    0x42: 21_600.0,
    0x43: 1_296_000.0,
}
"""Unit code (bits 16..23) -> units per motor revolution (drive manual, "User-defined units")."""

_SECONDS = {0x03: 1.0, 0x47: 60.0, 0x48: 3600.0}
"""Time code (bits 8..15 of 60A9h, CiA 303) -> seconds."""


@dataclass(frozen=True)
class Units:
    """How many position units and speed units one machine unit (um, deg; per second) is."""

    position: float
    speed: float

    @property
    def acceleration(self) -> float:
        """Return how many units of acceleration one machine unit/s^2 is: speed units per second."""
        return self.speed


def known(code: int, *, timed: bool) -> bool:
    """Tell whether the drive knows a unit object's value."""
    return (code >> 16 & 0xFF) in _PER_REV and (not timed or (code >> 8 & 0xFF) in _SECONDS)


def units_for(spec: AxisSpec, position_code: int, speed_code: int) -> Units:
    """Return the units in force for 60A8h and 60A9h."""
    revs_per_unit = spec.increments_per_unit / INCREMENTS_PER_REV
    seconds = _SECONDS[speed_code >> 8 & 0xFF]
    return Units(_per_rev(position_code) * revs_per_unit, _per_rev(speed_code) * revs_per_unit * seconds)


def _per_rev(code: int) -> float:
    """Return units per revolution, the power of ten (bits 24..31, signed) applied."""
    exponent = (code >> 24 & 0xFF) - (256 if code >> 31 & 1 else 0)
    return _PER_REV[code >> 16 & 0xFF] / 10.0**exponent
