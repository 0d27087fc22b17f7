"""What is done on the line while axes travel: on a clock of its own, where each request takes 12 ms."""

import itertools
import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, cast

import pytest

from drivers.deadline import Deadline
from drivers.gantry import course
from drivers.gantry.contract import GantryAxis
from drivers.gantry.course import Course
from drivers.gantry.path import Leg

REQUEST_S = 0.012
SOON = Deadline.after(1e9)


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s

    async def sleep(self, seconds: float) -> None:
        assert seconds > 0.0, "it would spin"
        self.now_s += seconds


class Line:
    """All that was asked and told: when it was over, whom, what."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.log: list[tuple[float, str, str]] = []

    async def request(self, name: str, what: str) -> None:
        self.clock.now_s += REQUEST_S
        self.log.append((round(self.clock.now_s - 1000.0, 6), name, what))

    def told(self) -> list[str]:
        return [f"{name} {what}" for _, name, what in self.log]


class FakeAxis:
    """One that runs and takes `travel_s` for any way."""

    config = SimpleNamespace(poll_s=0.01)

    def __init__(self, name: str, line: Line, travel_s: float) -> None:
        self.name, self.line, self.travel_s = name, line, travel_s
        self.looked_at_s, self.due_s = line.clock.now_s, 0.0
        self.holds_start = False
        self.ready = True
        self._taken = True

    async def aim(self, _at: float, _deadline: Any, _speed: Any, since_s: float) -> None:
        if self.looked_at_s < since_s:
            await self.line.request(self.name, "look")
        if self.holds_start:
            await self.let_go(_deadline)
        await self.line.request(self.name, "target")
        self.looked_at_s = -math.inf

    def aims_at_once(self, _at: float, since_s: float) -> bool:
        return self.ready and self.looked_at_s >= since_s

    async def go(self, _deadline: Any) -> None:
        await self.line.request(self.name, "go")
        assert not self.holds_start, "bit 4 could not rise"
        self._taken, self.due_s = False, self.line.clock.now_s + self.travel_s

    async def let_go(self, _deadline: Any) -> None:
        await self.line.request(self.name, "let go")
        self.holds_start = False

    async def check_standing(self, _deadline: Any, _stop: Any = None) -> None:
        self.looked_at_s = self.line.clock.now_s
        await self.line.request(self.name, "look")

    async def arrived(self, deadline: Any, _stop: Any = None) -> bool:
        there = self.line.clock.now_s >= self.due_s
        await self.check_standing(deadline)
        self.holds_start, self._taken = self.holds_start or not self._taken, True
        return there


Axes = Mapping[str, FakeAxis]


@pytest.fixture
def axes(monkeypatch: pytest.MonkeyPatch) -> Axes:
    clock = Clock()
    monkeypatch.setattr(course, "time", clock)
    monkeypatch.setattr(course, "asyncio", clock)
    line = Line(clock)
    return {name: FakeAxis(name, line, 0.02) for name in ("x", "y", "z", "theta")}


async def run(axes: Axes, *legs: Leg) -> Course:
    async def halt(_names: Any) -> None:
        raise AssertionError("nothing failed")

    made = Course(cast("Mapping[str, GantryAxis]", axes), halt)
    await made.run(legs, SOON)
    return made


UP, ASIDE, ACROSS, DOWN = Leg({"z": 5.3}), Leg({"x": 1.0, "y": 1.0}), Leg({"x": 2.0, "y": 2.0}), Leg({"z": 5.2})


async def test_a_hop_has_its_next_targets_told_while_axes_travel_and_nothing_asked_twice(axes: Axes) -> None:
    """It should start no axis before the leg before is over, and leave no start bit behind."""
    made = await run(axes, UP, ASIDE, ACROSS, DOWN)
    line = axes["x"].line
    assert line.told() == [
        "z target", "z go", "x target", "y target", "z look", "x go",
        "y go", "z let go", "x look", "y look", "x let go", "x target",
        "y let go", "y target", "x go", "y go", "z target", "x look",
        "y look", "z go", "x let go", "y let go", "z look", "z let go",
    ]  # fmt: skip
    assert made.at_rest_s == pytest.approx(1000.0 + line.log[-2][0])
    assert not any(axis.holds_start for axis in axes.values())


async def test_no_question_is_begun_just_before_an_axis_is_due(axes: Axes) -> None:
    """It should wait for the few milliseconds rather than come late by one question."""
    axes["z"].travel_s = 0.25
    await run(axes, UP)
    went_s = next(when_s for when_s, _, what in axes["z"].line.log if what == "go")
    arrived = [when_s for when_s, name, what in axes["z"].line.log if (name, what) == ("z", "look")][-1]
    assert arrived - went_s == pytest.approx(0.25 + REQUEST_S)


async def test_an_axis_that_does_not_come_does_not_keep_the_others_from_being_watched(axes: Axes) -> None:
    """It should look at all of them as often as before while it asks that one again and again."""
    line, late_s = axes["x"].line, 1.0
    arrived = axes["x"].arrived

    async def late(deadline: Any, stop: Any = None) -> bool:
        return await arrived(deadline, stop) and line.clock.now_s > 1000.0 + late_s

    axes["x"].arrived = late  # type: ignore[method-assign]
    await run(axes, ACROSS)
    for name in ("y", "z", "theta"):
        looks = [when_s for when_s, who, what in line.log if (who, what) == (name, "look")]
        gaps = [b - a for a, b in itertools.pairwise(looks)]
        assert max(gaps) < 0.2
        assert looks[-1] > late_s - 0.2


async def test_standing_axes_are_watched_in_turn_on_a_long_way(axes: Axes) -> None:
    """It should come to each of the four every 80 ms."""
    axes["z"].travel_s = 1.0
    await run(axes, UP, ASIDE)
    for name in axes:
        looks = [when_s for when_s, who, what in axes["x"].line.log if (who, what) == (name, "look") and when_s < 1.0]
        assert max(b - a for a, b in itertools.pairwise(looks)) <= 4 * 0.02 + 2 * REQUEST_S


async def test_a_drive_that_has_to_be_asked_first_is_not_told_its_target_ahead(axes: Axes) -> None:
    """It should be switched on, or asked, only while nothing travels."""
    axes["x"].ready = axes["y"].ready = False
    await run(axes, UP, ASIDE)
    told = axes["x"].line.told()
    assert told.index("x target") > told.index("z look")


async def test_a_drive_that_was_told_long_ago_is_looked_at_before_it_starts(
    axes: Axes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should begin no leg with a drive not looked at for a quarter of a second, told its target or not."""
    axes["z"].travel_s = 0.4
    monkeypatch.setattr(course, "WATCH_EVERY_POLLS", 1000)
    await run(axes, UP, ASIDE)
    line = axes["x"].line
    for name in ("x", "y"):
        went_s = next(when_s for when_s, who, what in line.log if (who, what) == (name, "go"))
        told_s = next(when_s for when_s, who, what in line.log if (who, what) == (name, "target"))
        looked_s = [when_s for when_s, who, what in line.log if (who, what) == (name, "look") and when_s < went_s]
        assert told_s < went_s - course.STALE_S
        assert looked_s[-1] > went_s - course.STALE_S
