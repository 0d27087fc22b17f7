"""A point in time by which something must be done, passed down as one object."""

import time
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Deadline:
    """An instant of CLOCK_MONOTONIC (`time.monotonic()`), in seconds."""

    at_s: float

    @classmethod
    def after(cls, seconds: float) -> "Deadline":
        """Make a deadline `seconds` from now."""
        return cls(time.monotonic() + seconds)

    @property
    def remaining_s(self) -> float:
        """Give the time left in seconds, never less than zero."""
        return max(0.0, self.at_s - time.monotonic())

    @property
    def expired(self) -> bool:
        """Tell whether the instant has passed."""
        return time.monotonic() >= self.at_s

    def within(self, seconds: float) -> "Deadline":
        """Give the earlier of this deadline and one `seconds` from now."""
        return Deadline(min(self.at_s, time.monotonic() + seconds))
