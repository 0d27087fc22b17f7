"""Who is told to end ends, also where the broker does not answer its goodbye."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import suppress
from typing import Any, Self, cast

import aiomqtt
import pytest

from daemon.fleet import collector
from daemon.fleet.__main__ import until
from daemon.fleet.broker import Broker
from daemon.fleet.collector import Collector, Keeping
from daemon.fleet.counts import Counts
from daemon.fleet.send_window import Position
from daemon.fleet.uplink import Place, Uplink


class _DeafClient:
    """A broker's client that nobody answers once it is left."""

    messages = ()

    def __init__(self, reached: asyncio.Event) -> None:
        self._reached = reached

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        raise aiomqtt.MqttError("Operation timed out")

    async def subscribe(self, *_: object, **__: object) -> None:
        self._reached.set()
        await asyncio.Event().wait()


class _LostClient(_DeafClient):
    """A broker's client whose connection breaks as soon as it is listened to."""

    async def subscribe(self, *_: object, **__: object) -> None:
        self._reached.set()

    async def publish(self, *_: object, **__: object) -> None:
        raise aiomqtt.MqttError("Disconnected")

    @property
    async def messages(self) -> AsyncIterator[Any]:  # type: ignore[override]
        raise aiomqtt.MqttError("Disconnected")
        yield


class _DeafBroker:
    host = "127.0.0.1"

    def __init__(self, kind: type[_DeafClient] = _DeafClient) -> None:
        self.reached, self._kind = asyncio.Event(), kind

    def client(self, *_: object) -> _DeafClient:
        return self._kind(self.reached)


class _Daemon:
    async def name(self) -> str:
        return "station-1"

    async def state(self) -> dict[str, Any]:
        return {}

    async def page(self, position: Position) -> dict[str, Any]:
        raise AssertionError(position)


class _Connection:
    async def close(self, timeout: float) -> None:  # noqa: ASYNC109  # asyncpg's
        assert timeout


class _Database:
    def __init__(self, _connection: object) -> None: ...

    async def lock(self) -> None: ...

    async def migrate(self) -> list[int]:
        return []


async def _connect(*_: object, **__: object) -> _Connection:
    return _Connection()


def _uplink(broker: Broker) -> Coroutine[Any, Any, None]:
    return Uplink(_Daemon(), broker, Place("north", "L1")).run()


def _collector(broker: Broker) -> Coroutine[Any, Any, None]:
    return Collector(broker, "postgresql://nowhere", Keeping(), Counts()).run()


@pytest.mark.parametrize("part", [_uplink, _collector])
async def test_who_is_told_to_end_ends_though_the_broker_hears_no_goodbye(
    part: Callable[[Broker], Coroutine[Any, Any, None]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("asyncpg.connect", _connect)
    monkeypatch.setattr(collector, "Database", _Database)
    broker = _DeafBroker()
    running = asyncio.ensure_future(part(cast("Broker", broker)))
    await broker.reached.wait()
    broker.reached.clear()
    running.cancel()
    again = asyncio.ensure_future(broker.reached.wait())
    await asyncio.wait({running, again}, return_when=asyncio.FIRST_COMPLETED)
    again.cancel()
    assert running.cancelled()


async def test_an_uplink_whose_broker_is_killed_connects_again_and_ends_when_it_is_told_to() -> None:
    broker, told = _DeafBroker(_LostClient), asyncio.Event()
    running = asyncio.ensure_future(_uplink(cast("Broker", broker)))
    for _ in range(2):
        again = asyncio.ensure_future(broker.reached.wait())
        await asyncio.wait({running, again}, return_when=asyncio.FIRST_COMPLETED)
        assert not running.done()
        broker.reached.clear()
    told.set()
    await until(told, running)
    assert running.cancelled()


async def test_work_that_swallows_being_cancelled_once_ends_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.fleet.__main__.AGAIN_S", 0.01)
    begun, told = asyncio.Event(), asyncio.Event()

    async def work() -> None:
        with suppress(asyncio.CancelledError):
            begun.set()
            await asyncio.Event().wait()
        await asyncio.Event().wait()

    running = asyncio.ensure_future(work())
    await begun.wait()
    told.set()
    await until(told, running)
    assert running.cancelled()
