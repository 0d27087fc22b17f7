"""What a job runner works with, small: everything that a test does not name reaches nobody."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any, cast

from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.station_lock import StationLock
from daemon.jobs.surroundings import JobLimits, Surroundings

LIMITS = JobLimits(job_timeout_s=60.0, calibration_timeout_s=600.0, queue_length=4, queue_per_client=4)


class Published:
    """Keeps what was published."""

    def __init__(self) -> None:
        self.events: list[tuple[str, dict[str, Any]]] = []

    def publish(self, topic: str, body: dict[str, Any]) -> int:
        """Keep one event."""
        self.events.append((topic, body))
        return len(self.events)

    async def publish_written(self, topic: str, write: Callable[[int], Awaitable[dict[str, Any]]]) -> int:
        """Have one event written, then keep it."""
        return self.publish(topic, await write(len(self.events) + 1))


def idle_latch() -> FaultLatch:
    """Return the latch of a station that is open and idle."""
    latch = FaultLatch()
    latch.opened()
    return latch


def surroundings(**given: Any) -> Surroundings:
    """Return surroundings: an idle station, nobody listening, no devices."""
    nobody = cast("Any", None)
    parts: dict[str, Any] = {
        "station": "s", "latch": idle_latch(), "lock": StationLock(), "journal": nobody, "publisher": Published(),
        "images": nobody, "procedures": {}, "context": lambda: None, "limits": lambda: LIMITS,
    }  # fmt: skip
    return Surroundings(**{**parts, **given})
