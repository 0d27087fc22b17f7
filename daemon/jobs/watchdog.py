"""Watchdog of the job loop and of its job: only while both live is the manager fed.

The job loop itself asks, each time it turns: while it waits for a job, and while it waits for the one under way to end.
So a blocked event loop, a job loop that is stuck or gone, and a job that hangs all end the same way: nobody feeds, and
the service manager restarts the daemon, which moves nothing.

A long job is no hang. A job hangs when it is past its own deadline by more than it takes to stop everything, or when
for `SILENT_S` it has done nothing that shows: no picture, no step, no request on a bus, no progress told.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Hashable

import structlog

SILENT_S = 120.0
"""Longest stretch in which a sound job shows nothing: drawing a calibration's page may take half of it."""
GRACE_S = 30.0
"""What a job may take beyond its deadline to stop all axes, switch the lights off and write its result."""
UNWATCHED_EVERY_S = 5.0
"""How often the loop turns where no watchdog wants to be fed."""
log = structlog.get_logger(__name__)


class Watchdog:
    """What the job loop asks before it feeds the watchdog."""

    def __init__(
        self,
        feed: Callable[[], None] = lambda: None,
        every_s: float | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take what feeds the watchdog, how often it is to be fed, and the clock of the jobs' deadlines."""
        self.every_s = every_s if every_s is not None else UNWATCHED_EVERY_S
        self._feed, self._clock = feed, clock
        self._activity: Hashable = None
        self._shown_at_s = 0.0
        self._due_s: float | None = None
        self._complained = False

    def begin(self, due_s: float) -> None:
        """Watch a job from here on; it must be over at `due_s`, on the clock."""
        self._activity, self._shown_at_s, self._due_s, self._complained = None, self._clock(), due_s, False

    def check_in(self, activity: Hashable = None) -> bool:
        """Feed if all is well, for the loop has turned; return whether it is.

        `activity` is anything that changes when the job does something.
        """
        wrong = self._wrong_with_job(activity) if self._due_s is not None else None
        if wrong is None:
            self._feed()
            return True
        if not self._complained:
            self._complained = True
            log.error("job_hangs", why=wrong, advice="the watchdog, if there is one, restarts the daemon")
        return False

    def patience(self, wait_s: float, turn: Callable[[], Hashable] = lambda: None) -> Callable[[], None]:
        """Return what feeds while the job loop waits for something, for `wait_s` at most.

        Where several are before it, `turn` changes with each of them, and each may take as long.
        """
        until_s, last = self._clock() + wait_s, turn()

        def still_waiting() -> None:
            nonlocal until_s, last
            if turn() != last:
                until_s, last = self._clock() + wait_s, turn()
            if self._clock() < until_s:
                self._feed()

        return still_waiting

    def end(self) -> None:
        """Watch the job no more: it is over."""
        self._due_s = None
        self._feed()

    def _wrong_with_job(self, activity: Hashable) -> str | None:
        now_s = self._clock()
        if activity != self._activity:
            self._activity, self._shown_at_s = activity, now_s
        if self._due_s is not None and now_s > self._due_s + GRACE_S:
            return f"it should have ended {now_s - self._due_s:.0f} s ago"
        if now_s - self._shown_at_s > SILENT_S:
            return f"nothing has come from it for {now_s - self._shown_at_s:.0f} s"
        return None

    async def supervise(self, task: asyncio.Task[None], activity: Callable[[], Hashable]) -> None:
        """Wait for the job's task, turning all the while; cancelling passes the cancellation on and waits too."""
        try:
            while not task.done():
                await asyncio.wait({task}, timeout=self.every_s)
                self.check_in(activity())
        except asyncio.CancelledError:
            task.cancel()
            await asyncio.wait({task})
            raise
        finally:
            self.end()
        task.result()
