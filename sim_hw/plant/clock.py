"""Simulated time: the only place in the simulated station that looks at a clock."""

from __future__ import annotations

import time


class SimClock:
    """Map CLOCK_MONOTONIC to simulated seconds, which run `speed` times as fast and start at zero."""

    def __init__(self, speed: float = 1.0, start_wall_s: float | None = None) -> None:
        if not 0.0 < speed <= 1000.0:
            raise ValueError(f"speed must be above 0 and at most 1000, not {speed}")
        self.speed = speed
        self._start_wall_s = time.monotonic() if start_wall_s is None else start_wall_s

    def now_s(self) -> float:
        """Return the present simulated time in seconds."""
        return self.sim_of(time.monotonic())

    def sim_of(self, wall_s: float) -> float:
        """Return the simulated time at a CLOCK_MONOTONIC reading."""
        return (wall_s - self._start_wall_s) * self.speed

    def wall_of(self, t_s: float) -> float:
        """Return the CLOCK_MONOTONIC reading at a simulated time."""
        return self._start_wall_s + t_s / self.speed

    def wall_delay(self, dt_s: float) -> float:
        """Return how many wall seconds a simulated duration lasts, never less than zero."""
        return max(0.0, dt_s / self.speed)
