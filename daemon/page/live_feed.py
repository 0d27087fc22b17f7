"""Live feed: the newest picture of the station, taken from the daemon only while a browser asks for it.

A browser asks for the next picture after it has drawn the last: a slow one gets fewer, not older.
"""

from __future__ import annotations

import asyncio
import json
import time
from typing import Any, NamedTuple

import zmq
import zmq.asyncio

from daemon.client import find_key, reachable, unlock
from daemon.wire.curve_keys import PrivateKey
from daemon.wire.live import TOPIC

LOOKED_AT_S = 3.0
"""So long after the last browser asked the subscription ends."""


class Picture(NamedTuple):
    """One live picture and what stands beside it."""

    header: dict[str, Any]
    jpeg: bytes


class LiveFeed:
    """Pictures for all tabs, by one subscription."""

    def __init__(self, context: zmq.asyncio.Context, control: str, key: PrivateKey | None) -> None:
        self._context, self._control, self._key = context, control, key
        self.endpoint = ""
        """Of the daemon's live socket, as `describe` tells it; empty: it has none."""
        self._newest: Picture | None = None
        self._came = asyncio.Event()
        self._asked_s = 0.0
        self._taking: asyncio.Task[None] | None = None

    async def after(self, n: int, within_s: float) -> Picture | None:
        """Return a picture newer than number `n`, waiting for it; None if none comes, or there are none at all."""
        if not self.endpoint:
            return None
        self._asked_s = time.monotonic()
        if self._taking is None or self._taking.done():
            self._newest = None
            self._taking = asyncio.create_task(self._take(), name="live")
        try:
            async with asyncio.timeout(within_s):
                while self._newest is None or self._newest.header["n"] == n:
                    await self._came.wait()
        except TimeoutError:
            return None
        return self._newest

    async def _take(self) -> None:
        """Listen until nobody looks any more."""
        socket = self._context.socket(zmq.SUB)
        try:
            socket.setsockopt(zmq.RCVHWM, 2)
            socket.subscribe(TOPIC)
            unlock(socket, find_key(self._key))
            socket.connect(reachable(self.endpoint, self._control))
            while time.monotonic() - self._asked_s < LOOKED_AT_S:
                if await socket.poll(500):
                    _, header, jpeg = await socket.recv_multipart()
                    self._newest = Picture(json.loads(header), jpeg)
                    self._came.set()
                    self._came = asyncio.Event()
        finally:
            socket.close(linger=0)

    def close(self) -> None:
        """Stop listening."""
        if self._taking is not None:
            self._taking.cancel()
