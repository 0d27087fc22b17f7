"""Values with a unit, as a test plan writes them: "4.7 kohm", "3.3 V", "10 nF"."""

from __future__ import annotations

import math
import re
from typing import get_args

from daemon.domain.point_test import PointUnit

_PREFIX = {"": 0, "p": -12, "n": -9, "u": -6, "\u00b5": -6, "\u03bc": -6, "m": -3, "k": 3, "K": 3, "M": 6, "G": 9}
_UNIT = {"ohm": "ohm", "ohms": "ohm", "\u03a9": "ohm", "\u2126": "ohm", "v": "V", "volt": "V", "f": "F", "farad": "F"}
_VALUE = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
EXAMPLE: dict[str, str] = {"ohm": "2 ohm", "V": "3.3 V", "F": "10 nF"}


def parse_value(given: object, unit: PointUnit) -> float:
    """Return a value in `unit` itself; ValueError, with what to write instead, for one without unit or of another."""
    example = EXAMPLE[unit]
    text = given if isinstance(given, str) else None
    found = _VALUE.fullmatch(text or "")
    if text is None:
        raise ValueError(f"{given!r} has no unit; write it with one, between quotes, such as {example!r}")
    if found is None:
        raise ValueError(f"{given!r} is no value; write a number with its unit, such as {example!r}")
    if not found[2]:
        raise ValueError(f"{given!r} has no unit; write {text.strip()!r} with one, such as {example!r}")
    exponent, of = _unit(found[2], text, example)
    if of != unit:
        raise ValueError(f"{given!r} is in {of}, and {unit} is measured here; write it such as {example!r}")
    value = float(f"{found[1]}e{exponent}") if "e" not in found[1].lower() else float(found[1]) * 10.0**exponent
    if not math.isfinite(value):
        raise ValueError(f"{given!r} is no finite value; leave the limit out where there is none")
    return value


def _unit(text: str, given: str, example: str) -> tuple[int, str]:
    """Return the power of ten and the unit of a text such as "kohm"; ValueError for none."""
    for prefix, exponent in _PREFIX.items():
        name = text[len(prefix) :].strip()
        if text.startswith(prefix) and (unit := _UNIT.get(name.lower()) or _UNIT.get(name)):
            return exponent, unit
    known = ", ".join(get_args(PointUnit))
    raise ValueError(f"{given!r}: {text!r} is no unit; there are {known} with p, n, u, m, k, M, G, such as {example!r}")


def with_unit(value: float | None, unit: str | None) -> str:
    """Return a value as people read and plans write it, such as "4.7 kohm"; four digits, nothing for None."""
    if value is None or unit is None:
        return "" if value is None else f"{value:.4g}"
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g} {unit}"
    power = min(9, max(-12, 3 * math.floor(math.log10(abs(float(f"{value:.4g}"))) / 3)))
    names = {-12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
    return f"{value / 10.0**power:.4g} {names[power]}{unit}"
