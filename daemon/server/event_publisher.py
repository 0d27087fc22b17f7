"""Event publisher: everything that happens, on a PUB socket, in the order of its numbers."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

import structlog
import zmq

from daemon.domain.errors import Fault
from daemon.platform.clock import utc_now
from daemon.server.auth import Authenticator
from daemon.server.connection_limit import ConnectionLimit
from daemon.storage.journal import Journal
from daemon.wire.events import Topic, event
from daemon.wire.limits import EVENT_QUEUE
from drivers.shielded import finish

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
        self._turn = asyncio.Lock()
        self._held: deque[tuple[Topic, dict[str, Any]]] | None = None
        """What was published while another event is being written; None while none is."""
        self._socket = self._open()
        self._limit = bind(self._socket, endpoint)

    def _open(self) -> zmq.Socket[bytes]:
        socket: zmq.Socket[bytes] = self._context.socket(zmq.PUB)
        socket.setsockopt(zmq.SNDHWM, EVENT_QUEUE)
        socket.setsockopt(zmq.LINGER, 200)
        self._guard.protect(socket)
        return socket

    def publish(self, topic: Topic, body: dict[str, Any]) -> int | None:
        """Send one event and return its number.

        None while another event is being written, which comes first, and while no number is to be had: then the event
        is not sent, so that numbers have no gap.
        """
        if self._held is not None:
            self._held.append((topic, body))
            return None
        try:
            number = self._journal.take_seq()
        except Fault:
            return None
        self._send(topic, body, number)
        return number

    async def publish_written(self, topic: Topic, write: Callable[[int], Awaitable[dict[str, Any]]]) -> int:
        """Have one event written down under its number, then send it; events published meanwhile come after it.

        Done to its end even if cancelled. Raises what `write` raises; then nothing is sent, and the number is free.
        """
        sent = await finish(self._write_and_send(topic, write))
        if isinstance(sent, Fault):
            raise sent
        return sent

    async def _write_and_send(self, topic: Topic, write: Callable[[int], Awaitable[dict[str, Any]]]) -> int | Fault:
        """Return a `Fault` instead of raising it: a cancellation of who waits must win over it."""
        async with self._turn:
            try:
                number = self._journal.lend_seq()
            except Fault as exc:
                return exc
            held = self._held = deque[tuple[Topic, dict[str, Any]]](maxlen=EVENT_QUEUE)
            written = False
            try:
                body = await write(number)
                written = True
            except Fault as exc:
                return exc
            finally:
                self._journal.settle_seq(used=written)
                self._held = None
                if written:
                    self._send(topic, body, number)
                for later, facts in held:
                    self.publish(later, facts)
            return number

    def _send(self, topic: Topic, body: dict[str, Any], number: int) -> None:
        if self._guard.removals != self._removals:
            self._removals = self._guard.removals
            self._send_all_away()
        told = event(topic, number, utc_now(), self._station, body)
        self._socket.send_multipart([topic.encode(), told.model_dump_json().encode()], zmq.NOBLOCK)
        if self._count is not None:
            self._count(topic, body)

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
