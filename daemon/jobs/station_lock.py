"""The lock of the station: one job, reset, reload or health check at a time, and which of them holds it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Literal

Holder = Literal["job", "archive", "reset", "reload", "health check", "stop", "lamp"]
WORKS: frozenset[Holder] = frozenset({"job", "reset", "reload", "stop"})
"""Who changes what a person has switched on."""


class StationLock:
    """Who holds it may work with the devices, or change what jobs work with. Waiters come in turn."""

    def __init__(self) -> None:
        self._lock = asyncio.Lock()
        self._holder: Holder | None = None
        self._turns = self._works = 0
        self.freed = asyncio.Event()
        """Set whenever it was given back; the supervisor waits for it and clears it."""
        self.leave: Callable[[], Awaitable[None]] | None = None
        """Undoes what a person has switched on; called for who works with the station, before anything else.

        None while nothing is switched on.
        """

    @property
    def holder(self) -> Holder | None:
        """Who holds it."""
        return self._holder

    @property
    def turns(self) -> int:
        """How often it was taken so far; who waits sees by it that those before it come to their end."""
        return self._turns

    @property
    def works(self) -> int:
        """How often it was taken so far to light a lamp or to move something: by all but health checks."""
        return self._works

    def goes_on_as(self, holder: Holder) -> None:
        """Say that who holds it does something else from here on: a job that was answered only keeps its images."""
        self._holder = holder

    @asynccontextmanager
    async def hold(
        self, holder: Holder, *, every_s: float | None = None, still_waiting: Callable[[], None] = lambda: None
    ) -> AsyncIterator[None]:
        """Wait for the lock and hold it inside.

        `still_waiting` is called each `every_s` that it takes; what it raises ends the waiting.
        """
        await self._take(every_s, still_waiting)
        self._holder = holder
        self._turns += 1
        self._works += holder != "health check"
        try:
            if self.leave is not None and holder in WORKS:
                await self.leave()
            yield
        finally:
            self._holder = None
            self._lock.release()
            self.freed.set()

    async def _take(self, every_s: float | None, still_waiting: Callable[[], None]) -> None:
        """Take the lock; the place in the line is kept while `still_waiting` is called."""
        taking = asyncio.ensure_future(self._lock.acquire())
        try:
            while not taking.done():
                await asyncio.wait({taking}, timeout=every_s)
                if not taking.done():
                    still_waiting()
        except BaseException:
            if taking.done():
                self._lock.release()
            taking.cancel()
            raise
