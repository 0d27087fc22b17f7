"""Course of a move: its legs one after the other, and what is done on the line while axes travel.

A short leg takes the line longer than the axes: what is to be asked or told before the move is over is done while they
travel. Nothing of it sets an axis in motion; what an axis is told to do next is only written down in its drive.
"""

import asyncio
import math
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

from drivers.deadline import Deadline
from drivers.gantry.contract import GantryAxis
from drivers.gantry.path import Leg
from drivers.shielded import finish

# While a leg is under way, one of the axes is looked at after so many of its pauses: each in turn, the one that was
# longest not looked at: a round of all four takes 80 ms. What is due by its trapezoid is looked at then
WATCH_EVERY_POLLS = 2
# No leg begins with a drive that was not looked at for so long
STALE_S = 0.25
_T = TypeVar("_T")
Halt = Callable[[Iterable[str]], Coroutine[Any, Any, None]]


class Course:
    """One move on its way. `halt` stops axes at once."""

    def __init__(self, axes: Mapping[str, GantryAxis], halt: Halt) -> None:
        self.leg_begun_s = math.inf
        """When the last leg was begun, monotonic: an axis that was looked at since was so beside it."""
        self.at_rest_s = -math.inf
        """When the axis that came to rest last was seen to stand, monotonic."""
        self._axes, self._halt = axes, halt
        self._under_way: set[str] = set()
        # Axes whose next target their drives have already, and when each was looked at before
        self._aimed: dict[str, float] = {}
        self._due_s: dict[str, float] = {}
        self._overdue: set[str] = set()
        self._next_s = 0.0
        # How long the last question took, the line's pause before it too
        self._took_s = 0.0

    async def run(self, legs: Sequence[Leg], deadline: Deadline) -> None:
        """Run all legs; each ends once all its axes were seen to be there."""
        for place, leg in enumerate(legs):
            self.leg_begun_s = time.monotonic()
            await self._begin(leg, deadline)
            while self._under_way:
                await self._turn(legs[place + 1] if place + 1 < len(legs) else None, deadline)
        for axis in self._axes.values():
            if axis.holds_start:
                await axis.let_go(deadline)

    async def _begin(self, leg: Leg, deadline: Deadline) -> None:
        """Start the axes of a leg together; none is left behind unseen, one that stands no more than one that goes."""
        for name, axis in self._axes.items():
            aims_now = name in leg.to and name not in self._aimed
            if not aims_now and self._looked_at_s(name) < time.monotonic() - STALE_S:
                await axis.check_standing(deadline)
        for name in leg.to:
            if name not in self._aimed:
                await self._aim(name, leg, deadline)
        for name in leg.to:
            await self._timed(self._axes[name].go(deadline))
        self._aimed.clear()
        self._under_way = set(leg.to)
        self._due_s = {name: self._axes[name].due_s for name in leg.to}
        self._overdue = set()
        self._next_s = time.monotonic() + self._pause_s

    async def _aim(self, name: str, leg: Leg, deadline: Deadline) -> None:
        axis, now_s = self._axes[name], time.monotonic()
        seen_s = axis.looked_at_s
        await axis.aim(leg.to[name], deadline, leg.speed_units_s, now_s - STALE_S)
        self._aimed[name] = seen_s if seen_s >= now_s - STALE_S else now_s

    def _looked_at_s(self, name: str) -> float:
        """Give when an axis was last looked at; that its drive was given a target since does not count."""
        return max(self._axes[name].looked_at_s, self._aimed.get(name, -math.inf))

    @property
    def _pause_s(self) -> float:
        return WATCH_EVERY_POLLS * min(axis.config.poll_s for axis in self._axes.values())

    # ------------------------------------------------------------------ while axes travel
    async def _turn(self, following: Leg | None, deadline: Deadline) -> None:
        """Do what is next on the line, or wait until something is."""
        first = min(self._under_way, key=self._due_s.__getitem__)
        left_s = self._due_s[first] - time.monotonic()
        if left_s <= 0.0:
            await self._look(first, deadline)
        elif (errand := self._errand(following, deadline)) is not None:
            await errand
        elif self._next_s > time.monotonic():
            await asyncio.sleep(max(0.0, min(left_s, self._next_s - time.monotonic())))
        elif left_s < self._took_s and first not in self._overdue:
            await asyncio.sleep(left_s)  # once an axis: a look that is on its way then would delay the one that is due
        else:
            await self._look(min(self._axes, key=self._looked_at_s), deadline)

    def _errand(self, following: Leg | None, deadline: Deadline) -> Awaitable[None] | None:
        """Give what has to be done before the move is over, and can be done now."""
        for axis in self._axes.values():
            if axis.holds_start:
                return axis.let_go(deadline)
        if following is None:
            return None
        since_s = time.monotonic() - STALE_S
        for name, at in following.to.items():
            waits = name not in self._under_way and name not in self._aimed
            if waits and self._axes[name].aims_at_once(at, since_s):
                return self._aim(name, following, deadline)
        return None

    async def _look(self, name: str, deadline: Deadline) -> None:
        """Look at an axis, whether it travels or stands."""
        axis, others = self._axes[name], partial(self._stop, self._under_way - {name})
        self._next_s = time.monotonic() + self._pause_s
        if name not in self._under_way:
            await self._timed(axis.check_standing(deadline, others))
        elif await self._timed(axis.arrived(deadline, others)):
            self._under_way.discard(name)
            self.at_rest_s = time.monotonic()
        elif self._due_s[name] <= time.monotonic():
            self._overdue.add(name)
            self._due_s[name] = time.monotonic() + axis.config.poll_s

    async def _timed(self, question: Awaitable[_T]) -> _T:
        asked_s = time.monotonic()
        answer = await question
        self._took_s = time.monotonic() - asked_s
        return answer

    async def _stop(self, moving: Iterable[str]) -> None:
        """Halt the axes under way at once; the move's end stops the rest, and these again."""
        await finish(self._halt(moving))
