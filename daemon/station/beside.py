"""Work that goes on beside other work, and ends with it: nothing is left behind, and no failure goes unheard."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from typing import Any, TypeVar

T = TypeVar("T")


@asynccontextmanager
async def beside(work: Coroutine[Any, Any, T]) -> AsyncIterator[asyncio.Task[T]]:
    """Begin some work and give its task, to be awaited inside; what is not over at the end of the block is cancelled.

    A thread that it waits for ends by itself; its result is nobody's then.
    """
    task = asyncio.create_task(work)
    task.add_done_callback(_heard)
    try:
        yield task
    finally:
        task.cancel()


def _heard(task: asyncio.Task[Any]) -> None:
    """Take note of how work ended of which nobody may want to know any more."""
    if not task.cancelled():
        task.exception()
