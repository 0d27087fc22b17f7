"""UTC timestamps, and a stopwatch that books a job's time."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

WAITS = ("motion", "bus", "light", "exposure")
"""What a job waits for and cannot hurry; the rest of its time is software."""


def utc_now() -> str:
    """Return the present moment as ISO 8601 in UTC."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


EARLIEST = "2025-01-01"
"""No station's clock can rightly stand before this: the program is younger."""
BEHIND = timedelta(minutes=10)


def clock_behind(now: str, last: str) -> str | None:
    """Return why the clock must be behind, None if nothing says so; times as of `utc_now`, `last` of what is kept.

    A computer without a battery for its clock comes up years behind, until the network tells it the time.
    """
    if now < EARLIEST:
        return f"it says {now[:16]} UTC, and this program is younger"
    if last and datetime.fromisoformat(now) + BEHIND < datetime.fromisoformat(last):
        return f"it says {now[:16]} UTC, and the last result was written at {last[:16]} UTC"
    return None


class Stopwatch:
    """Book a job's time by state and by what it was spent on.

    `spend` marks a wait; whatever of a state's time is not a wait is booked as `software`.
    """

    def __init__(self) -> None:
        self._state = "triggered"
        self._since_s = time.monotonic()
        self._total_s: defaultdict[str, float] = defaultdict(float)
        self._waits_s: defaultdict[str, defaultdict[str, float]] = defaultdict(lambda: defaultdict(float))
        self.bookings = 0
        """Grows with everything that is booked: a sign of life."""

    def enter(self, state: str) -> None:
        """Begin to book under another state."""
        now_s = time.monotonic()
        self._total_s[self._state] += now_s - self._since_s
        self._state, self._since_s = state, now_s

    @contextmanager
    def spend(self, what: str) -> Iterator[None]:
        """Book the time inside as a wait for `what`, one of `WAITS`."""
        start_s = time.monotonic()
        try:
            yield
        finally:
            self.book(what, time.monotonic() - start_s)

    def book(self, what: str, seconds: float) -> None:
        """Book seconds that were waited for `what` in the present state."""
        self._waits_s[self._state][what] += max(0.0, seconds)
        self.bookings += 1

    def timing_ms(self) -> dict[str, dict[str, float]]:
        """Return state -> {what: ms}, software and total included."""
        self.enter(self._state)
        table: dict[str, dict[str, float]] = {}
        for state, total_s in self._total_s.items():
            waits = {what: round(s * 1e3, 2) for what, s in self._waits_s[state].items()}
            software = max(0.0, total_s * 1e3 - sum(waits.values()))
            table[state] = {**waits, "software": round(software, 2), "total": round(total_s * 1e3, 2)}
        return table
