"""Requests to the daemon: each goes out by the key of one role, so that the daemon itself refuses what none may."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from contextlib import suppress
from itertools import count
from typing import Any

import zmq
import zmq.asyncio

from daemon.client import NoAnswer, Refused, find_key, unlock
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody
from daemon.domain.roles import Role
from daemon.wire.curve_keys import PrivateKey
from daemon.wire.requests import WIRE_VERSION

ANSWER_S = 5.0


class Line:
    """One connection to the control socket, with one key; many requests may be under way."""

    def __init__(self, context: zmq.asyncio.Context, endpoint: str, key: PrivateKey | None) -> None:
        """Connect; raise `KeyTrouble` if the key cannot be used."""
        self._socket = context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RECONNECT_IVL_MAX, 1000)
        # Nothing waits for a daemon that is away: an order that was given up must not be carried out an hour later.
        self._socket.setsockopt(zmq.IMMEDIATE, 1)
        self._handshakes = self._socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_FAILED_AUTH)
        unlock(self._socket, find_key(key))
        self._socket.connect(endpoint)
        self._open: dict[str, asyncio.Future[dict[str, Any]]] = {}
        self._tags = count(1)
        self._reading: asyncio.Task[None] | None = None
        self.let_in = True
        """False once the daemon refused the key: such a connection is not tried again by itself."""

    async def request(self, op: str, *, within_s: float = ANSWER_S, **fields: Any) -> dict[str, Any]:
        """Ask and return the reply; raise `Refused` or `NoAnswer`."""
        if self._reading is None:
            self._reading = asyncio.create_task(self._read(), name="answers")
        tag = str(next(self._tags))
        answer = self._open[tag] = asyncio.get_running_loop().create_future()
        asked = {"v": WIRE_VERSION, "op": op, "tag": tag, **fields}
        try:
            async with asyncio.timeout(within_s):
                await self._send(json.dumps(asked).encode())
                reply: dict[str, Any] = await answer
        except TimeoutError as exc:
            raise NoAnswer("the station does not answer") from exc
        finally:
            self._open.pop(tag, None)
        if not reply.get("ok"):
            raise Refused(reply["error"])
        return reply

    async def _send(self, message: bytes) -> None:
        """Send as soon as the connection stands; raise `Refused` where the daemon does not let the key in."""
        sending = asyncio.ensure_future(self._socket.send_multipart([b"", message]))
        refused = asyncio.ensure_future(self._handshakes.recv_multipart())
        try:
            await asyncio.wait({sending, refused}, return_when=asyncio.FIRST_COMPLETED)
            if not sending.done() or not self.let_in:
                self.let_in = False
                raise Refused(ErrorBody.of(Fault(FaultCode.KEY_REVOKED)).model_dump())
            sending.result()
        finally:
            sending.cancel()
            refused.cancel()

    async def turned_away(self) -> bool:
        """Whether the daemon has refused the key since it was used last, as one that came again after a restart."""
        if self.let_in and await self._handshakes.poll(0):
            self.let_in = False
        return not self.let_in

    async def _read(self) -> None:
        while True:
            frames = await self._socket.recv_multipart()
            with suppress(ValueError):
                reply = json.loads(frames[-1])
                # A key that was taken back is refused before anything of the request is read, its tag too.
                tag = reply.get("tag") or next(iter(self._open), "")
                answer = self._open.get(str(tag))
                if answer is not None and not answer.done():
                    answer.set_result(reply)

    def close(self) -> None:
        """Let go of it; no answer comes any more to who waits for one."""
        if self._reading is not None:
            self._reading.cancel()
        for answer in self._open.values():
            if not answer.done():
                answer.set_exception(NoAnswer("the station does not answer"))
                answer.exception()  # nobody may wait for it
        self._socket.disable_monitor()
        self._handshakes.close(linger=0)
        self._socket.close()


class Ask:
    """One line for each role, made when it is first used."""

    def __init__(self, context: zmq.asyncio.Context, endpoint: str, keys: Mapping[Role, PrivateKey] | None) -> None:
        """Take the keys by role; None where the daemon asks for no keys."""
        self._context, self._endpoint, self._keys = context, endpoint, keys
        self._lines: dict[Role, Line] = {}

    async def request(self, role: Role, op: str, **fields: Any) -> dict[str, Any]:
        """Ask with the key of a role; raise `Refused` or `NoAnswer`."""
        if role in self._lines and await (before := self._lines[role]).turned_away():
            self._part_from(role, before)
        if role not in self._lines:
            self._lines[role] = Line(self._context, self._endpoint, self._keys[role] if self._keys else None)
        line = self._lines[role]
        try:
            return await line.request(op, **fields)
        finally:
            self._part_from(role, line)

    def _part_from(self, role: Role, line: Line) -> None:
        """Let go of a line whose key was refused: the next request connects again, for it may be allowed by then."""
        if not line.let_in and self._lines.get(role) is line:
            self._lines.pop(role).close()

    def close(self) -> None:
        """Let go of all lines."""
        for line in self._lines.values():
            line.close()
