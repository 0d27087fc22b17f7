"""Announcements of the daemon as a whole: state changes, the heartbeat, reloads, jobs that a kill cut off."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

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
            await self._reserve_seqs()
            self._publisher.publish("heartbeat", {"state": state().value, "version": self._version})
            await asyncio.sleep(every_s())

    async def tell_of_reload(self, what: str, facts: dict[str, object]) -> None:
        """Say to the service manager and to subscribers how a new configuration fared."""
        if what == "begun":
            self._notifier.reloading()
            return
        self._status_line.note(RELOADED[what].format(problems=_some(facts.get("problems"))))
        self._notifier.ready(self._status_line.line())
        await self._reserve_seqs()
        self._publisher.publish("log", {"event": f"configuration_{what}", **facts})

    async def _reserve_seqs(self) -> None:
        """Reserve event numbers; a full disk is told by the jobs and must not end the daemon.

        Half a block is left when this fails for the first time: enough for an hour in which no job runs.
        """
        try:
            await self._journal.reserve_seqs()
        except Fault as disk:
            log.error("event_numbers_not_reserved", error=disk.message)

    async def report_interrupted(self) -> None:
        """Give each job that a crash or a kill cut off its result: a fault; nothing moves."""
        for job_id, op in await self._journal.unfinished():
            error = ErrorBody.of(Fault(FaultCode.INTERRUPTED))
            result = JobResult(
                id=job_id, op=op, ok=False, seq=self._journal.take_seq(), station=self._station,
                finished_at=utc_now(), outcome="failed", error=error,
            )  # fmt: skip
            await self._journal.finish_job(result)
            self._publisher.publish("result", result.model_dump(mode="json"), seq=result.seq)


def _some(problems: object) -> str:
    """Return the first problems of a configuration in one line."""
    listed = [f"{where}: {what}" for where, what in problems] if isinstance(problems, list) else []
    return ", ".join(listed[:2]) + (f" and {len(listed) - 2} more" if len(listed) > 2 else "")
