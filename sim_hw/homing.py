"""Homing methods of CiA 402 as lists of searches: which way, which edge, how fast."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto

from sim_hw.motor import Switch


class HomingStatus(Enum):
    """How a homing stands; the value gives statusword bits 13, 12, 10."""

    RUNNING = (0, 0, 0)
    INTERRUPTED = (0, 0, 1)
    DONE = (0, 1, 1)
    ERROR_STOPPED = (1, 0, 1)


class Stage(Enum):
    """What a search is doing."""

    SEARCH = auto()
    BRAKE = auto()


@dataclass(frozen=True)
class Search:
    """Go one way until the switch changes; 6099h:01 (fast) or 6099h:02."""

    upwards: bool
    switch: Switch
    fast: bool


#: Methods without index pulse: switch, the last search goes upwards, the last search leaves the switch.
_METHODS: dict[int, tuple[Switch, bool, bool]] = {
    17: ("negative", True, True),
    18: ("positive", False, True),
    19: ("home", False, True),
    20: ("home", True, False),
    21: ("home", True, True),
    22: ("home", False, False),
}

#: Take the present place as home, without motion.
HERE = (35, 37)

SUPPORTED = (*_METHODS, *HERE)


def searches(method: int, active: Callable[[Switch], bool]) -> tuple[Search, ...]:
    """Return the searches of a method from where the axis stands; empty for "home is here"."""
    if method in HERE:
        return ()
    switch, upwards, leaves = _METHODS[method]
    final = Search(upwards, switch, fast=False)
    before = Search(not upwards, switch, fast=True)
    if active(switch) == leaves:
        # The counting edge lies ahead at an unknown distance: find it fast, step back over it, then find it slowly.
        # On a limit switch the overlap is short: leave it slowly at once.
        return (final,) if switch != "home" else (Search(upwards, switch, fast=True), before, final)
    return (before, final)
