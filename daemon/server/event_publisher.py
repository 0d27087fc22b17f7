"""Event publisher: everything that happens, numbered, on a PUB socket."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import structlog
import zmq

from daemon.platform.clock import utc_now
from daemon.server.auth import Authenticator
from daemon.server.connection_limit import ConnectionLimit
from daemon.storage.journal import Journal
from daemon.wire.events import Topic, event
from daemon.wire.limits import EVENT_QUEUE

Count = Callable[[str, Mapping[str, Any]], None]
BIND_AGAIN_S, GIVE_UP_S = 0.01, 5.0
log = structlog.get_logger(__name__)


def bind(socket: zmq.Socket[Any], endpoint: str) -> ConnectionLimit:
    """Bind, and return what bounds the socket's peers; close both before an error goes on.

    A context waits for open sockets without end.
    """
    limit = ConnectionLimit(socket)
    try:
        socket.bind(endpoint)
    except zmq.ZMQError:
        limit.close()
        socket.close(linger=0)
        raise
    return limit


class EventPublisher:
    """Publish; a PUB socket never blocks, so this may be called from anywhere in the event loop."""

    def __init__(
        self,
        context: zmq.Context[Any],
        endpoint: str,
        station: str,
        journal: Journal,
        count: Count | None = None,
        guard: Authenticator | None = None,
    ) -> None:
        self._context, self._endpoint = context, endpoint
        self._count = count
        self._station = station
        self._journal = journal
        self._guard = guard or Authenticator("maintain")
        self._removals = self._guard.removals
        self._moving: asyncio.Task[None] | None = None
        self._socket = self._open()
        self._limit = bind(self._socket, endpoint)

    def _open(self) -> zmq.Socket[bytes]:
        socket: zmq.Socket[bytes] = self._context.socket(zmq.PUB)
        socket.setsockopt(zmq.SNDHWM, EVENT_QUEUE)
        socket.setsockopt(zmq.LINGER, 200)
        self._guard.protect(socket)
        return socket

    def publish(self, topic: Topic, body: dict[str, Any], seq: int | None = None) -> int:
        """Send one event and return its number; a number taken earlier (for the journal) is used as it is."""
        if self._guard.removals != self._removals:
            self._removals = self._guard.removals
            self._send_all_away()
        number = self._journal.take_seq() if seq is None else seq
        told = event(topic, number, utc_now(), self._station, body)
        self._socket.send_multipart([topic.encode(), told.model_dump_json().encode()], zmq.NOBLOCK)
        if self._count is not None:
            self._count(topic, body)
        return number

    def close(self) -> None:
        """Close the socket; what is on its way is still sent for a moment."""
        if self._moving is not None:
            self._moving.cancel()
        self._limit.close()
        self._socket.close()

    def _send_all_away(self) -> None:
        """Part from every subscriber, for one of them may have had its key taken back; who may, comes again by itself.

        A PUB socket cannot part from one peer alone. What is published until the new socket stands is lost to
        subscribers, who see that by `seq`.
        """
        self._limit.close()
        self._socket.close(linger=0)
        self._socket = self._open()
        self._limit = ConnectionLimit(self._socket)
        if self._moving is not None:
            self._moving.cancel()
        self._moving = asyncio.create_task(self._bind_again(self._socket), name="events")

    async def _bind_again(self, socket: zmq.Socket[bytes]) -> None:
        """Bind where the socket before was; the library lets go of the address a moment after it was closed."""
        loop = asyncio.get_running_loop()
        give_up_s = loop.time() + GIVE_UP_S
        while True:
            try:
                socket.bind(self._endpoint)
                return
            except zmq.ZMQError as exc:
                if loop.time() > give_up_s:
                    log.error("events_not_served", endpoint=self._endpoint, error=str(exc))
                    return
            await asyncio.sleep(BIND_AGAIN_S)
