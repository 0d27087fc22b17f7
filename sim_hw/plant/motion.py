"""Trapezoidal motion as pieces of constant acceleration: exact at any time, no stepping."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Segment:
    """Constant acceleration from `t0_s` for `duration_s`; velocity never changes sign inside. Any length unit."""

    t0_s: float
    duration_s: float
    x0: float
    v0: float
    a: float

    @property
    def t1_s(self) -> float:
        """Return the time at which the segment ends."""
        return self.t0_s + self.duration_s

    def position(self, t_s: float) -> float:
        """Return the position at a time, held at the segment's ends."""
        dt_s = min(max(t_s - self.t0_s, 0.0), self.duration_s)
        return self.x0 + (self.v0 + 0.5 * self.a * dt_s) * dt_s

    def velocity(self, t_s: float) -> float:
        """Return the velocity at a time inside the segment."""
        return self.v0 + self.a * min(max(t_s - self.t0_s, 0.0), self.duration_s)

    def time_at(self, x: float) -> float | None:
        """Return when the segment passes a position, or None if it does not."""
        first, last = self.x0, self.position(self.t1_s)
        if not min(first, last) <= x <= max(first, last):
            return None
        distance = x - first
        if distance == 0.0:
            return self.t0_s
        # Stable root of a/2 dt^2 + v0 dt - distance = 0; v0 and a*dt never oppose past the turning point.
        root = math.sqrt(max(0.0, self.v0 * self.v0 + 2.0 * self.a * distance))
        dt_s = 2.0 * distance / (self.v0 + math.copysign(root, distance))
        return self.t0_s + min(max(dt_s, 0.0), self.duration_s)


@dataclass(frozen=True)
class Trajectory:
    """Contiguous segments, then rest at `end`."""

    segments: tuple[Segment, ...]
    start_s: float
    end: float

    @property
    def end_s(self) -> float:
        """Return the time at which the motion is over."""
        return self.segments[-1].t1_s if self.segments else self.start_s

    def position(self, t_s: float) -> float:
        """Return the position at a time at or after the start."""
        for segment in self.segments:
            if t_s < segment.t1_s:
                return segment.position(t_s)
        return self.end

    def velocity(self, t_s: float) -> float:
        """Return the velocity at a time at or after the start."""
        for segment in self.segments:
            if segment.t0_s <= t_s < segment.t1_s:
                return segment.velocity(t_s)
        return 0.0

    def rest_of(self, t_s: float) -> Trajectory:
        """Return what is left of the motion at a time at or after the start."""
        left = []
        for segment in self.segments:
            if segment.t1_s <= t_s:
                continue
            begin_s = max(t_s, segment.t0_s)
            begun = {"x0": segment.position(begin_s), "v0": segment.velocity(begin_s)}
            left.append(replace(segment, t0_s=begin_s, duration_s=segment.t1_s - begin_s, **begun))
        return Trajectory(tuple(left), t_s, self.end)

    def shifted(self, dx: float) -> Trajectory:
        """Return the same motion with all positions moved by `dx`."""
        moved = tuple(replace(segment, x0=segment.x0 + dx) for segment in self.segments)
        return Trajectory(moved, self.start_s, self.end + dx)


@dataclass(frozen=True)
class Ramps:
    """Limits of one motion: cruise speed (units/s), acceleration and deceleration (units/s^2), all above zero."""

    speed: float
    acceleration: float
    deceleration: float


def resting(t_s: float, x: float) -> Trajectory:
    """Return a trajectory that stays where it is."""
    return Trajectory((), t_s, x)


def plan_stop(t_s: float, x0: float, v0: float, deceleration: float) -> Trajectory:
    """Brake from `v0` to rest."""
    if v0 == 0.0:
        return resting(t_s, x0)
    segment = Segment(t_s, abs(v0) / deceleration, x0, v0, -math.copysign(deceleration, v0))
    return Trajectory((segment,), t_s, segment.position(segment.t1_s))


def plan_move(t_s: float, x0: float, v0: float, target: float, ramps: Ramps) -> Trajectory:
    """Go from (x0, v0) to rest at `target`; brakes and comes back where the target cannot be met any more."""
    builder = _Builder(t_s, x0, v0)
    stop = v0 * abs(v0) / (2.0 * ramps.deceleration)
    if v0 != 0.0 and ((target - x0) * v0 <= 0.0 or abs(target - x0) < abs(stop)):
        builder.to_speed(0.0, ramps.deceleration)
    builder.approach(target, ramps)
    return Trajectory(tuple(builder.segments), t_s, target)


class _Builder:
    """Append segments one after another."""

    def __init__(self, t_s: float, x: float, v: float) -> None:
        self.segments: list[Segment] = []
        self._t_s, self._x, self._v = t_s, x, v

    def _add(self, duration_s: float, a: float, v_end: float) -> None:
        if duration_s <= 0.0:
            return
        segment = Segment(self._t_s, duration_s, self._x, self._v, a)
        self.segments.append(segment)
        self._t_s, self._x, self._v = segment.t1_s, segment.position(segment.t1_s), v_end

    def to_speed(self, v: float, rate: float) -> None:
        """Change speed at a rate (units/s^2, positive)."""
        self._add(abs(v - self._v) / rate, math.copysign(rate, v - self._v), v)

    def approach(self, target: float, ramps: Ramps) -> None:
        """Accelerate, cruise and brake to rest at the target, which lies far enough ahead."""
        distance = abs(target - self._x)
        if distance == 0.0:
            return
        sign = math.copysign(1.0, target - self._x)
        v0, up, down = abs(self._v), ramps.acceleration, ramps.deceleration
        peak = math.sqrt((2.0 * up * down * distance + down * v0 * v0) / (up + down))
        peak = min(peak, ramps.speed)
        rate = up if peak >= v0 else down
        ramp_um = abs(peak * peak - v0 * v0) / (2.0 * rate) + peak * peak / (2.0 * down)
        self.to_speed(sign * peak, rate)
        self._add(max(0.0, distance - ramp_um) / peak, 0.0, sign * peak)
        self.to_speed(0.0, down)
