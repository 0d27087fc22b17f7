"""Trace of the needle's end through time: when it comes down on something, how each press goes, when it is free again.

Reads the plant's exact motion from where it stopped reading, in steps as long as nothing can have been touched
meanwhile, so what it finds hardly depends on how often it is asked. Time is an argument.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from sim_hw.plant.plant import Plant
from sim_hw.scene.needle_bend import bend_um

FASTEST_UM_PER_S = 100_000.0
"""Nothing comes down faster."""
_STEP_S = 0.001
_BISECTED_S = 1e-6
_SPEED_OVER_S = 1e-4
STROKE_UM = 30.0
"""A press begins anew when the pin is pushed in by so much again."""
_BACK_UM = 2.0
_TURN_UM = 0.2


@dataclass(frozen=True)
class Point:
    """Where the needle's end is: robot frame, um; `push_um` is how far below the surface it would be, were it free."""

    t_s: float
    x_um: float
    y_um: float
    push_um: float


@dataclass(frozen=True)
class Moment:
    """Something that happened: it came down, a push came to its end, it went sideways while down, it came free."""

    kind: Literal["down", "pushed", "dragged", "free"]
    point: Point
    speed_um_s: float = 0.0
    """Downwards, where it came down."""
    dragged_um: float = 0.0


@dataclass
class _Stay:
    """One stay on the surface."""

    began: Point
    rising: bool = True
    inwards: bool = True
    last_um: float = 0.0
    peak_um: float = 0.0
    valley_um: float = 0.0
    dragged_um: float = 0.0
    told_drag: bool = False


class Trace:
    """Follow one needle."""

    def __init__(self, plant: Plant, *, drag_um: float = 2.0) -> None:
        self._plant = plant
        self._drag_um = drag_um
        self._stay: _Stay | None = None
        self._last = self.point(0.0)

    @property
    def inwards(self) -> bool:
        """Tell whether the pin was last moved into its barrel, not out of it."""
        return self._stay is None or self._stay.inwards

    def point(self, t_s: float) -> Point:
        """Return where the end is at a time within the plant's memory."""
        plant = self._plant
        state = plant.state_at(t_s)
        x_um, y_um = state.tip_x_um, state.tip_y_um
        if plant.faults.on("bent"):
            dx_um, dy_um = bend_um(float(plant.faults.get("bent")["px"]), state.theta_deg)
            x_um, y_um = x_um + dx_um, y_um + dy_um
        push_um = state.pressed_um - state.tip_height_um
        return Point(t_s, x_um, y_um, -math.inf if plant.faults.on("missing") else push_um)

    def until(self, t_s: float) -> Iterator[Moment]:
        """Yield what happened up to a time, in its order."""
        while self._last.t_s < t_s:
            rest_s = self._plant.rest_s()
            resting = self._last.t_s >= rest_s
            here = self.point(t_s if resting else min(t_s, rest_s, self._last.t_s + self._step_s()))
            yield from self._stepped(here, still=here.t_s >= rest_s)
            self._last = here

    def _step_s(self) -> float:
        """Return how long nothing new can be touched."""
        away_um = -self._last.push_um
        return 0.1 if math.isinf(away_um) else max(_STEP_S, away_um / FASTEST_UM_PER_S)

    def _stepped(self, here: Point, *, still: bool) -> Iterator[Moment]:
        if self._stay is None and here.push_um > 0.0:
            first = self._crossing(self._last, here)
            self._stay = _Stay(first)
            yield Moment("down", first, speed_um_s=self._speed(first))
        stay = self._stay
        if stay is None:
            return
        if here.push_um <= 0.0:
            if stay.rising:
                yield Moment("pushed", self._last if self._last.push_um > 0.0 else stay.began)
            self._stay = None
            yield Moment("free", self._crossing(here, self._last), dragged_um=stay.dragged_um)
            return
        yield from self._pushed(stay, here, still=still)
        stay.dragged_um = max(stay.dragged_um, math.dist((here.x_um, here.y_um), (stay.began.x_um, stay.began.y_um)))
        if stay.dragged_um > self._drag_um and not stay.told_drag:
            stay.told_drag = True
            yield Moment("dragged", here, dragged_um=stay.dragged_um)

    @staticmethod
    def _pushed(stay: _Stay, here: Point, *, still: bool) -> Iterator[Moment]:
        push_um = here.push_um
        if abs(push_um - stay.last_um) > _TURN_UM:
            stay.inwards, stay.last_um = push_um > stay.last_um, push_um
        if stay.rising:
            stay.peak_um = max(stay.peak_um, push_um)
            if still or push_um < stay.peak_um - _BACK_UM:
                yield Moment("pushed", Point(here.t_s, here.x_um, here.y_um, stay.peak_um))
                stay.rising, stay.valley_um = False, push_um
        else:
            stay.valley_um = min(stay.valley_um, push_um)
            if push_um > stay.valley_um + STROKE_UM:
                stay.rising, stay.peak_um = True, push_um
                yield from Trace._pushed(stay, here, still=still)

    def _crossing(self, above: Point, below: Point) -> Point:
        """Return where the end is at the surface between two times; the first is above it, the second not."""
        while abs(below.t_s - above.t_s) > _BISECTED_S:
            middle = self.point((above.t_s + below.t_s) / 2.0)
            if middle.push_um > 0.0:
                below = middle
            else:
                above = middle
        return below

    def _speed(self, at: Point) -> float:
        before = self.point(at.t_s - _SPEED_OVER_S)
        return max(0.0, (at.push_um - before.push_um) / (at.t_s - before.t_s))
