"""Fair queue: clients are served in turn, so that one who sends much does not hold up one who sends little."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class FairQueue(Generic[T]):
    """First come, first served within one client; round robin between clients. For one event loop, one reader."""

    def __init__(self) -> None:
        self._waiting: dict[str, deque[T]] = {}
        self._count = 0
        self._something = asyncio.Event()

    def put(self, client: str, item: T) -> None:
        """Add an item behind the client's others."""
        self._waiting.setdefault(client, deque()).append(item)
        self._count += 1
        self._something.set()

    async def get(self) -> T:
        """Wait for an item and take it; its client goes to the end of the round."""
        while not self._waiting:
            self._something.clear()
            await self._something.wait()
        client, items = next(iter(self._waiting.items()))
        item = items.popleft()
        self._count -= 1
        del self._waiting[client]
        if items:
            self._waiting[client] = items
        return item

    def __len__(self) -> int:
        """How many wait; counted, for a scrape asks from another thread."""
        return self._count
