"""The event socket: everything that happens, numbered, to whoever listens."""

from __future__ import annotations

import json
from typing import Any, Literal

import structlog
import zmq

from daemon.clock import utc_now
from daemon.journal import Journal

Topic = Literal["state", "result", "alert", "heartbeat", "progress", "log"]
VERSION = 1
SEND_QUEUE = 1000
"""Events kept for a subscriber that is slow; beyond these it loses events, never the daemon."""
log = structlog.get_logger(__name__)


def bind(socket: zmq.Socket[Any], endpoint: str) -> None:
    """Bind, or close the socket before the error goes on: a context waits for open sockets for ever."""
    try:
        socket.bind(endpoint)
    except zmq.ZMQError:
        socket.close(linger=0)
        raise


class Events:
    """Publish; a PUB socket never blocks, so this may be called from anywhere in the event loop."""

    def __init__(self, context: zmq.Context[Any], endpoint: str, station: str, journal: Journal) -> None:
        self._station = station
        self._journal = journal
        self._socket = context.socket(zmq.PUB)
        self._socket.setsockopt(zmq.SNDHWM, SEND_QUEUE)
        self._socket.setsockopt(zmq.LINGER, 200)
        bind(self._socket, endpoint)

    def publish(self, topic: Topic, body: dict[str, Any], seq: int | None = None) -> int:
        """Send one event and return its number; a number taken earlier (for the journal) is used as it is."""
        number = self._journal.take_seq() if seq is None else seq
        event = {"v": VERSION, "topic": topic, "seq": number, "time": utc_now(), "station": self._station, **body}
        self._socket.send_multipart([topic.encode(), json.dumps(event).encode()], zmq.NOBLOCK)
        return number

    def close(self) -> None:
        """Close the socket; what is on its way is still sent for a moment."""
        self._socket.close()
