"""Incoming messages of the collector, until they are stored: the newest state of each station, and batches in turn.

Stations that catch up after an outage send far more than is stored at once. So states wait for no records, no station
waits for all of another's, and what is taken at once is small enough that everything else goes on. What has no room is
dropped: the station sends it again, for nobody told it that it is stored. No I/O.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict, deque
from contextlib import suppress
from typing import NamedTuple

from daemon.fleet.send_window import BATCHES_OUT

GROUP, GROUP_BYTES = 250, 1_000_000
"""Batches that are stored together at most; more bytes than these only where one batch alone has them.

Each station of a group waits for its commit: one of a thousand took 0.7 s, and four of 250 no longer together.
"""
WAITING_BYTES = 128_000_000


class Arrival(NamedTuple):
    """One message."""

    topic: str
    payload: bytes


class Incoming:
    """What has arrived and is not stored."""

    def __init__(self) -> None:
        self._states: dict[str, bytes] = {}
        self._batches: OrderedDict[str, deque[bytes]] = OrderedDict()
        self._bytes = 0
        self._arrived = asyncio.Event()

    @property
    def is_full_group(self) -> bool:
        """Whether there is enough for a group: waiting for more brings nothing."""
        return len(self._batches) >= GROUP or self._bytes >= GROUP_BYTES

    def put(self, topic: str, payload: bytes) -> None:
        """Keep a message; of states the newest alone, of batches as many as an uplink has on its way."""
        if topic.endswith("/state"):
            self._states[topic] = payload
        elif self._bytes + len(payload) <= WAITING_BYTES:
            waiting = self._batches.setdefault(topic, deque())
            if len(waiting) < BATCHES_OUT and payload not in waiting:
                waiting.append(payload)
                self._bytes += len(payload)
        self._arrived.set()

    async def wait(self, within_s: float) -> None:
        """Wait until there is something, but not longer."""
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                await self._arrived.wait()

    def take(self) -> tuple[list[Arrival], list[Arrival]]:
        """Take all states, and a group of batches: one of each station in turn, those of one in their order."""
        states = [Arrival(topic, payload) for topic, payload in self._states.items()]
        self._states.clear()
        batches: list[Arrival] = []
        size = 0
        while self._batches and len(batches) < GROUP:
            topic, waiting = next(iter(self._batches.items()))
            if batches and size + len(waiting[0]) > GROUP_BYTES:
                break
            batches.append(Arrival(topic, waiting.popleft()))
            size += len(batches[-1].payload)
            if waiting:
                self._batches.move_to_end(topic)
            else:
                del self._batches[topic]
        self._bytes -= size
        if not self._batches:
            self._arrived.clear()
        return states, batches
