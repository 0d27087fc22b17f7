"""Two lamp rings on an LCUS type USB relay: four byte commands, no reply, no read-back."""

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Protocol, Self

import serial

from drivers.deadline import Deadline
from drivers.errors import LightError
from drivers.lights.contract import Light
from drivers.shielded import finish

_START = 0xA0
_CLOSE_S = 2.0
_WRITE_TIMEOUT_S = 0.5


def command(channel: int, *, on: bool) -> bytes:
    """Build the command for one channel: start, channel, state, sum of the three."""
    body = (_START, channel, int(on))
    return bytes((*body, sum(body) & 0xFF))


class SerialPort(Protocol):
    """What is used of a serial port."""

    def write(self, data: bytes, /) -> int | None:
        """Write bytes."""

    def flush(self) -> None:
        """Wait until they are out."""

    def close(self) -> None:
        """Close the port."""


class SerialRelayLights:
    """Lamps on a relay that says nothing: written twice over, off before on, so the rings never overlap.

    The port is used by one worker thread only. There is no read-back: a dead relay shows in the pictures only.
    """

    def __init__(self, port: SerialPort, white_channel: int = 1, red_channel: int = 2, settle_s: float = 0.05) -> None:
        if white_channel == red_channel:
            raise ValueError("white and red need a channel each")
        self._port = port
        self._channels = {Light.WHITE: white_channel, Light.RED: red_channel}
        self._settle_s = settle_s
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="lights")
        self._switching = asyncio.Lock()

    @classmethod
    async def open(
        cls,
        port: str,
        white_channel: int = 1,
        red_channel: int = 2,
        *,
        settle_s: float = 0.05,
        baudrate: int = 9600,
        deadline: Deadline,
    ) -> Self:
        """Open the port (8N1, exclusive) and go dark; raise LightError when it cannot be opened."""
        make: Callable[[], serial.Serial] = partial(
            serial.Serial, port, baudrate, write_timeout=_WRITE_TIMEOUT_S, exclusive=True
        )
        try:
            opened = await asyncio.to_thread(make)
        except (OSError, ValueError) as exc:
            raise LightError(f"cannot open {port}: {exc}", device="lights") from exc
        lights = cls(opened, white_channel, red_channel, settle_s)
        try:
            await lights.set(Light.OFF, deadline)
        except BaseException:
            await finish(lights._release())
            raise
        return lights

    @property
    def settle_s(self) -> float:
        """Time from a switch until the light is steady."""
        return self._settle_s

    async def set(self, light: Light, deadline: Deadline) -> float:
        """Switch the other ring off, then this one on, each time anew; raise LightError when the bytes do not go out.

        Returns when they were out: nobody tells whether the lamp shone before.
        """
        off = [command(channel, on=False) for ring, channel in self._channels.items() if ring is not light]
        on = [command(self._channels[light], on=True)] if light in self._channels else []
        async with self._switching:
            try:
                # The bytes go out whole or not at all, even if the caller is cancelled meanwhile
                sending = asyncio.get_running_loop().run_in_executor(self._worker, self._send, off + on)
                async with asyncio.timeout(deadline.remaining_s):
                    await asyncio.shield(sending)
            except TimeoutError as exc:
                raise LightError(f"switching to {light.value} took too long", device="lights") from exc
            except (OSError, RuntimeError) as exc:
                raise LightError(f"cannot switch to {light.value}: {exc}", device="lights") from exc
            return time.monotonic()

    async def check(self, deadline: Deadline) -> None:
        """Do nothing: this relay cannot be asked; the picture tells."""

    def _send(self, commands: list[bytes]) -> None:
        for data in commands:
            self._port.write(data)
        self._port.flush()

    async def close(self) -> None:
        """Go dark and close the port, also when the caller is cancelled."""
        await finish(self._close())

    async def _close(self) -> None:
        try:
            await self.set(Light.OFF, Deadline.after(_CLOSE_S))
        finally:
            await self._release()

    async def _release(self) -> None:
        await asyncio.get_running_loop().run_in_executor(self._worker, self._port.close)
        self._worker.shutdown(wait=False)
