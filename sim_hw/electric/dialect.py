"""Dialect of an instrument: how it writes what others write otherwise, and which words it knows at all. Pure.

`terse` is within SCPI-99 as far as numbers go (volume 1, 7.2: any form of number), and like some old instruments
outside: an overload is a word, and errors have no quotes. `foreign` is no meter: common and system commands are all
that it shares with one.
"""

from __future__ import annotations

import re

TERSE, FOREIGN = "terse", "foreign"
_OVERLOAD = 9.9e37
_NUMBER = re.compile(r"[+-]\d\.\d+E[+-]\d+")
_ERROR = re.compile(r'\+?(-?\d+),"(.*)"')


def terse(said: str) -> str:
    """Return an answer in the fewest letters."""
    if _NUMBER.fullmatch(said):
        value = float(said)
        return "OL" if abs(value) >= _OVERLOAD else f"{value:.6G}"
    found = _ERROR.fullmatch(said)
    return f"{found[1]},{found[2]}" if found else said


def is_foreign(header: str) -> bool:
    """Tell whether an instrument that is no meter does not know a header."""
    return not header.startswith(("*", "SYST"))
