"""Connection limit of a bound socket: peers beyond it are parted from as soon as they have come.

A process without free descriptors is aborted by the socket library, so that it must never come to that. A peer that is
parted from tries again by itself, as every ZeroMQ client does, and stays once others have gone. Peers that connect and
say nothing are parted from after `HANDSHAKE_MS`.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket as sockets
import uuid
from typing import Any

import structlog
import zmq
from zmq.utils.monitor import parse_monitor_message

from daemon.platform import descriptors

HANDSHAKE_MS = 3_000
SHARE = 4
"""Each of the three sockets may use one of so many parts of the process' descriptors: a quarter of them stays free."""
TELL_EVERY_S = 10.0
log = structlog.get_logger(__name__)


class ConnectionLimit:
    """Counts the peers of one socket and parts from those beyond the limit; for one event loop."""

    def __init__(self, socket: zmq.Socket[Any], most: int | None = None) -> None:
        """Follow a socket that is not bound yet. `most`: peers at once; by default a share of the descriptors."""
        self.most = most if most is not None else descriptors.limit() // SHARE
        self.refused = 0
        """How many were parted from so far because there were too many."""
        self._socket = socket
        self._peers: dict[int, None] = {}
        self._tell_again_s = 0.0
        self._loop = asyncio.get_running_loop()
        socket.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
        address = f"inproc://connections-{uuid.uuid4().hex}"
        socket.monitor(address, zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED)
        # A plain context: the socket may be one of an asyncio context, whose sockets are read otherwise.
        self._events: zmq.Socket[bytes] = zmq.Context(socket.context).socket(zmq.PAIR)
        self._events.setsockopt(zmq.RCVHWM, 0)
        self._events.setsockopt(zmq.LINGER, 0)
        self._events.connect(address)
        self._descriptor = int(self._events.FD)
        self._loop.add_reader(self._descriptor, self._count)
        self._count()

    @property
    def peers(self) -> int:
        """How many are connected, as far as the library has told."""
        return len(self._peers)

    def close(self) -> None:
        """Follow it no more; to be called before the socket is closed."""
        self._loop.remove_reader(self._descriptor)
        self._socket.disable_monitor()
        self._events.close()

    def _count(self) -> None:
        """Read what the library tells, to the end: the descriptor tells only that something has changed."""
        with contextlib.suppress(zmq.Again):
            while True:
                event = parse_monitor_message(self._events.recv_multipart(zmq.NOBLOCK))
                descriptor = event["value"]
                self._peers.pop(descriptor, None)
                if event["event"] == zmq.EVENT_ACCEPTED:
                    self._peers[descriptor] = None
        if len(self._peers) > self.most:
            self._part_from_the_last()

    def _part_from_the_last(self) -> None:
        """End the connections that came last, under the library's hands: it sees an end as if the peer had gone."""
        while len(self._peers) > self.most:
            descriptor, _ = self._peers.popitem()
            _end(descriptor)
            self.refused += 1
        now_s = self._loop.time()
        if now_s >= self._tell_again_s:
            self._tell_again_s = now_s + TELL_EVERY_S
            advice = "Find the client that connects again and again; others come in once some have gone."
            log.error("too_many_connections", limit=self.most, refused=self.refused, advice=advice)


def _end(descriptor: int) -> None:
    """Shut a connection down without taking its descriptor away from who owns it."""
    try:
        ours = os.dup(descriptor)
    except OSError:
        return  # the library has closed it meanwhile
    try:
        with sockets.socket(fileno=ours) as connection:
            connection.shutdown(sockets.SHUT_RDWR)
    except OSError:
        return  # gone already
