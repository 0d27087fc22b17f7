"""The connection limit: a socket keeps no more peers than it may, and parts from silent ones."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
import zmq

from daemon.platform import descriptors
from daemon.server import connection_limit
from daemon.server.connection_limit import ConnectionLimit
from daemon.server.served_address import bind

MOST = 12


class Door:
    """A ROUTER that nobody reads, and raw connections to it that say nothing."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._stack = stack
        self.path = folder / "control"
        context = zmq.Context()
        self.socket = context.socket(zmq.ROUTER)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.limit: ConnectionLimit = bind(self.socket, f"ipc://{self.path}")
        stack.callback(context.term)
        stack.callback(self.socket.close)
        stack.callback(self.limit.close)

    def knock(self) -> socket.socket:
        """Connect, and say nothing."""
        silent = self._stack.enter_context(socket.socket(socket.AF_UNIX))
        silent.settimeout(30.0)
        silent.connect(str(self.path))
        return silent


@pytest.fixture
async def door(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Door]:
    monkeypatch.setattr(descriptors, "limit", lambda: MOST * connection_limit.SHARE)
    with ExitStack() as stack:
        yield Door(tmp_path, stack)


async def _until(holds: Callable[[], bool]) -> None:
    async with asyncio.timeout(30.0):
        while not holds():  # noqa: ASYNC110  # what is waited for has no event of its own
            await asyncio.sleep(0.001)


def _ends(silent: socket.socket) -> bool:
    """Read until the other side ends the connection; False if it does not."""
    try:
        while silent.recv(100):
            pass
    except TimeoutError:
        return False
    except OSError:
        return True
    return True


async def test_one_peer_too_many_is_parted_from_and_another_stays_when_some_have_gone(door: Door) -> None:
    silent = [door.knock() for _ in range(MOST)]
    await _until(lambda: door.limit.peers == MOST)
    assert door.limit.refused == 0
    assert await asyncio.to_thread(_ends, door.knock())
    assert (door.limit.peers, door.limit.refused) == (MOST, 1)
    for one in silent[: MOST // 2]:
        one.close()
    await _until(lambda: door.limit.peers == MOST // 2)
    door.knock()
    await _until(lambda: door.limit.peers == MOST // 2 + 1)
    assert door.limit.refused == 1


async def test_many_at_once_never_take_more_descriptors_than_the_limit_for_long(door: Door) -> None:
    last = [door.knock() for _ in range(5 * MOST)][-1]
    assert await asyncio.to_thread(_ends, last)
    assert door.limit.peers <= MOST


async def test_peers_that_are_there_already_are_served_while_others_are_parted_from(door: Door) -> None:
    with zmq.Context() as context, context.socket(zmq.REQ) as early:
        early.setsockopt(zmq.LINGER, 0)
        early.connect(f"ipc://{door.path}")
        early.send(b"hello")
        assert await asyncio.to_thread(door.socket.poll, 30_000)
        for _ in range(3 * MOST):
            door.knock()
        await _until(lambda: door.limit.refused > MOST)
        door.socket.send_multipart(door.socket.recv_multipart())
        assert await asyncio.to_thread(early.poll, 30_000)
        assert early.recv() == b"hello"


async def test_a_peer_that_says_nothing_is_parted_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection_limit, "HANDSHAKE_MS", 50)
    with ExitStack() as stack:
        door = Door(tmp_path, stack)
        silent = door.knock()

        def heard() -> bytes:
            """Read the greeting, and what comes after it: nothing, for the connection ends."""
            text = b""
            while more := silent.recv(100):
                text += more
            return text

        assert b"\x7f" in await asyncio.to_thread(heard)
        await _until(lambda: door.limit.peers == 0)


def test_the_limit_of_descriptors_is_raised_as_far_as_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [1024, 4096]
    monkeypatch.setattr("resource.getrlimit", lambda _which: tuple(now))
    monkeypatch.setattr("resource.setrlimit", lambda _which, limits: now.__setitem__(slice(None), limits))
    assert descriptors.raise_limit(8192) == 4096
    assert descriptors.raise_limit(2048) == 4096, "it is never lowered"
