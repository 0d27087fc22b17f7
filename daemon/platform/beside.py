"""Two things done side by side, of which one is short."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


async def beside(short: Coroutine[Any, Any, None], long: Coroutine[Any, Any, T]) -> T:
    """Do both at once and return what the long one brings; its error comes first, for it has more to say."""
    other = asyncio.create_task(short)
    try:
        result = await long
        await other
        return result
    finally:
        if not other.done():
            other.cancel()
        await asyncio.wait([other])
        if not other.cancelled():
            other.exception()  # of two errors the first is told
