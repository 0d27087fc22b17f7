"""Units of the drive: increments, and whatever unit of speed 60A9h says. Pure."""

import math
from dataclasses import dataclass

# Time codes in bits 8..15 of 60A9h (SI unit codes): 03h second, 47h minute
_SECONDS = {0x03: 1.0, 0x47: 60.0}
# Unit codes in bits 16..23: revolutions of the motor, and parts of one
_REVOLUTION = 0xB4
_INCREMENT = 0xB5
_PARTS_OF_A_TURN = {0x40: 400.0, 0x10: 2 * math.pi, 0x41: 360.0, 0x42: 21600.0, 0x43: 1296000.0}


@dataclass(frozen=True, slots=True)
class SpeedUnit:
    """How many motor increments per second one count of a speed object is."""

    increments_s: float

    def counts(self, increments_s: float) -> int:
        """Convert a speed (increments/s) or an acceleration (increments/s per s); never below one count."""
        return max(1, round(increments_s / self.increments_s))


def decode_speed_unit(raw: int, increments_per_rev: float) -> SpeedUnit | None:
    """Read 60A9h (exponent, unit, time); None when the unit is none a rotating motor can be told in."""
    exponent = (raw >> 24) - 256 if raw >> 31 else raw >> 24
    unit, per_s = raw >> 16 & 0xFF, _SECONDS.get(raw >> 8 & 0xFF)
    if per_s is None:
        return None
    if unit == _REVOLUTION:
        increments = increments_per_rev
    elif unit == _INCREMENT:
        increments = 1.0
    elif unit in _PARTS_OF_A_TURN:
        increments = increments_per_rev / _PARTS_OF_A_TURN[unit]
    else:
        return None
    return SpeedUnit(increments * 10.0**exponent / per_s)
