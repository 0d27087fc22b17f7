"""Observer of jobs, for maintenance. Nothing here may wait, raise, or cost a job time."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Protocol

from daemon.domain.point_test import PointRecord
from daemon.domain.results import JobResult, StepKind
from daemon.jobs.context import JobContext
from daemon.wire.events import Topic


class JobObserver:
    """What is called; by itself it does nothing, where there is no maintenance."""

    def on_step(self, job_id: str, kind: StepKind, body: Mapping[str, Any]) -> None:
        """Hear that a job looked or moved."""

    def on_result(self, job: JobContext, result: JobResult) -> None:
        """Hear that a job was answered; its last look may still be measured."""

    def on_point(self, record: PointRecord) -> None:
        """Hear what came of a point."""

    def on_touches(self, touches: int) -> None:
        """Hear of touches from the tester."""

    def on_flag(self, name: str, message: str | None) -> None:
        """Hear that something of the daemon's own is wrong; with None, that it no longer is."""


class Publisher(Protocol):
    """Where events go."""

    def publish(self, topic: Topic, body: dict[str, Any]) -> int | None:
        """Send one event and return its number; None if it is sent later, or cannot be numbered."""

    async def publish_written(self, topic: Topic, write: Callable[[int], Awaitable[dict[str, Any]]]) -> int:
        """Have `write` write one event down under its number and return its body, then send it."""
