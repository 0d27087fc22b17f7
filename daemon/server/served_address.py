"""Address at which something is served: one that somebody else holds keeps nobody from work.

That it cannot be had is told once, and it is tried again now and then.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import structlog
import zmq

from daemon.server.connection_limit import ConnectionLimit

SERVE_AGAIN_S = 60.0
BIND_AGAIN_S, GIVE_UP_S = 0.01, 5.0
log = structlog.get_logger(__name__)
SocketT = TypeVar("SocketT", bound=zmq.Socket[Any])


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


class ServedAddress(Generic[SocketT]):
    """A socket that is bound where it can be; with it goes what bounds its peers."""

    def __init__(self, key: str, what: str, endpoint: str, make: Callable[[], SocketT]) -> None:
        """Take its key in `[api]`, what it is to people, its address, and what makes a socket to be bound there."""
        self._key, self._what, self._endpoint, self._make = key, what, endpoint, make
        self._limit: ConnectionLimit | None = None
        self.socket: SocketT | None = None
        """None where nothing is served."""
        self.trouble: str | None = None
        """Why nothing is served, and where; None where all is well."""

    def open(self) -> None:
        """Serve, unless that is so already; an address that cannot be had is told once, and nothing is raised."""
        if self.socket is not None:
            return
        try:
            self._serve()
        except zmq.ZMQError as exc:
            self._tell(exc)
            return
        if self.trouble is not None:
            self.trouble = None
            log.info(f"{self._key}_served", endpoint=self._endpoint)

    async def open_again(self) -> None:
        """Serve where the socket before was; the library lets go of the address a moment after it was closed."""
        loop = asyncio.get_running_loop()
        give_up_s = loop.time() + GIVE_UP_S
        while True:
            try:
                self._serve()
            except zmq.ZMQError as exc:
                if loop.time() > give_up_s:
                    self._tell(exc)
                    return
            else:
                self.trouble = None
                return
            await asyncio.sleep(BIND_AGAIN_S)

    def close(self, linger_ms: int | None) -> None:
        """Close the socket, if there is one; None: what is on its way is sent for as long as the socket says."""
        if self._limit is not None and self.socket is not None:
            self._limit.close()
            self.socket.close(linger_ms)
        self._limit = self.socket = None

    def _serve(self) -> None:
        socket = self._make()
        self._limit = bind(socket, self._endpoint)
        self.socket = socket

    def _tell(self, error: zmq.ZMQError) -> None:
        if self.trouble is None:
            advice = f"free the address: it is tried again every {SERVE_AGAIN_S:.0f} s; or choose another, then restart"
            log.error(f"{self._key}_not_served", endpoint=self._endpoint, error=str(error), advice=advice)
        self.trouble = f"{self._what} (api.{self._key}, {self._endpoint}): {error}"
