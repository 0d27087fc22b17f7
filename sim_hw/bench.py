"""Bench socket: how a test harness breaks things and learns the truth. Never part of a daemon's configuration."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Protocol

import zmq
import zmq.asyncio


class Bench(Protocol):
    """What the bench can ask of a station; each returns the facts of its reply and may raise ValueError."""

    def status(self) -> dict[str, Any]:
        """Return time, motion, line and fault facts."""

    def truth(self) -> dict[str, Any]:
        """Return the truth record of now."""

    def head(self) -> dict[str, Any]:
        """Return the truth record of now, of the head alone."""

    def circuit(self) -> dict[str, Any]:
        """Return harness, closed channels, broken and shorted nets."""

    def pads(self) -> dict[str, Any]:
        """Return the pins and vias of the side that is up."""

    async def lay_board(self, folder: str | None, side: str | None, assembled: bool | None) -> dict[str, Any]:  # noqa: FBT001 - as on the wire
        """Lift the board out and lay one in."""

    def faults_listing(self) -> dict[str, Any]:
        """Return every fault with its state."""

    def fault(self, name: str, parameters: Mapping[str, Any], *, on: bool) -> None:
        """Switch a fault."""

    def set_knob(self, name: str, value: object) -> None:
        """Turn a knob."""

    def power_cycle(self) -> None:
        """Cut and restore the drives' power."""

    def shutdown(self) -> None:
        """Ask the station to end."""


class BenchServer:
    """Answer one JSON command at a time on a ZeroMQ REP socket."""

    def __init__(self, bench: Bench, endpoint: str) -> None:
        self._commands: dict[str, Callable[[dict[str, Any]], Mapping[str, Any] | Awaitable[Mapping[str, Any]]]] = {
            "status": _plain(bench.status),
            "truth": _plain(bench.truth),
            "head": _plain(bench.head),
            "circuit": _plain(bench.circuit),
            "pads": _plain(bench.pads),
            "board": lambda request: _lay_board(bench, request),
            "faults": _plain(bench.faults_listing),
            "fault": lambda request: _switch_fault(bench, request),
            "set": lambda request: _set_knob(bench, request),
            "power_cycle": _plain(bench.power_cycle),
            "shutdown": _plain(bench.shutdown),
        }
        self._context = zmq.asyncio.Context()
        self._socket = self._context.socket(zmq.REP)
        self._socket.setsockopt(zmq.LINGER, 200)
        self._socket.bind(endpoint)

    async def serve(self) -> None:
        """Answer until cancelled."""
        while True:
            raw = await self._socket.recv()
            reply = await self._answer(raw)
            await self._socket.send(json.dumps(reply).encode())

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
        self._context.term()

    async def _answer(self, raw: bytes) -> dict[str, Any]:
        try:
            request = _object(raw)
            command = request.pop("cmd", None)
            if command not in self._commands:
                raise ValueError(f"unknown command {command!r}; known: {', '.join(self._commands)}")
            answer = self._commands[command](request)
            return {"ok": True, **(answer if isinstance(answer, Mapping) else await answer)}
        except (ValueError, OSError) as error:
            return {"ok": False, "error": str(error)}


def _object(raw: bytes) -> dict[str, Any]:
    request = json.loads(raw)
    if isinstance(request, dict):
        return request
    raise ValueError('a command is a JSON object such as {"cmd": "status"}')


def _plain(call: Callable[[], Mapping[str, Any] | None]) -> Callable[[dict[str, Any]], Mapping[str, Any]]:
    def run(request: dict[str, Any]) -> Mapping[str, Any]:
        if request:
            raise ValueError(f"this command takes nothing else, but got: {', '.join(request)}")
        return call() or {}

    return run


def _switch_fault(bench: Bench, request: dict[str, Any]) -> Mapping[str, Any]:
    name, on = str(request.pop("name", "")), request.pop("on", True)
    if on not in (True, False):
        raise ValueError(f'"on" must be true or false, not {on!r}')
    bench.fault(name, request, on=bool(on))
    return {}


async def _lay_board(bench: Bench, request: dict[str, Any]) -> Mapping[str, Any]:
    """Take `folder`, `side` and `assembled`, each as it is now where it is not given."""
    kinds = {"folder": str, "side": str, "assembled": bool}
    for name, value in request.items():
        if name not in kinds or not isinstance(value, kinds[name]):
            raise ValueError(
                f'"board" takes a text "folder", a text "side" and a true or false "assembled", not {name!r}'
            )
    return await bench.lay_board(*(request.get(name) for name in kinds))


def _set_knob(bench: Bench, request: dict[str, Any]) -> Mapping[str, Any]:
    if set(request) != {"name", "value"}:
        raise ValueError('a knob needs exactly "name" and "value"')
    bench.set_knob(str(request["name"]), request["value"])
    return {}
