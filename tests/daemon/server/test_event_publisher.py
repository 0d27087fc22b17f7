"""Events come in the order of their numbers, whatever has to be written first."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import zmq
from structlog.testing import capture_logs

from daemon.domain.errors import Fault, FaultCode
from daemon.server.event_publisher import EventPublisher
from daemon.storage.journal import Journal
from tests.daemon.server.revoking_guard import RevokingGuard

WITHIN_MS = 20_000


class _Heard:
    """A publisher and who listens to it."""

    def __init__(self, journal: Journal, publisher: EventPublisher, socket: zmq.Socket[bytes]) -> None:
        self.journal, self.publisher, self._socket = journal, publisher, socket

    def events(self, count: int) -> list[tuple[str, int]]:
        found = []
        for _ in range(count):
            assert self._socket.poll(WITHIN_MS), f"only {found} came"
            topic, body = self._socket.recv_multipart()
            found.append((topic.decode(), json.loads(body)["seq"]))
        return found


@pytest.fixture
async def heard(tmp_path: Path) -> AsyncIterator[_Heard]:
    journal = await Journal.open(tmp_path / "j.sqlite")
    with zmq.Context() as context:
        publisher = EventPublisher(context, f"ipc://{tmp_path}/events", "s", journal)
        socket: zmq.Socket[bytes] = context.socket(zmq.SUB)
        socket.subscribe(b"")
        socket.connect(f"ipc://{tmp_path}/events")
        while not socket.poll(10):
            publisher.publish("log", {"event": "hello"})
        while socket.poll(100):
            socket.recv_multipart()
        yield _Heard(journal, publisher, socket)
        socket.close(linger=0)
        publisher.close()
    await journal.close()


class _Writing:
    """Something that is being written until it is let go."""

    def __init__(self, error: Exception | None = None) -> None:
        self.began, self.may_end = asyncio.Event(), asyncio.Event()
        self.number = 0
        self._error = error

    async def __call__(self, number: int) -> dict[str, Any]:
        self.number = number
        self.began.set()
        await self.may_end.wait()
        if self._error is not None:
            raise self._error
        return {"event": "written"}


async def test_what_is_published_while_a_result_is_written_comes_after_it(heard: _Heard) -> None:
    first, writing = heard.journal.upcoming_seq, _Writing()
    task = asyncio.create_task(heard.publisher.publish_written("log", writing))
    await writing.began.wait()
    heard.publisher.publish("heartbeat", {"state": "idle", "version": "1"})
    assert heard.journal.upcoming_seq == first, "a late joiner's snapshot covers the result"
    writing.may_end.set()
    assert await task == first == writing.number
    assert heard.events(2) == [("log", first), ("heartbeat", first + 1)]


async def test_a_result_that_cannot_be_written_leaves_no_gap(heard: _Heard) -> None:
    first, writing = heard.journal.upcoming_seq, _Writing(Fault(FaultCode.JOURNAL_FAILED))
    task = asyncio.create_task(heard.publisher.publish_written("log", writing))
    await writing.began.wait()
    heard.publisher.publish("heartbeat", {"state": "idle", "version": "1"})
    writing.may_end.set()
    with pytest.raises(Fault):
        await task
    assert heard.events(1) == [("heartbeat", first)]


async def test_two_that_are_written_at_once_come_one_after_the_other(heard: _Heard) -> None:
    first, one, two = heard.journal.upcoming_seq, _Writing(), _Writing()
    tasks = [asyncio.create_task(heard.publisher.publish_written("log", writing)) for writing in (one, two)]
    await one.began.wait()
    two.may_end.set()
    one.may_end.set()
    assert await asyncio.gather(*tasks) == [first, first + 1]
    assert heard.events(2) == [("log", first), ("log", first + 1)]


async def test_a_cancelled_writer_still_publishes_what_was_written(heard: _Heard) -> None:
    first, writing = heard.journal.upcoming_seq, _Writing()
    task = asyncio.create_task(heard.publisher.publish_written("log", writing))
    await writing.began.wait()
    task.cancel()
    writing.may_end.set()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert heard.events(1) == [("log", first)]
    assert heard.publisher.publish("heartbeat", {"state": "idle", "version": "1"}) == first + 1


async def test_an_address_in_use_is_told_once_and_events_come_as_soon_as_it_is_free(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    with zmq.Context() as context, socket.socket() as taken, capture_logs() as said:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        publisher = EventPublisher(context, endpoint, "s", journal)
        assert endpoint in str(publisher.trouble)
        first = publisher.publish("log", {"event": "nobody hears it"})
        publisher.open()
        taken.close()
        trying = asyncio.create_task(publisher.run(serve_again_s=0.01))
        async with asyncio.timeout(WITHIN_MS / 1e3):
            while publisher.trouble is not None:  # noqa: ASYNC110  # what is waited for has no event of its own
                await asyncio.sleep(0.01)
        listener: zmq.Socket[bytes] = context.socket(zmq.SUB)
        listener.subscribe(b"")
        listener.connect(endpoint)
        while not listener.poll(10):
            last = publisher.publish("log", {"event": "hello"})
        assert first is not None
        assert last is not None
        assert first < json.loads(listener.recv_multipart()[1])["seq"] <= last
        trying.cancel()
        listener.close(linger=0)
        publisher.close()
    await journal.close()
    told = [entry["event"] for entry in said if entry["event"].startswith("events_")]
    assert told == ["events_not_served", "events_served"], "each once"


async def test_an_address_that_somebody_took_while_subscribers_were_sent_away_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should not be left unserved for ever: whoever lost its key was parted from, and all others with it."""
    journal = await Journal.open(tmp_path / "j.sqlite")
    monkeypatch.setattr("daemon.server.served_address.GIVE_UP_S", 0.0)
    guard = RevokingGuard("maintain")
    with zmq.Context() as context:
        publisher = EventPublisher(context, f"ipc://{tmp_path}/events", "s", journal, guard=guard)
        refused = asyncio.Event()

        def refuse(socket: zmq.Socket[Any], _endpoint: str) -> Any:
            socket.close(linger=0)
            refused.set()
            raise zmq.ZMQError(zmq.EADDRINUSE)

        with monkeypatch.context() as taken:
            taken.setattr("daemon.server.served_address.bind", refuse)
            guard.removed += 1
            publisher.publish("log", {"event": "a key was taken back"})
            await refused.wait()
            while publisher.trouble is None:  # noqa: ASYNC110  # what is waited for has no event of its own
                await asyncio.sleep(0.01)
        publisher.open()
        assert publisher.trouble is None
        publisher.close()
    await journal.close()
