"""Finish something that must not be left half done, whatever happens to the caller."""

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


async def finish(work: Coroutine[Any, Any, T]) -> T:
    """Run `work` to its end even when the caller is cancelled, then pass the cancellation on.

    Use it only for work that bounds its own time (a stop with its own deadline). Further cancellations
    while it runs are remembered and raised as one at the end; an error of `work` wins over them.
    """
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError as exc:
            if task.cancelled():
                raise
            cancelled = exc
        except BaseException:  # noqa: BLE001 - only looks that it is done; result() below raises it
            break
    result = task.result()
    if cancelled is not None:
        raise cancelled
    return result
