"""The far end of an instrument's line: raw bytes for raw bytes, over TCP or on a pty."""

import asyncio
import os
import tty
from collections.abc import Callable, Sequence
from pathlib import Path

from drivers.meter import SerialAddress, TcpAddress

Step = bytes | float
"""Bytes to send, or seconds to wait before the next ones."""
Answer = Callable[[bytes], Sequence[Step]]
IDENTITY = b"ACME,DMM-7,SN123,1.0"


class Instrument:
    """Answers each line by a script, and remembers what it was told."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer
        self.told: list[bytes] = []
        self.told_one = asyncio.Event()
        self.openings = 0
        self._buffer = b""
        self._speaking = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()

    def take(self, data: bytes, write: Callable[[bytes], object]) -> None:
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        for line in lines:
            self.told.append(line)
            self.told_one.set()
            task = asyncio.get_running_loop().create_task(self._say(self.answer(line), write))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _say(self, steps: Sequence[Step], write: Callable[[bytes], object]) -> None:
        async with self._speaking:
            for step in steps:
                if isinstance(step, float):
                    await asyncio.sleep(step)
                else:
                    write(step)

    async def end(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)


class TcpPeer:
    """Serves an instrument on a free port of loopback."""

    def __init__(self, instrument: Instrument) -> None:
        self.instrument = instrument
        self._server: asyncio.Server | None = None
        self._writers: list[asyncio.StreamWriter] = []

    async def open(self) -> TcpAddress:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        return TcpAddress("127.0.0.1", self._server.sockets[0].getsockname()[1])

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.instrument.openings += 1
        self._writers.append(writer)
        while data := await reader.read(4096):
            self.instrument.take(data, writer.write)
        writer.close()

    async def hang_up(self) -> None:
        for writer in self._writers:
            writer.close()
        self._writers.clear()

    async def close(self) -> None:
        assert self._server is not None
        await self.instrument.end()
        self._server.close()
        await self.hang_up()
        await self._server.wait_closed()


class PtyPeer:
    """Serves an instrument on a pseudo terminal."""

    def __init__(self, instrument: Instrument, link: Path) -> None:
        self.instrument = instrument
        self._link = link
        self._master = self._slave = -1

    async def open(self) -> SerialAddress:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(os.ttyname(self._slave))
        asyncio.get_running_loop().add_reader(self._master, self._read)
        return SerialAddress(str(self._link))

    def _read(self) -> None:
        master = self._master
        self.instrument.take(os.read(master, 4096), lambda data: os.write(master, data))

    async def hang_up(self) -> None:
        asyncio.get_running_loop().remove_reader(self._master)
        os.close(self._master)
        os.close(self._slave)
        self._master = -1

    async def close(self) -> None:
        await self.instrument.end()
        if self._master >= 0:
            await self.hang_up()


class Script:
    """A plain instrument: knows who it is, has an error queue, and says `reading` when asked for one."""

    def __init__(self) -> None:
        self.reading: Sequence[Step] = (b"+1.50000000E+01\n",)
        self.errors: list[bytes] = []
        self.knows: Callable[[bytes], bool] = lambda _command: True
        self.identity = IDENTITY
        self.silent = False

    def __call__(self, line: bytes) -> Sequence[Step]:
        line = line.rstrip(b"\r")
        if self.silent:
            return ()
        if line == b"*IDN?":
            return (self.identity + b"\n",)
        if line == b"SYST:ERR?":
            return ((self.errors.pop(0) if self.errors else b'+0,"No error"') + b"\n",)
        if line == b"READ?":
            return self.reading
        if line == b"*CLS":
            self.errors.clear()
        elif not self.knows(line):
            self.errors.append(b'-113,"Undefined header"')
        return ()
