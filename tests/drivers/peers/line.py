"""The far end of a serial line: a pty whose other side answers requests with scripted bytes."""

import asyncio
import os
import tty
from collections.abc import Callable, Sequence
from pathlib import Path

# Bytes to send, or seconds to wait before the next ones
Step = bytes | float
# Silence that begins a new frame; more than between two reads of one
SILENCE_S = 0.02
Answer = Callable[[bytes], Sequence[Step]]


def crc(data: bytes) -> bytes:
    """CRC-16/MODBUS, low byte first."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 if value & 1 else value >> 1
    return value.to_bytes(2, "little")


def framed(body: bytes) -> bytes:
    return body + crc(body)


class PtyLine:
    """A pty behind a symlink that stays the same when the cable is pulled and put back."""

    def __init__(self, path: Path, answer: Answer) -> None:
        self.path = path
        self.answer = answer
        self.requests: list[bytes] = []
        self._loop = asyncio.get_running_loop()
        self._buffer = b""
        self._last_byte_s = 0.0
        self._master = self._slave = -1
        self._timers: list[asyncio.TimerHandle] = []
        self.request_seen = asyncio.Event()
        self.plug()

    def plug(self) -> None:
        """Make the pty and lead the symlink to it."""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._loop.add_reader(self._master, self._read)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(self._slave))

    @property
    def plugged(self) -> bool:
        """Whether the cable is in."""
        return self._master >= 0

    def unplug(self) -> None:
        """Pull the cable: the other side sees a hang-up."""
        for timer in self._timers:
            timer.cancel()
        self._loop.remove_reader(self._master)
        self.path.unlink(missing_ok=True)
        os.close(self._master)
        os.close(self._slave)
        self._master = -1

    def close(self) -> None:
        if self._master >= 0:
            self.unplug()

    def send(self, steps: Sequence[Step]) -> None:
        """Send the steps in order; numbers are pauses in seconds."""
        at_s = 0.0
        for step in steps:
            if isinstance(step, float):
                at_s += step
            elif at_s == 0.0:
                self._write(step)
            else:
                self._timers.append(self._loop.call_later(at_s, self._write, step))

    def _write(self, data: bytes) -> None:
        if self._master >= 0:
            os.write(self._master, data)

    def _read(self) -> None:
        now_s = self._loop.time()
        if now_s - self._last_byte_s > SILENCE_S:
            self._buffer = b""
        self._last_byte_s = now_s
        try:
            self._buffer += os.read(self._master, 4096)
        except OSError:
            return
        if len(self._buffer) >= 4 and crc(self._buffer[:-2]) == self._buffer[-2:]:
            request, self._buffer = self._buffer, b""
            self.requests.append(request)
            self.request_seen.set()
            self.send(self.answer(request))


def one_byte_at_a_time(steps: Sequence[Step]) -> list[Step]:
    """Send the same with a pause between all bytes."""
    out: list[Step] = []
    for step in steps:
        if isinstance(step, bytes):
            for byte in step:
                out += [bytes([byte]), 0.0005]
        else:
            out.append(step)
    return out
