"""Touch counter: the daemon's own touches, each written down at once, beside those that the tester reports."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import structlog

from daemon.domain.errors import Fault
from daemon.maintenance.monitor import Monitor
from daemon.storage.journal import Journal
from daemon.telemetry.metrics import Metrics

log = structlog.get_logger(__name__)


class TouchCounter:
    """Count each touch in the journal, for maintenance, and for a scrape."""

    def __init__(
        self, journal: Journal, metrics: Metrics, monitor: Callable[[], Monitor], job: Callable[[], str | None]
    ) -> None:
        """Take where touches are counted, and who tells the id of the job that runs."""
        self._journal, self._metrics, self._monitor, self._job = journal, metrics, monitor, job
        self._writes: set[asyncio.Task[None]] = set()

    def touched(self) -> None:
        """Count one touch; the disk is not waited for."""
        self._metrics.report(None, 1)
        self._monitor().on_own_touch()
        write = asyncio.create_task(self._keep(self._job()))
        self._writes.add(write)
        write.add_done_callback(self._writes.discard)

    async def settle(self) -> None:
        """Wait until all touches counted so far are written."""
        if self._writes:
            await asyncio.wait(self._writes)

    async def _keep(self, job: str | None) -> None:
        try:
            await self._journal.add_report(job, None, 1)
        except Fault as exc:
            log.error("touch_not_kept", error=exc.message)
