"""The lock of the station: one job, reset, reload or health check at a time, and which of them holds it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Literal

Holder = Literal["job", "archive", "reset", "reload", "health check"]


class StationLock:
    """Who holds it may work with the devices, or change what jobs work with. Waiters come in turn."""

    def __init__(self) -> None:
        self._lock = asyncio.Lock()
        self._holder: Holder | None = None

    @property
    def holder(self) -> Holder | None:
        """Who holds it."""
        return self._holder

    def goes_on_as(self, holder: Holder) -> None:
        """Say that who holds it does something else from here on: a job that was answered only keeps its images."""
        self._holder = holder

    @asynccontextmanager
    async def hold(
        self, holder: Holder, *, every_s: float | None = None, still_waiting: Callable[[], None] = lambda: None
    ) -> AsyncIterator[None]:
        """Wait for the lock and hold it inside; `still_waiting` is called each `every_s` that it takes."""
        while not await self._acquired(every_s):
            still_waiting()
        self._holder = holder
        try:
            yield
        finally:
            self._holder = None
            self._lock.release()

    async def _acquired(self, within_s: float | None) -> bool:
        try:
            async with asyncio.timeout(within_s):
                return await self._lock.acquire()
        except TimeoutError:
            return False
