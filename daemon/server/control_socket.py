"""Control socket: one JSON frame in, one JSON frame out, for REQ and DEALER clients alike.

Whatever arrives gets an answer that says what was wrong with it; nothing that arrives can stop the loop. What can be
answered without waiting is answered on the spot; the rest is a task each, so a client that waits holds up nobody.
"""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import Awaitable
from functools import partial
from typing import Any, Protocol

import structlog
import zmq

from daemon.config.sections.service import ApiSection
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody
from daemon.domain.roles import Caller
from daemon.server.auth import Authenticator
from daemon.server.rate_limit import RateLimit
from daemon.server.served_address import bind
from daemon.station.device_errors import as_fault
from daemon.wire.limits import GLANCE_BYTES, HARD_LIMIT, MAX_COMMAS, MAX_HELD, MAX_PENDING
from daemon.wire.operations.table import OPERATIONS, AnyRequest
from daemon.wire.replies import AnyReply, Refusal, Reply
from daemon.wire.requests import MAX_TAG

RECEIVE_QUEUE, SEND_QUEUE = 200, 200
"""Messages of one peer held for it; a peer that does not read its answers loses them."""
BATCH = 8
"""Messages taken in a row before whatever else the event loop has to do gets its turn."""
MAX_ID = 128
log = structlog.get_logger(__name__)


class Answers(Protocol):
    """What answers requests."""

    def at_once(self, request: AnyRequest, caller: Caller) -> Reply | None:
        """Return the reply if it needs no waiting, else None."""

    def handle(self, request: AnyRequest, caller: Caller) -> Awaitable[Reply]:
        """Return the reply, or raise `Fault`."""


class ControlSocket:
    """Serve requests."""

    def __init__(
        self, context: zmq.Context[Any], api: ApiSection, version: str, answers: Answers, guard: Authenticator
    ) -> None:
        self._max_message_bytes = api.max_message_bytes
        self._version, self._answers, self._guard = version, answers, guard
        self._rate = RateLimit(api.rate_per_s, api.rate_burst)
        # A plain socket beside the loop's descriptor: a future for each message would cost more than most answers.
        self._socket: zmq.Socket[bytes] = zmq.Context(context).socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 200)
        self._socket.setsockopt(zmq.MAXMSGSIZE, HARD_LIMIT)
        self._socket.setsockopt(zmq.RCVHWM, RECEIVE_QUEUE)
        self._socket.setsockopt(zmq.SNDHWM, SEND_QUEUE)
        # A client that comes back under its name is served at once. With keys nobody may take a name that is in use.
        self._socket.setsockopt(zmq.ROUTER_HANDOVER, int(not guard.curve))
        guard.protect(self._socket)
        self._limit = bind(self._socket, api.control)
        self._broken: asyncio.Future[None] | None = None
        self._pending: set[asyncio.Task[None]] = set()
        self._held: Counter[str] = Counter()

    async def serve(self) -> None:
        """Answer until cancelled; cancelling drops held replies."""
        loop = asyncio.get_running_loop()
        descriptor = self._socket.FD
        self._broken = loop.create_future()
        loop.add_reader(descriptor, self._stirred)
        self._stirred()
        try:
            await self._broken
        finally:
            loop.remove_reader(descriptor)
            for task in self._pending:
                task.cancel()
            if self._pending:
                await asyncio.wait(self._pending)

    async def drain(self, within_s: float) -> None:
        """Give held replies a moment to go out."""
        if self._pending:
            await asyncio.wait(self._pending, timeout=within_s)

    def adopt(self, api: ApiSection) -> None:
        """Take over what of another configuration a bound socket can."""
        self._max_message_bytes = api.max_message_bytes
        self._rate = RateLimit(api.rate_per_s, api.rate_burst)

    def close(self) -> None:
        """Close the socket."""
        self._limit.close()
        self._socket.close()

    def _stirred(self) -> None:
        """Take what is there, a few at most before the loop turns; called whenever the socket has stirred.

        The descriptor tells only that something has changed: the socket is read until nothing is left.
        """
        if self._broken is None or self._broken.done():
            return
        try:
            for _ in range(BATCH):
                self._take(self._socket.recv_multipart(zmq.NOBLOCK, copy=False))
        except zmq.Again:
            return
        except Exception as exc:  # noqa: BLE001  # nothing can be answered any more: let `serve` end by it
            self._broken.set_exception(exc)
            return
        asyncio.get_running_loop().call_soon(self._stirred)

    def _take(self, frames: list[zmq.Frame]) -> None:
        """Answer one message along the route it came, now or by a task."""
        route, body = _split(frames)
        raw: Any = None
        try:
            caller = self._guard.caller(frames[-1], route[0])
            self._rate.spend(caller.client)
            raw = self._decode(body)
            # Who may not ask for it learns nothing of its fields, and costs nothing of their validation.
            OPERATIONS.require(caller, OPERATIONS.operation(raw).op)
            request = OPERATIONS.parse(raw)
            reply: AnyReply | None = self._answers.at_once(request, caller)
            if reply is None:
                self._make_room(caller.client)
                self._later(route, raw, caller.client, self._answers.handle(request, caller))
        except Exception as exc:  # noqa: BLE001  # the edge of the daemon: every failure becomes a reply
            reply = _refusal(exc)
            raw = self._glance(body) if raw is None else raw
        if reply is not None:
            self._send(route, raw, reply)

    def _make_room(self, client: str) -> None:
        """Raise `Fault` if too many replies are held already, for this client or for all."""
        if len(self._pending) >= MAX_PENDING or self._held[client] >= MAX_HELD:
            raise Fault(
                FaultCode.BUSY, f"{self._held[client]} replies are held for this client, {len(self._pending)} for all",
                limit_held=MAX_PENDING, limit_held_per_client=MAX_HELD,
            )  # fmt: skip

    def _later(self, route: list[bytes], raw: Any, client: str, answer: Awaitable[Reply]) -> None:
        """Let a task send the answer when it is there."""
        task = asyncio.create_task(self._finish(route, raw, answer))
        self._pending.add(task)
        self._held[client] += 1
        task.add_done_callback(partial(self._over, client))

    def _over(self, client: str, task: asyncio.Task[None]) -> None:
        self._pending.discard(task)
        self._held[client] -= 1
        if not self._held[client]:
            del self._held[client]

    async def _finish(self, route: list[bytes], raw: Any, answer: Awaitable[Reply]) -> None:
        try:
            reply: AnyReply = await answer
        except asyncio.CancelledError:
            raise
        except Exception as exc:  # noqa: BLE001  # as above
            reply = _refusal(exc)
        self._send(route, raw, reply)
        # Sending may have swallowed the sign that something came in.
        self._stirred()

    def _send(self, route: list[bytes], raw: Any, reply: AnyReply) -> None:
        """Send a reply; a peer that is gone or reads nothing loses it."""
        reply.version = self._version
        if isinstance(raw, dict):
            reply.id = reply.id or _echo(raw.get("id"), MAX_ID)
            reply.tag = _echo(raw.get("tag"), MAX_TAG)
        try:
            self._socket.send_multipart([*route, reply.to_json()], zmq.NOBLOCK)
        except zmq.ZMQError as exc:
            log.warning("reply_lost", error=str(exc))

    def _decode(self, body: list[zmq.Frame]) -> Any:
        """Read the one JSON frame of a message; its size is looked at before anything else of it is."""
        size = sum(len(frame) for frame in body)
        if size > self._max_message_bytes:
            raise Fault(
                FaultCode.MESSAGE_TOO_LARGE, f"the message has {size} bytes", limit_bytes=self._max_message_bytes
            )
        if len(body) != 1:
            raise Fault(FaultCode.BAD_JSON, f"{len(body)} frames instead of one")
        data = body[0].bytes
        if data.count(b",") > MAX_COMMAS:
            raise Fault(FaultCode.INVALID_REQUEST, f"more than {MAX_COMMAS} values, which no request has", fields=[])
        try:
            return json.loads(data)
        except (ValueError, RecursionError) as exc:
            raise Fault(FaultCode.BAD_JSON, f"not JSON: {exc}"[:300]) from exc

    def _glance(self, body: list[zmq.Frame]) -> Any:
        """Read a short message that was refused before it was read, so that its refusal can be told apart."""
        if len(body) != 1 or len(body[0]) > min(GLANCE_BYTES, self._max_message_bytes):
            return None
        try:
            return json.loads(body[0].bytes)
        except (ValueError, RecursionError):
            return None


def _refusal(error: Exception) -> Refusal:
    """Turn whatever was raised into the reply that says so."""
    fault = as_fault(error)
    if fault.kind is FaultCode.INTERNAL:
        log.error("request_failed_internally", exc_info=error)
    return Refusal(error=ErrorBody.of(fault))


def _echo(value: Any, longest: int) -> str | None:
    """Return a text of the request for its answer, cut and made sendable; None for what is no text."""
    return value[:longest].encode(errors="replace").decode() if isinstance(value, str) else None


def _split(frames: list[zmq.Frame]) -> tuple[list[bytes], list[zmq.Frame]]:
    """Part the route (identity, and the empty frame a REQ puts behind it) from the message."""
    cut = 2 if len(frames) > 1 and not len(frames[1]) else 1
    return [frame.bytes for frame in frames[:cut]], frames[cut:]
