"""What a tester in Python imports: one blocking client for the control socket, one listener for the events."""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterator
from types import TracebackType
from typing import Any, Self

import zmq

from daemon.messages import WIRE_VERSION, JobResult

DEFAULT_CONTROL = "tcp://127.0.0.1:5555"
DEFAULT_EVENTS = "tcp://127.0.0.1:5556"


class NoAnswer(TimeoutError):
    """The daemon did not answer in time. Examples: it is not running, or listens elsewhere."""


class Refused(Exception):
    """The daemon answered with an error; `error` is its wire form (code, name, message, advice, detail)."""

    def __init__(self, error: dict[str, Any]) -> None:
        super().__init__(f"{error['name']} ({error['code']}): {error['message']}; {error['advice']}")
        self.error = error


class Client:
    """Ask the daemon. Not for several threads; a request that got no answer leaves the client usable."""

    def __init__(self, endpoint: str = DEFAULT_CONTROL, timeout_s: float = 5.0) -> None:
        self._endpoint = endpoint
        self._timeout_s = timeout_s
        self._context = zmq.Context()
        self._socket = self._connect()

    def __enter__(self) -> Self:
        """Use it in a with statement."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Let go of the connection."""
        self._socket.close(linger=0)
        self._context.term()

    def request(self, op: str, *, timeout_s: float | None = None, **fields: Any) -> dict[str, Any]:
        """Send one request and return the reply; raise `Refused` or `NoAnswer`."""
        reply = self.raw(json.dumps({"v": WIRE_VERSION, "op": op, **fields}).encode(), timeout_s=timeout_s)
        if not reply.get("ok"):
            raise Refused(reply["error"])
        return reply

    def raw(self, message: bytes, *, timeout_s: float | None = None) -> dict[str, Any]:
        """Send bytes as they are and return the decoded reply."""
        self._socket.send(message)
        wait_s = self._timeout_s if timeout_s is None else timeout_s
        if not self._socket.poll(int(wait_s * 1e3)):
            # A REQ socket that waits for a reply can send nothing else: begin anew.
            self._socket.close(linger=0)
            self._socket = self._connect()
            raise NoAnswer(f"no answer from {self._endpoint} within {wait_s:g} s; is the daemon running?")
        reply: dict[str, Any] = json.loads(self._socket.recv())
        return reply

    def job(self, op: str, *, job_id: str | None = None, timeout_s: float = 120.0, **fields: Any) -> JobResult:
        """Run one job to its end and return its result, which may be a failed one; raise `Refused` if not taken."""
        job_id = job_id or f"{op}-{uuid.uuid4().hex[:12]}"
        reply = self.request(op, id=job_id, wait=True, timeout_s=timeout_s, **fields)
        return JobResult.model_validate(reply["result"])

    def _connect(self) -> zmq.Socket[bytes]:
        socket = self._context.socket(zmq.REQ)
        socket.connect(self._endpoint)
        return socket


class Subscription:
    """Hear events from now on; each carries topic, seq, time and station."""

    def __init__(self, endpoint: str = DEFAULT_EVENTS, topics: tuple[str, ...] = ("",)) -> None:
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        for topic in topics:
            self._socket.subscribe(topic)
        self._socket.connect(endpoint)

    def __enter__(self) -> Self:
        """Use it in a with statement."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        """Stop listening."""
        self._socket.close(linger=0)
        self._context.term()

    def next(self, within_s: float | None = None) -> dict[str, Any] | None:
        """Return the next event, or None if none comes in time."""
        if within_s is not None and not self._socket.poll(int(within_s * 1e3)):
            return None
        _, body = self._socket.recv_multipart()
        event: dict[str, Any] = json.loads(body)
        return event


def listen(endpoint: str = DEFAULT_EVENTS, topics: tuple[str, ...] = ("",)) -> Iterator[dict[str, Any]]:
    """Yield events for ever."""
    with Subscription(endpoint, topics) as heard:
        while (event := heard.next()) is not None:
            yield event
