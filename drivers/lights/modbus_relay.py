"""Two lamp rings on a Modbus relay board (coils, as on an 8 channel RTU relay)."""

import asyncio
import math
import time
from typing import Self

from drivers.bus import ModbusBus
from drivers.deadline import Deadline
from drivers.errors import DeadlinePassed, DeviceError, LightError
from drivers.lights.contract import Light
from drivers.shielded import finish

# Time given to going dark when closing
_CLOSE_S = 2.0
# A lamp that was read back so short a time ago is not asked again: one look and the step after it are as long
FRESH_S = 0.25


class ModbusRelayLights:
    """Switches both rings with one FC 15 write, so they never overlap, and reads the coils back (FC 1)."""

    def __init__(
        self, bus: ModbusBus, address: int, white_coil: int = 0, red_coil: int = 1, settle_s: float = 0.05
    ) -> None:
        if abs(white_coil - red_coil) != 1:
            raise ValueError("the two rings must sit on neighbouring coils to be switched by one request")
        self._bus = bus
        self._address = address
        self._first = min(white_coil, red_coil)
        self._white_first = white_coil < red_coil
        self._settle_s = settle_s
        self._switching = asyncio.Lock()
        self._told: tuple[Light, tuple[bool, bool]] | None = None
        self._switched_s, self._confirmed_s = 0.0, -math.inf
        bus.label(address, "lights")

    @classmethod
    async def open(
        cls,
        bus: ModbusBus,
        address: int,
        white_coil: int = 0,
        red_coil: int = 1,
        *,
        settle_s: float = 0.05,
        deadline: Deadline,
    ) -> Self:
        """Make the lights and go dark: the relay's state is unknown before."""
        lights = cls(bus, address, white_coil, red_coil, settle_s)
        await lights.set(Light.OFF, deadline)
        return lights

    @property
    def settle_s(self) -> float:
        """Time from a switch until the light is steady (relay contact, lamp and driver)."""
        return self._settle_s

    async def set(self, light: Light, deadline: Deadline) -> float:
        """Switch by levels and read back; return when the board had it; raise LightError when it shows something else.

        A lamp that was switched on before and confirmed is only read back, and not even that where it was confirmed a
        moment ago. Going dark is written again, unless it was confirmed just now: a contact that stuck may have come
        free since.
        """
        wanted = (light is Light.WHITE, light is Light.RED)
        coils = wanted if self._white_first else wanted[::-1]
        async with self._switching:
            try:
                told = self._told == (light, coils)
                fresh = time.monotonic() - self._confirmed_s < FRESH_S
                if told and (fresh or (light is not Light.OFF and await self._coils(deadline) == coils)):
                    return self._switched_s
                # Until the board has confirmed it, nothing is known of it.
                self._told = None
                await self._bus.write_coils(self._address, self._first, coils, deadline)
                self._switched_s = time.monotonic()
                seen = await self._coils(deadline)
            except DeviceError as exc:
                raise _failed(f"cannot switch to {light.value}", exc) from exc
            if seen != coils:
                text = f"was told {light.value}, but its relay does not switch"
                raise LightError(text, device="lights", technical=self._read(seen))
            self._told, self._confirmed_s = (light, coils), time.monotonic()
            return self._switched_s

    async def check(self, deadline: Deadline) -> None:
        """Read the coils back; raise LightError when somebody else, or a reset of the board, has switched them.

        Raises DeadlinePassed where the time was too short to ask.
        """
        async with self._switching:
            if self._told is None:
                return
            light, coils = self._told
            self._confirmed_s = -math.inf  # whatever comes of it, the next to switch asks the board itself
            try:
                seen = await self._coils(deadline)
            except DeadlinePassed:
                raise  # it says nothing about the board
            except DeviceError as exc:
                raise _failed("does not tell its state", exc) from exc
        if seen != coils:
            text = f"was told {light.value}, but by now its relay stands otherwise"
            raise LightError(text, device="lights", technical=self._read(seen))

    def _read(self, seen: tuple[bool, ...]) -> str:
        return f"the coils from {self._first} read {seen}"

    async def _coils(self, deadline: Deadline) -> tuple[bool, ...]:
        return await self._bus.read_coils(self._address, self._first, 2, deadline)

    async def close(self) -> None:
        """Go dark, also when the caller is cancelled; the bus stays open for its other slaves."""
        await finish(self.set(Light.OFF, Deadline.after(_CLOSE_S)))


def _failed(what: str, cause: DeviceError) -> LightError:
    """Return the lamps' error that stands for the bus' own."""
    failed = LightError(f"{what}: {cause.in_words}", device="lights", advice=cause.advice, technical=cause.technical)
    failed.exception = cause.exception
    return failed
