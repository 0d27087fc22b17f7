"""Shielded work: what was begun is done to its end, even if who waits for it is cancelled."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


async def to_the_end(work: Coroutine[Any, Any, T]) -> T:
    """Do `work` as a task of its own; a cancellation is raised only when it has ended."""
    task = asyncio.create_task(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError as exc:
            if task.done():
                break
            cancelled = exc
        except Exception:  # noqa: BLE001  # it is the task's own: raised below
            break
    if cancelled is not None:
        if not task.cancelled():
            task.exception()  # looked at: the cancellation is what counts
        raise cancelled
    return task.result()
