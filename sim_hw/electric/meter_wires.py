"""Wires of the simulated meter: a TCP port on loopback and a pseudo terminal, one instrument behind both."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable
from pathlib import Path

from sim_hw.linked_pty import LinkedPty
from sim_hw.plant.faults import Faults

LONGEST = 4096
"""Bytes of a message; what is longer is thrown away."""
_GARBAGE = 24

Answer = Callable[[str], Awaitable[str | None]]
Write = Callable[[bytes], object]


class MeterWires:
    """Serve an instrument; messages of both wires are worked off one after another."""

    def __init__(self, answer: Answer, faults: Faults, seed: int) -> None:
        self._answer = answer
        self._faults = faults
        self._rng = random.Random(f"{seed}/meter/garbage")
        self._messages: asyncio.Queue[tuple[bytes, Write]] = asyncio.Queue()
        self._writers: set[asyncio.StreamWriter] = set()
        self._server: asyncio.Server | None = None
        self._terminal: LinkedPty | None = None
        self._begun = bytearray()
        self.address = self.pty = ""

    async def open(self, port: int = 0, link: Path | None = None) -> None:
        """Begin to listen; port 0 takes a free one. `link`: made a symlink to the pseudo terminal.

        Raises:
            OSError: the port is taken, no pseudo terminal is left, or the link cannot be made.

        """
        self._terminal = terminal = LinkedPty(link, "meter")
        self.pty = terminal.path
        asyncio.get_running_loop().add_reader(terminal, self._readable, terminal)
        self._server = await asyncio.start_server(self._connected, "127.0.0.1", port, limit=LONGEST)
        self.address = f"127.0.0.1:{self._server.sockets[0].getsockname()[1]}"

    async def serve(self) -> None:
        """Work off messages until cancelled."""
        while True:
            message, write = await self._messages.get()
            said = await self._answer(message.decode("ascii", errors="replace").strip())
            if said is None or self._faults.use("meter_silent"):
                continue
            garbled = self._faults.use("meter_garbage")
            write(self._rng.randbytes(_GARBAGE).replace(b"\n", b"\xff") + b"\n" if garbled else said.encode() + b"\n")

    async def close(self) -> None:
        """Hang up; remove the symlink if it still is ours."""
        if self._terminal is not None:
            asyncio.get_running_loop().remove_reader(self._terminal)
            self._terminal.close()
            self._terminal = None
        if self._server is not None:
            self._server.close()
            for writer in tuple(self._writers):
                writer.close()
            await self._server.wait_closed()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        try:
            begun = bytearray()
            while data := await reader.read(LONGEST):
                self._take(begun, data, _if_open(writer))
        except OSError:
            pass
        finally:
            self._writers.discard(writer)
            writer.close()

    def _readable(self, terminal: LinkedPty) -> None:
        try:
            data = terminal.read(LONGEST)
        except (BlockingIOError, InterruptedError):
            return
        self._take(self._begun, data, self._write_pty)

    def _write_pty(self, data: bytes) -> None:
        if self._terminal is not None:
            try:
                self._terminal.write(data)
            except BlockingIOError:
                return

    def _take(self, begun: bytearray, data: bytes, write: Write) -> None:
        begun += data
        *whole, rest = bytes(begun).split(b"\n")
        begun[:] = b"" if len(rest) > LONGEST else rest
        for message in whole:
            if message.strip():
                self._messages.put_nowait((message, write))


def _if_open(writer: asyncio.StreamWriter) -> Write:
    return lambda data: None if writer.is_closing() else writer.write(data)
