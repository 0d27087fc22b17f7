"""Answers of a SCPI instrument: a number with or without its unit, an entry of the error queue. Pure.

Sources: SCPI-99 volume 1, 7.2.1 (9.9E37 is infinity, 9.91E37 not a number); volume 2, 21.8 (error queue).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from drivers.errors import MeterError, MeterTrouble
from drivers.meter.contract import Reading, Unit

INFINITY, NOT_A_NUMBER = 9.9e37, 9.91e37
_CLOSE = 1e34
"""A value of four digits or in single precision still is one of the two."""
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?)\s*([A-Z]*)", re.IGNORECASE)
_UNITS: dict[Unit, frozenset[str]] = {
    "ohm": frozenset({"", "OHM", "OHMS"}),
    "V": frozenset({"", "V", "VDC"}),
    "F": frozenset({"", "F", "FARAD"}),
}
_OVERLOADS = frozenset({"OL", "+OL", "-OL", "OVLD", "OVERLOAD", "INF", "+INF", "-INF", "NINF"})
_ERROR = re.compile(r'([+-]?\d+)\s*,\s*"?(.*?)"?')
SHOWN = 60


@dataclass(frozen=True)
class QueuedError:
    """One entry of the error queue; code 0 is "no error"."""

    code: int
    text: str


def parse_reading(text: str, unit: Unit, at_s: float) -> Reading:
    """Return the value an answer says.

    Raises:
        MeterError: it is no single number, is in another unit, or says that there is no valid value.

    """
    word = text.strip()
    if word.upper() in _OVERLOADS:
        below = word.startswith("-") or word.upper() == "NINF"
        return Reading(-math.inf if below else math.inf, unit, overload=True, at_s=at_s)
    found = _NUMBER.fullmatch(word)
    if found is None:
        raise MeterError(f"answers {shown(text)} where a number was asked for", MeterTrouble.GARBAGE)
    if found[2].upper() not in _UNITS[unit]:
        raise MeterError(f"answers {shown(text)}, which is not in {unit}", MeterTrouble.DIALECT)
    value = float(found[1])
    if abs(abs(value) - NOT_A_NUMBER) < _CLOSE:
        raise MeterError(f"answers {shown(text)}: not a number", MeterTrouble.INVALID)
    if abs(value) > INFINITY - _CLOSE:
        return Reading(math.copysign(math.inf, value), unit, overload=True, at_s=at_s)
    return Reading(value, unit, overload=False, at_s=at_s)


def parse_error(text: str) -> QueuedError | None:
    """Return the entry an answer to SYST:ERR? says, or None where it is no such answer."""
    found = _ERROR.fullmatch(text.strip())
    return QueuedError(int(found[1]), found[2]) if found else None


def shown(text: str) -> str:
    """Return an answer as it can be put into a message: short, and nothing that moves a terminal's cursor."""
    return ascii(text if len(text) <= SHOWN else text[:SHOWN] + "...")
