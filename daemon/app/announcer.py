"""Announcements of the daemon as a whole: state changes, the heartbeat, reloads, jobs that a kill cut off."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any

import structlog

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody, JobResult
from daemon.domain.states import State
from daemon.jobs.fault_latch import StateChange
from daemon.jobs.observer import Publisher
from daemon.platform.clock import utc_now
from daemon.platform.systemd_notify import Notifier
from daemon.storage.journal import Journal
from daemon.telemetry.status_line import StatusLine

RELOADED = {
    "taken": "",
    "waits": "a new configuration waits for the job to end",
    "refused": "the new configuration was refused, the old one stays: {problems}",
}
"""What the status line says of a reload."""
log = structlog.get_logger(__name__)


class Announcer:
    """Tell subscribers and the service manager what happens to the daemon."""

    def __init__(
        self,
        publisher: Publisher,
        journal: Journal,
        status_line: StatusLine,
        notifier: Notifier,
        station: str,
        version: str,
    ) -> None:
        self._publisher, self._journal = publisher, journal
        self._status_line, self._notifier = status_line, notifier
        self._station, self._version = station, version
        self._left: list[tuple[str, str]] | None = None
        """Jobs that were cut off and have no result yet; None until the journal was asked."""

    def on_change(self, change: StateChange) -> None:
        """Publish a transition, log it, and bring the status line up to date."""
        fault = change.fault if change.after is State.FAULT else None
        self._publisher.publish(
            "state",
            {
                "state": change.after.value,
                "was": change.before.value,
                "event": change.event.value,
                "job": change.job,
                "fault": ErrorBody.of(fault).model_dump(mode="json") if fault else None,
            },
        )
        log.info("state", change=f"{change.before.value} --{change.event.value}--> {change.after.value}")
        self._status_line.refresh()

    async def beat(self, state: Callable[[], State], every_s: Callable[[], float]) -> None:
        """Publish the heartbeat until cancelled."""
        while True:
            await self._journal.reserve_seqs()
            self._publisher.publish("heartbeat", {"state": state().value, "version": self._version})
            await asyncio.sleep(every_s())

    async def tell_of_reload(self, what: str, facts: dict[str, object]) -> None:
        """Say to the service manager and to subscribers how a new configuration fared."""
        if what == "begun":
            self._notifier.reloading()
            return
        self._status_line.note(RELOADED[what].format(problems=_some(facts.get("problems"))))
        self._notifier.ready(self._status_line.line())
        await self._journal.reserve_seqs()
        self._publisher.publish("log", {"event": f"configuration_{what}", **facts})

    async def report_interrupted(self) -> None:
        """Give each job that a crash or a kill cut off its result: a fault; nothing moves.

        Raises `Fault` if the journal cannot be written. Once it has come to its end, calling it again does nothing:
        what has no result from then on is this daemon's own.
        """
        if self._left is None:
            self._left = await self._journal.unfinished()
        while self._left:
            job_id, op = self._left[0]
            await self._publisher.publish_written("result", partial(self._interrupt, job_id, op))
            self._left.pop(0)

    async def _interrupt(self, job_id: str, op: str, seq: int) -> dict[str, Any]:
        result = JobResult(
            id=job_id, op=op, ok=False, seq=seq, station=self._station, finished_at=utc_now(), outcome="failed",
            error=ErrorBody.of(Fault(FaultCode.INTERRUPTED)),
        )  # fmt: skip
        await self._journal.finish_job(result)
        return result.model_dump(mode="json")


def _some(problems: object) -> str:
    """Return the first problems of a configuration in one line."""
    listed = [f"{where}: {what}" for where, what in problems] if isinstance(problems, list) else []
    return ", ".join(listed[:2]) + (f" and {len(listed) - 2} more" if len(listed) > 2 else "")
