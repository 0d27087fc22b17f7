"""Journal watch: latches a journal that cannot be written, and lets work go on when it can be again.

A full disk ends by itself what it began: when there is room, results that were held back are written and told first,
then the fault is cleared. A journal that was deleted, replaced or damaged waits for `reset`.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

import structlog

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import BUSY
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.observer import JobObserver
from daemon.storage.journal import Journal

EVERY_S = 0.5
ALERT, MOVED = "journal_not_written", "journal_moved_aside"
CatchUp = Callable[[], Awaitable[None]]
log = structlog.get_logger(__name__)


class JournalWatch:
    """Looks after the journal of one daemon; the owner of `journal_failed`."""

    def __init__(self, journal: Journal, latch: FaultLatch, observer: JobObserver, *catch_up: CatchUp) -> None:
        """Take what is to be done, in this order, as soon as the journal can be written; each raises `Fault`."""
        self._journal, self._latch, self._observer = journal, latch, observer
        self._catch_up = catch_up
        self._behind = True
        """Whether something may have to be written yet that could not be."""
        self._told: str | None = None
        self._moved_to = journal.moved_to

    async def run(self) -> None:
        """Look now and then, and at once when a write failed, until cancelled."""
        while True:
            await self.look()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(EVERY_S):
                    await self._journal.troubled.wait()
            self._journal.troubled.clear()

    async def look(self) -> None:
        """Look once: latch what is wrong, or clear what no longer is."""
        trouble = await self._journal.check()
        if trouble is None:
            trouble = await self._caught_up()
        self._tell(trouble)
        if trouble is None:
            self._latch.clear([cause for cause in self._latch.causes if cause.kind is FaultCode.JOURNAL_FAILED])
            return
        self._behind = True
        # A running job is not torn from its state: its result cannot be written, and that latches the same.
        if self._latch.running is None and self._latch.state not in BUSY and not self._is_latched():
            self._latch.put_first(trouble)

    def _is_latched(self) -> bool:
        return any(cause.kind is FaultCode.JOURNAL_FAILED for cause in self._latch.causes)

    async def _caught_up(self) -> Fault | None:
        """Write what is behind; return what keeps that from being written."""
        if not self._behind and not self._is_latched():
            return None
        for write in self._catch_up:
            try:
                await write()
            except Fault as exc:
                return exc
        self._behind = False
        return None

    def _tell(self, trouble: Fault | None) -> None:
        """Raise or clear the alerts, once for each change."""
        message = trouble.message if trouble is not None else None
        if (message is None) != (self._told is None):
            self._observer.on_flag(ALERT, message)
            log.error("journal_not_written", why=message) if message else log.info("journal_written_again")
            self._told = message
        moved = self._journal.moved_to
        if moved != self._moved_to:
            self._moved_to = moved
            self._observer.on_flag(MOVED, f"{self._journal.moved_because}; it lies at {moved}")
