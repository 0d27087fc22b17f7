"""The control socket: one JSON frame in, one JSON frame out, for REQ and DEALER clients alike.

Whatever arrives gets an answer that says what was wrong with it; nothing that arrives can stop the loop.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

import structlog
import zmq
import zmq.asyncio

from daemon.events import bind
from daemon.faults import Fault, Kind
from daemon.messages import WIRE_VERSION, AnyRequest, ErrorBody, parse_request
from daemon.trouble import as_fault

HARD_LIMIT = 64 * 1024 * 1024
"""ZeroMQ drops a peer beyond this without a word; up to it a message is answered with an error."""
MAX_PENDING = 1000
"""Replies that may be held at once for clients that wait."""
Handler = Callable[[AnyRequest], Awaitable[dict[str, Any]]]
log = structlog.get_logger(__name__)


class ControlSocket:
    """Serve requests; each is handled in a task of its own, so a client that waits holds up nobody."""

    def __init__(
        self, context: zmq.asyncio.Context, endpoint: str, max_message_bytes: int, version: str, handle: Handler
    ) -> None:
        self._max_message_bytes = max_message_bytes
        self._version = version
        self._handle = handle
        self._socket = context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 200)
        self._socket.setsockopt(zmq.MAXMSGSIZE, HARD_LIMIT)
        self._socket.setsockopt(zmq.ROUTER_HANDOVER, 1)
        bind(self._socket, endpoint)
        self._pending: set[asyncio.Task[None]] = set()

    async def serve(self) -> None:
        """Answer for ever; cancelling drops held replies."""
        try:
            while True:
                frames = await self._socket.recv_multipart()
                task = asyncio.create_task(self._answer(frames, full=len(self._pending) >= MAX_PENDING))
                self._pending.add(task)
                task.add_done_callback(self._pending.discard)
        finally:
            for task in self._pending:
                task.cancel()
            if self._pending:
                await asyncio.wait(self._pending)

    async def drain(self, within_s: float) -> None:
        """Give held replies a moment to go out."""
        if self._pending:
            await asyncio.wait(self._pending, timeout=within_s)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    async def _answer(self, frames: list[bytes], *, full: bool) -> None:
        """Turn one message into one reply along the same route."""
        route, body = _split(frames)
        raw: Any = None
        try:
            if full:
                raise Fault(Kind.BUSY, f"{MAX_PENDING} replies are held already")
            raw = self._decode(body)
            reply = {"v": WIRE_VERSION, "ok": True, **await self._handle(parse_request(raw))}
        except asyncio.CancelledError:
            raise
        except Exception as exc:  # the edge of the daemon: every failure becomes a reply
            fault = as_fault(exc)
            if fault.kind is Kind.INTERNAL:
                log.exception("request_failed_internally")
            reply = {"v": WIRE_VERSION, "ok": False, "error": ErrorBody.of(fault).model_dump(mode="json")}
        if isinstance(raw, dict) and isinstance(raw.get("id"), str):
            reply.setdefault("id", raw["id"][:128])
        reply["version"] = self._version
        await self._socket.send_multipart([*route, json.dumps(reply).encode()])

    def _decode(self, body: list[bytes]) -> Any:
        """Read the one JSON frame of a message."""
        size = sum(len(frame) for frame in body)
        if size > self._max_message_bytes:
            raise Fault(Kind.MESSAGE_TOO_LARGE, f"{size} bytes", limit_bytes=self._max_message_bytes)
        if len(body) != 1:
            raise Fault(Kind.BAD_JSON, f"{len(body)} frames instead of one")
        try:
            return json.loads(body[0])
        except (ValueError, RecursionError) as exc:
            raise Fault(Kind.BAD_JSON, f"not JSON: {exc}"[:300]) from exc


def _split(frames: list[bytes]) -> tuple[list[bytes], list[bytes]]:
    """Part the route (identity, and the empty frame a REQ puts behind it) from the message."""
    cut = 2 if len(frames) > 1 and frames[1] == b"" else 1
    return frames[:cut], frames[cut:]
