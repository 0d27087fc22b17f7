"""Uplink: a station's records, read from its daemon and sent to a broker until the centre says that they are stored.

It keeps nothing of its own: it may be killed at any time, and goes on where the centre says. What comes down is
how far the records are stored, which can at most make it send them again.
"""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import aiomqtt
import structlog

from daemon.client import NoAnswer, Refused
from daemon.fleet.batch import Nonsense, Stored
from daemon.fleet.broker import Broker, Patience, connected
from daemon.fleet.record_source import Pages, RecordSource
from daemon.fleet.send_window import STALL_S, SendWindow
from daemon.fleet.topics import StationPath

POLL_S = 0.5
"""How soon a new record is seen."""
STATE_S = 5.0
RETAINED_S = 1.0
"""So long the broker may take to say what is stored; then it is asked by sending the oldest."""
ANOTHER_S = 30.0
AWAY_S = 2.0
LEAVING_S = 1.0
OFFLINE = json.dumps({"online": False}).encode()
SHORT_S, SHORT_ONES = 5.0, 3
"""So many connections in a row that lasted no longer: another uplink comes by the same name, and each puts the other
out (MQTT 5, 3.1.4: the server closes the older connection of a client's name)."""
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Place:
    """Where in the plant the station is; its own name the daemon tells."""

    site: str
    line: str


class StationDaemon(Pages, Protocol):
    """Who is asked at the station; raises `NoAnswer` or `Refused`."""

    async def name(self) -> str:
        """Return the station's name."""

    async def state(self) -> dict[str, Any]:
        """Return how the station is, in few words."""


class Uplink:
    """Send one station's records."""

    def __init__(self, daemon: StationDaemon, broker: Broker, place: Place) -> None:
        self._daemon, self._broker, self._place = daemon, broker, place
        self._source = RecordSource(daemon)
        self._window = SendWindow()
        self._heard = asyncio.Event()
        self._unanswered = False
        """Whether it was said that the centre does not answer."""
        self._nonsense = ""
        """What was wrong with what the centre said last; it is told once."""
        self._begun_s: float | None = None
        """When the connection to the broker was made."""
        self._short = 0
        """Connections in a row that lasted only moments."""

    async def run(self) -> None:
        """Send until cancelled; raise `BadName` for a station whose name no topic can bear, or `BadConnection`."""
        path = StationPath(self._place.site, self._place.line, await self._name())
        patience = Patience()
        while True:
            wait_s = 0.0
            try:
                await self._session(path, patience)
            except* aiomqtt.MqttError as group:
                wait_s = self._wait_after(path, patience, _words(group))
            await asyncio.sleep(wait_s)

    def _wait_after(self, path: StationPath, patience: Patience, why: str) -> float:
        """Say why the connection ended, and return how long to wait before the next one."""
        lived_s = None if self._begun_s is None else _now_s() - self._begun_s
        self._begun_s = None
        if lived_s is not None:
            self._short = self._short + 1 if lived_s < SHORT_S else 0
        if self._short >= SHORT_ONES:
            self._short = 0
            log.error("another_uplink", station=path.station, error=why, advice="give each station a name of its own")
            return ANOTHER_S
        wait_s = patience.take()
        log.warning("broker_away", error=why, again_in_s=wait_s)
        return wait_s

    async def _name(self) -> str:
        while True:
            try:
                return await self._daemon.name()
            except (NoAnswer, Refused) as exc:
                log.warning("daemon_away", error=str(exc))
                await asyncio.sleep(AWAY_S)

    async def _session(self, path: StationPath, patience: Patience) -> None:
        """Work while the broker is there."""
        will = aiomqtt.Will(path.topic("state"), OFFLINE, qos=1, retain=True)
        name = f"reprobe-uplink-{path.site}-{path.line}-{path.station}"
        async with connected(self._broker.client(name, will)) as client:
            self._window = SendWindow()
            self._heard.clear()
            await client.subscribe(path.topic("stored"), qos=1)
            log.info("broker_reached", broker=self._broker.host, topic=path.topic("records"))
            patience.worked()
            self._begun_s = _now_s()
            try:
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._listen(client))
                    tasks.create_task(self._tell_state(client, path))
                    tasks.create_task(self._send(client, path))
            finally:  # who leaves in order has no last will
                with suppress(aiomqtt.MqttError, TimeoutError):
                    async with asyncio.timeout(LEAVING_S):
                        await client.publish(path.topic("state"), OFFLINE, qos=1, retain=True)

    async def _listen(self, client: aiomqtt.Client) -> None:
        async for message in client.messages:
            try:
                said = Stored.of(_bytes(message.payload))
            except Nonsense as exc:
                if str(exc) != self._nonsense:
                    log.error("centre_says_nonsense", error=str(exc), topic=str(message.topic))
                self._nonsense = str(exc)
                continue
            self._nonsense = ""
            self._window.heard(said, _now_s())
            self._unanswered = False
            self._heard.set()

    async def _tell_state(self, client: aiomqtt.Client, path: StationPath) -> None:
        told: dict[str, Any] | None = None
        while True:
            state = await self._daemon.state()
            if state != told:
                await client.publish(path.topic("state"), json.dumps(state).encode(), qos=1, retain=True)
                told = state
            await asyncio.sleep(STATE_S)

    async def _send(self, client: aiomqtt.Client, path: StationPath) -> None:
        await self._wait(RETAINED_S)
        while True:
            if self._window.is_stalled(_now_s()):
                self._tell_silence()
                self._window.retry()
            batch = await self._source.following(self._window) if self._window.has_room else None
            if batch is None or not self._window.may_send(batch):
                await self._wait(POLL_S if self._window.is_empty else STALL_S / 4)
                continue
            self._window.sent(batch, _now_s())
            await client.publish(path.topic("records"), batch.to_json(), qos=1)

    def _tell_silence(self) -> None:
        """Say once that nobody answers, though the broker is there."""
        if not self._unanswered:
            advice = (
                "is `reprobe collect` at work, may this name write to its topic, and has no other station this name?"
            )
            log.warning("centre_silent", advice=advice)
        self._unanswered = True

    async def _wait(self, within_s: float) -> None:
        """Wait for the centre's word, but not longer."""
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                await self._heard.wait()
        self._heard.clear()


def _now_s() -> float:
    return asyncio.get_running_loop().time()


def _bytes(payload: object) -> bytes:
    return payload if isinstance(payload, bytes) else str(payload).encode()


def _words(group: BaseExceptionGroup[Any]) -> str:
    """Return what the errors say, each once."""
    found: set[str] = set()
    for exc in group.exceptions:
        found.add(_words(exc) if isinstance(exc, BaseExceptionGroup) else str(exc))
    return "; ".join(sorted(found))[:200]
