"""RTU line: one pseudo-terminal that carries every slave.

Paced, it behaves in time like 115200 baud: a request takes its bytes' time to arrive, ends after 3.5 characters of
silence, is thought about, and the reply takes its time too. Unpaced, a request is served as soon as it is whole.
What is NOT modelled: parity, a wrong baud rate of the client, collisions byte by byte.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from sim_hw.bus.modbus import Slave, answer, intact, request_length, seal
from sim_hw.linked_pty import LinkedPty
from sim_hw.plant.clock import SimClock
from sim_hw.plant.faults import Faults
from sim_hw.plant.knobs import Knobs

CHARACTER_S = 11.0 / 115_200.0
"""8N1 at 115200 baud; the planning figures count 11 bits a character."""
T35_S = 0.00175
"""Silence that ends a frame; fixed above 19200 baud (Modbus over serial line, 2.5.1.1)."""
_STALE_S = 0.02
"""Unpaced, what is not whole after so long is thrown away."""


@dataclass
class LineStatistics:
    """Count what happened on the line."""

    requests: int = 0
    replies: int = 0
    garbled: int = 0
    """Frames with a wrong CRC or no end."""
    early: int = 0
    """Requests lost because they came too soon after a reply."""
    collided: int = 0
    """Bytes lost because they came while a request was being served."""


@dataclass
class _Receiver:
    buffer: bytearray = field(default_factory=bytearray)
    first_wall_s: float = 0.0
    full_wall_s: float = 0.0
    timer: asyncio.TimerHandle | None = None


class Line:
    """Serve the slaves on a pty whose path is also reachable through a symlink."""

    def __init__(
        self,
        slaves: Mapping[int, Slave],
        clock: SimClock,
        faults: Faults,
        knobs: Callable[[], Knobs],
        *,
        seed: int,
        paced: bool,
    ) -> None:
        self._slaves = slaves
        self._clock = clock
        self._faults = faults
        self._knobs = knobs
        self._rng = random.Random(f"{seed}/line")
        self._paced = paced
        self._receiver = _Receiver()
        self._serving = False
        self._last_reply_wall_s = float("-inf")
        self._terminal: LinkedPty | None = None
        self.statistics = LineStatistics()
        self.pty = ""

    def open(self, link: Path) -> None:
        """Make the pty and its symlink and start serving on the running loop.

        Raises:
            OSError: no pty is left, or the symlink cannot be made.

        """
        self._terminal = terminal = LinkedPty(link, "line")
        self.pty = terminal.path
        asyncio.get_running_loop().add_reader(terminal, self._readable, terminal)

    def close(self) -> None:
        """Stop serving; remove the symlink if it still is ours."""
        if self._terminal is None:
            return
        asyncio.get_running_loop().remove_reader(self._terminal)
        if self._receiver.timer is not None:
            self._receiver.timer.cancel()
        self._terminal.close()
        self._terminal = None

    # --- requests

    def _readable(self, terminal: LinkedPty) -> None:
        try:
            data = terminal.read(4096)
        except (BlockingIOError, InterruptedError):
            return
        if self._serving:
            self.statistics.collided += len(data)
            return
        now_s, receiver = time.monotonic(), self._receiver
        if not receiver.buffer:
            receiver.first_wall_s = receiver.full_wall_s = now_s
        receiver.buffer += data
        if receiver.timer is not None:
            receiver.timer.cancel()
        if self._paced:
            arriving_s = self._clock.wall_delay(len(data) * CHARACTER_S)
            receiver.full_wall_s = max(now_s, receiver.full_wall_s) + arriving_s
            silent_s = receiver.full_wall_s + self._clock.wall_delay(T35_S)
            receiver.timer = _at(silent_s, self._silence)
        elif not self._take_whole():
            receiver.timer = _at(now_s + _STALE_S, self._silence)

    def _take_whole(self) -> bool:
        """Serve the whole requests at the buffer's head; tell whether nothing is left."""
        buffer = self._receiver.buffer
        while (length := request_length(bytes(buffer))) is not None and len(buffer) >= length:
            frame = bytes(buffer[:length])
            if not intact(frame):
                break
            del buffer[:length]
            self._receive(frame)
        return not buffer

    def _silence(self) -> None:
        frame = bytes(self._receiver.buffer)
        self._receiver.buffer.clear()
        self._receiver.timer = None
        self._receive(frame)

    def _receive(self, frame: bytes) -> None:
        if self._faults.on("cable_out"):
            return
        if not intact(frame):
            self.statistics.garbled += 1
            return
        gap_s = self._clock.wall_delay(self._knobs().bus_gap_ms / 1000.0)
        if self._paced and self._receiver.first_wall_s - self._last_reply_wall_s < gap_s:
            self.statistics.early += 1
            return
        self.statistics.requests += 1
        if not self._paced:
            self._serve(frame)
            return
        self._serving = True
        knobs = self._knobs()
        think_s = self._rng.uniform(knobs.think_min_ms, knobs.think_max_ms) / 1000.0
        _at(time.monotonic() + self._clock.wall_delay(think_s), lambda: self._serve(frame))

    # --- replies

    def _serve(self, frame: bytes) -> None:
        """Let the addressed slave act, now, and send what it says."""
        self._serving = False
        reply = self._reply(frame)
        if reply is None:
            return
        if self._faults.on("late_replies") and self._chance("late_replies"):
            delay_s = float(self._faults.get("late_replies")["delay_s"])
            if self._faults.use("late_replies"):
                _at(time.monotonic() + self._clock.wall_delay(delay_s), lambda: self._send(reply))
                return
        if not self._paced:
            self._send(reply)
            return
        self._serving = True
        _at(time.monotonic() + self._clock.wall_delay(len(reply) * CHARACTER_S), lambda: self._send(reply))

    def _reply(self, frame: bytes) -> bytes | None:
        address, t_s = frame[0], self._clock.now_s()
        if address == 0:
            for slave in self._slaves.values():
                answer(slave, frame, t_s)
            return None
        if address not in self._slaves or self._absent(address):
            return None
        refused = self._refused(address)
        if refused is not None:
            return seal(bytes([address, frame[1] | 0x80, refused]))
        return answer(self._slaves[address], frame, t_s)

    def _absent(self, address: int) -> bool:
        fault = self._faults.get("absent_slave")
        return self._faults.on("absent_slave") and fault["address"] == address and self._faults.use("absent_slave")

    def _refused(self, address: int) -> int | None:
        """Return the exception code with which the `exceptions` fault answers for an address, or None."""
        fault = self._faults.get("exceptions")
        if not self._faults.on("exceptions") or fault["address"] not in (0, address) or not self._chance("exceptions"):
            return None
        self._faults.use("exceptions")
        return int(fault["code"])

    def _send(self, reply: bytes) -> None:
        self._serving = False
        if self._terminal is None or self._faults.on("cable_out"):
            return
        if self._faults.on("crc_noise") and self._chance("crc_noise") and self._faults.use("crc_noise"):
            bit = self._rng.randrange(8 * len(reply))
            noisy = bytearray(reply)
            noisy[bit // 8] ^= 1 << bit % 8
            reply = bytes(noisy)
        self._last_reply_wall_s = time.monotonic()
        self.statistics.replies += 1
        # A client that never reads loses bytes, as on a wire.
        with contextlib.suppress(BlockingIOError):
            self._terminal.write(reply)

    def _chance(self, name: str) -> bool:
        return self._rng.random() < float(self._faults.get(name)["rate"])


def _at(wall_s: float, call: Callable[[], None]) -> asyncio.TimerHandle:
    """Call at a CLOCK_MONOTONIC time, which is the loop's clock."""
    loop = asyncio.get_running_loop()
    return loop.call_later(max(0.0, wall_s - time.monotonic()), call)
