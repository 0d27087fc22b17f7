"""Event publisher: everything that happens, on a PUB socket, in the order of its numbers.

An address that cannot be served keeps nobody from work: it is told once, and tried again now and then. Events go on to
be numbered meanwhile, and what is kept of them can be replayed from the journal.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

import zmq

from daemon.domain.errors import Fault
from daemon.platform.clock import utc_now
from daemon.server.auth import Authenticator
from daemon.server.served_address import SERVE_AGAIN_S, ServedAddress
from daemon.storage.journal import Journal
from daemon.wire.events import Topic, event
from daemon.wire.limits import EVENT_QUEUE
from drivers.shielded import finish

Count = Callable[[str, Mapping[str, Any]], None]


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
        self._context = context
        self._count = count
        self._station = station
        self._journal = journal
        self._guard = guard or Authenticator("maintain")
        self._removals = self._guard.removals
        self._moving: asyncio.Task[None] | None = None
        self._turn = asyncio.Lock()
        self._held: deque[tuple[Topic, dict[str, Any]]] | None = None
        """What was published while another event is being written; None while none is."""
        self._address = ServedAddress("events", "events", endpoint, self._socket)
        self.open()

    @property
    def trouble(self) -> str | None:
        """Why nobody can subscribe; None where somebody can."""
        return self._address.trouble

    def open(self) -> None:
        """Serve, unless that is so already or about to be; nothing is raised."""
        if self._moving is None or self._moving.done():
            self._address.open()

    async def run(self, serve_again_s: float = SERVE_AGAIN_S) -> None:
        """Try again now and then, until cancelled."""
        while True:
            self.open()
            await asyncio.sleep(serve_again_s)

    def _socket(self) -> zmq.Socket[bytes]:
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
        if self._address.socket is not None:
            self._address.socket.send_multipart([topic.encode(), told.model_dump_json().encode()], zmq.NOBLOCK)
        if self._count is not None:
            self._count(topic, body)

    def close(self) -> None:
        """Close the socket, if there is one; what is on its way is still sent for a moment."""
        if self._moving is not None:
            self._moving.cancel()
        self._address.close(linger_ms=None)

    def _send_all_away(self) -> None:
        """Part from every subscriber, for one of them may have had its key taken back; who may, comes again by itself.

        A PUB socket cannot part from one peer alone. What is published until the new socket stands is lost to
        subscribers, who see that by `seq`.
        """
        self._address.close(linger_ms=0)
        if self._moving is not None:
            self._moving.cancel()
        self._moving = asyncio.create_task(self._address.open_again(), name="events")
