"""Homing mode: the methods of CiA 402 without index pulse, and the run through their searches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum

from sim_hw.drive.motor import Switch
from sim_hw.drive.stage import Due, Stage
from sim_hw.plant.motion import Ramps

_START, _HALT = 1 << 4, 1 << 8

FARTHEST = 2**31 - 1
"""Position units of the longest way, the range of a 32-bit count."""


class HomingStatus(Enum):
    """How a homing stands; the value gives statusword bits 13, 12, 10."""

    RUNNING = (0, 0, 0)
    INTERRUPTED = (0, 0, 1)
    DONE = (0, 1, 1)
    FAILED = (1, 0, 1)


@dataclass(frozen=True)
class Search:
    """Go one way until the switch changes; with 6099h:01 (fast) or 6099h:02."""

    upwards: bool
    switch: Switch
    fast: bool

    @property
    def limit(self) -> Switch:
        """Return the limit switch at the end of this way."""
        return "positive" if self.upwards else "negative"


_METHODS: dict[int, tuple[Switch, bool, bool]] = {
    17: ("negative", True, True),
    18: ("positive", False, True),
    19: ("home", False, True),
    20: ("home", True, False),
    21: ("home", True, True),
    22: ("home", False, False),
}
"""Switch, the last search goes upwards, the last search leaves the switch."""

_HERE = (35, 37)
"""Take the present place as home, without motion."""

METHODS = (*_METHODS, *_HERE)


def searches(method: int, active: Callable[[Switch], bool]) -> tuple[Search, ...]:
    """Return the searches of a method from where the axis stands; empty for "home is here"."""
    if method in _HERE:
        return ()
    switch, upwards, leaves = _METHODS[method]
    final = Search(upwards, switch, fast=False)
    before = Search(not upwards, switch, fast=True)
    if active(switch) != leaves:
        return (before, final)
    # The counting edge lies ahead at an unknown distance: find it fast, step back over it, then find it slowly.
    # On a limit switch the overlap is short: leave it slowly at once.
    return (final,) if switch != "home" else (Search(upwards, switch, fast=True), before, final)


class Homing:
    """Run one homing after the other."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self.reset()

    def reset(self) -> None:
        """Drop what is being done; what turns keeps turning until it is stopped."""
        self._searches: tuple[Search, ...] = ()
        self._braking = False
        self._status = HomingStatus.INTERRUPTED

    @property
    def running(self) -> bool:
        """Tell whether an edge is being looked for."""
        return bool(self._searches)

    def operate(self, word: int, rising: int) -> None:
        """Act on a new controlword in "operation enabled"."""
        if rising & _START:
            self._start()
        elif self.running and (rising & _HALT or not word & _START):
            self.reset()
            self._stage.stop(0x609A)

    def due(self) -> Iterator[Due]:
        """Yield what is going to happen by itself."""
        if not self._searches:
            return
        stage, search = self._stage, self._searches[0]
        end_s = max(stage.now_s, stage.motor.demand.end_s)
        if self._braking:
            yield end_s, self._next
            return
        yield from self._crossing(search, search.switch, self._found)
        if search.limit != search.switch:
            yield from self._crossing(search, search.limit, self._fail)
        yield end_s, self._fail

    def status_bits(self) -> int:
        """Return statusword bits 10, 12 and 13."""
        bit13, bit12, bit10 = self._status.value
        return bit13 << 13 | bit12 << 12 | bit10 << 10

    def _crossing(self, search: Search, switch: Switch, then: Callable[[], None]) -> Iterator[Due]:
        stage = self._stage
        if stage.watched(switch):
            when_s = stage.motor.crossing(switch, stage.motor.demand.start_s, upwards=search.upwards)
            if when_s is not None:
                yield when_s, then

    def _start(self) -> None:
        self.reset()
        self._searches = searches(self._stage.objects.get(0x6098), self._stage.active)
        if self._searches:
            self._status = HomingStatus.RUNNING
            self._search()
        else:
            self._set_home(found=False)
            self._status = HomingStatus.DONE

    def _search(self) -> None:
        """Set out as far as the drive can count: it does not know how long its axis is."""
        stage, search = self._stage, self._searches[0]
        self._braking = False
        reach = FARTHEST / stage.units.position * (1.0 if search.upwards else -1.0)
        speed = max(stage.speed(0x6099, 1 if search.fast else 2), 1.0 / stage.units.speed)
        ramps = Ramps(speed, stage.rate(0x609A), stage.rate(0x609A))
        stage.motor.go(stage.now_s, stage.motor.position(stage.now_s) + reach, ramps)
        if search.limit != search.switch and stage.active(search.limit):
            self._fail()

    def _found(self) -> None:
        self._braking = True
        if len(self._searches) == 1:
            self._set_home(found=True)
        self._stage.stop(0x609A)

    def _next(self) -> None:
        self._searches = self._searches[1:]
        if self._searches:
            self._search()
        else:
            self._status = HomingStatus.DONE

    def _set_home(self, *, found: bool) -> None:
        stage = self._stage
        offset = stage.plant.knobs.home_offset_sign * stage.position(0x607C)
        stage.motor.set_position(stage.now_s, offset, found=found)

    def _fail(self) -> None:
        self.reset()
        self._status = HomingStatus.FAILED
        self._stage.stop(0x609A)
