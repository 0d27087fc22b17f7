"""Hub: keeps the one mirror of the station, and wakes everybody who shows it."""

from __future__ import annotations

import asyncio
import json
from typing import Any, Protocol

import structlog
import zmq
import zmq.asyncio

from daemon.client import NoAnswer, Refused, find_key, reachable, unlock
from daemon.domain.roles import Role
from daemon.page.live_feed import LiveFeed
from daemon.page.mirror import RESULTS_SHOWN, Station, after, asks_again, lost, seen_whole
from daemon.wire.curve_keys import PrivateKey

SILENT_S = 3.0
"""Without any event for so long the station is lost; the daemon's heart beats every second."""
AGAIN_S = 0.3
"""Pause before the daemon is asked again."""
SNAPSHOT_S = 2.0
OTHER_VERSION = "other_version"
"""Why a station is lost whose words are not understood."""
log = structlog.get_logger(__name__)


class Asks(Protocol):
    """What asks the daemon."""

    async def request(self, role: Role, op: str, **fields: Any) -> dict[str, Any]:
        """Return the reply; raise `Refused` or `NoAnswer`."""


class Hub:
    """Follow a station. `station` is what is known now; `changed` waits for the next change."""

    def __init__(self, context: zmq.asyncio.Context, ask: Asks, control: str, key: PrivateKey | None) -> None:
        self._context, self._ask, self._control, self._key = context, ask, control, key
        self.station = Station()
        self.board: dict[str, Any] = {}
        """The board under test, as `describe` has it."""
        self.errors: list[dict[str, Any]] = []
        self.feed = LiveFeed(context, control, key)
        self._woken = asyncio.Event()
        self._events: zmq.asyncio.Socket | None = None

    async def run(self) -> None:
        """Follow the station until cancelled; every trouble is said, and tried again."""
        try:
            while True:
                try:
                    await self._follow()
                except (NoAnswer, Refused) as exc:
                    self._set(lost(self.station, exc.error["name"] if isinstance(exc, Refused) else "no_answer"))
                    await asyncio.sleep(AGAIN_S)
                except (KeyError, TypeError, ValueError, AttributeError) as exc:
                    # Of another version, or no daemon of this project at all.
                    if self.station.lost_why != OTHER_VERSION:
                        log.warning("not_understood", error=repr(exc), advice="update what is older: page or daemon")
                    self._set(lost(self.station, OTHER_VERSION))
                    await asyncio.sleep(AGAIN_S)
        finally:
            self.feed.close()
            if self._events is not None:
                self._events.close(linger=0)

    async def changed(self, within_s: float) -> None:
        """Wait for a change, but not longer than that."""
        try:
            async with asyncio.timeout(within_s):
                await self._woken.wait()
        except TimeoutError:
            pass

    async def _follow(self) -> None:
        """Take a snapshot, then events one by one until one is missing or none comes."""
        if self._events is None:
            await self._subscribe()
        await self._look_whole()
        while True:
            event = await self._next()
            if event is None:
                self._set(lost(self.station, "silent"))
                raise NoAnswer
            self._set(after(self.station, event))
            if self.station.stale or asks_again(event):
                await self._look_whole()

    async def _subscribe(self) -> None:
        facts = await self._ask.request("observe", "describe", within_s=SNAPSHOT_S)
        socket = self._context.socket(zmq.SUB)
        socket.setsockopt(zmq.RECONNECT_IVL_MAX, 500)
        socket.subscribe("")
        unlock(socket, find_key(self._key))
        socket.connect(reachable(facts["events"], self._control))
        self._events = socket

    async def _look_whole(self) -> None:
        """Ask for all there is. What is published meanwhile waits in the socket and is taken after it."""
        snapshot = await self._ask.request("observe", "snapshot", within_s=SNAPSHOT_S)
        history = await self._ask.request("observe", "history", limit=RESULTS_SHOWN, within_s=SNAPSHOT_S)
        alerts = await self._ask.request("observe", "alerts", limit=1, within_s=SNAPSHOT_S)
        if not self.station.live or snapshot.get("board_revision", "") != self.station.board_revision:
            facts = await self._ask.request("observe", "describe", within_s=SNAPSHOT_S)
            self.board, self.errors, self.feed.endpoint = facts["board"] or {}, facts["errors"], facts.get("live", "")
        self._set(seen_whole(self.station, snapshot, alerts, history))

    async def _next(self) -> dict[str, Any] | None:
        if self._events is None or not await self._events.poll(int(SILENT_S * 1e3)):
            return None
        frames = await self._events.recv_multipart()
        event: dict[str, Any] = json.loads(frames[-1])
        return event

    def _set(self, station: Station) -> None:
        if station.live != self.station.live:
            log.info("station_heard" if station.live else "station_lost", why=station.lost_why)
        if station != self.station:
            self.station = station
            self._woken.set()
            self._woken = asyncio.Event()
