"""SCPI instrument over TCP or a serial port: who it is, its set-ups, its error queue, its readings.

A connection that was lost is opened again with the next call, and what had been set up is set up again.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Sequence
from typing import Self

import structlog

from drivers.deadline import Deadline
from drivers.errors import MeterError, MeterTimeout, MeterTrouble
from drivers.meter.answers import QueuedError, parse_error, parse_reading, shown
from drivers.meter.contract import MeterSettings, Method, Reading
from drivers.meter.dialogue import WHO, Dialogue
from drivers.meter.functions import UNITS, setup_commands
from drivers.meter.identify import Identity

_LONGEST_QUEUE = 40
"""Entries of an error queue that are believed to be one."""
_UNDEFINED = range(-199, -99)
"""SCPI's "command errors": the instrument does not know the words."""


class ScpiMeter:
    """One instrument. Belongs to one event loop; calls wait for each other."""

    def __init__(self, settings: MeterSettings) -> None:
        self._settings = settings
        self._dialogue = Dialogue(settings)
        self._identity: Identity | None = None
        self._prepared: Method | None = None
        self._connected: tuple[int, ...] | None = None
        self._asking = asyncio.Lock()
        self._log = structlog.get_logger().bind(device=f"meter {settings.address}")

    @classmethod
    async def open(cls, settings: MeterSettings, deadline: Deadline) -> Self:
        """Connect, ask who it is, and set it to a known state; raise MeterError when that cannot be."""
        meter = cls(settings)
        try:
            async with meter._turn(deadline):
                pass
        except BaseException:
            await meter.close()
            raise
        return meter

    @property
    def identity(self) -> Identity:
        """Who it said it is."""
        if self._identity is None:
            raise MeterError("has not been opened", MeterTrouble.LOST)
        return self._identity

    async def connect(self, channels: Sequence[int], deadline: Deadline) -> None:
        """Close these channels of the scanner and open all others."""
        async with self._turn(deadline):
            if self._connected == tuple(channels):
                return
            self._connected = None
            self._dialogue.tell(self._settings.open_channels)
            if channels:
                self._dialogue.tell(self._settings.close_channels.format(channels=",".join(map(str, channels))))
            await self._confirm(deadline, "its scanner")
            self._connected = tuple(channels)

    async def prepare(self, method: Method, deadline: Deadline) -> None:
        """Set it up for a method, so that the next reading is a quick one."""
        async with self._turn(deadline):
            await self._set_up(method, deadline)

    async def measure(self, method: Method, deadline: Deadline) -> Reading:
        """Measure; sets it up first where it is set up for something else."""
        async with self._turn(deadline):
            await self._set_up(method, deadline)
            settings = self._settings.methods[method]
            text = await self._dialogue.ask(settings.read, deadline)
            try:
                return parse_reading(text, UNITS[settings.function], time.monotonic())
            except MeterError as exc:
                if exc.trouble is not MeterTrouble.INVALID:
                    self._dialogue.lose_step()
                raise

    async def check(self, deadline: Deadline) -> None:
        """Raise unless it answers, and still is who it was."""
        async with self._turn(deadline):
            text = await self._dialogue.ask(WHO, deadline)
            if text != self.identity.text:
                self._dialogue.lose_step()
                raise MeterError(f"was {self.identity} and now answers {shown(text)}", MeterTrouble.OTHER)

    async def close(self) -> None:
        """Let go of it."""
        self._dialogue.hang_up()

    @contextlib.asynccontextmanager
    async def _turn(self, deadline: Deadline) -> AsyncIterator[None]:
        """Hold the instrument, connected and in step."""
        try:
            async with asyncio.timeout(deadline.remaining_s):
                await self._asking.acquire()
        except TimeoutError as exc:
            raise MeterTimeout("is still busy with another question", MeterTrouble.SLOW) from exc
        try:
            if not self._dialogue.open:
                await self._introduce(deadline)
            elif not self._dialogue.in_step:
                # What had been sent before may have been lost with its answer.
                self._prepared = self._connected = None
                await self._dialogue.get_in_step(deadline)
                self._dialogue.tell("*CLS")
            yield
        finally:
            self._asking.release()

    async def _introduce(self, deadline: Deadline) -> None:
        """Connect, learn who it is, and bring it into a known state."""
        self._prepared = self._connected = None
        await self._dialogue.connect(deadline)
        try:
            self._dialogue.tell("*CLS")
            self._identity = self._expected(await self._dialogue.ask_who(deadline))
            # Before the reset, which may need it (SYST:REM); after it, for a reset undoes it.
            for command in (*self._settings.setup, "*RST", "*CLS", *self._settings.setup):
                self._dialogue.tell(command)
            await self._confirm(deadline, "its set-up")
        except BaseException:
            self._dialogue.hang_up()
            raise
        self._log.info("meter.open", identity=self._identity.text)

    def _expected(self, identity: Identity) -> Identity:
        """Return who it is, unless another one is wanted or was there before."""
        model = self._settings.model
        if model is not None and model.lower() not in identity.text.lower():
            raise MeterError(f"is {identity}, not the {model} that is configured", MeterTrouble.OTHER)
        if self._identity is not None and identity != self._identity:
            raise MeterError(f"was {self._identity.text} and now is {identity.text}", MeterTrouble.OTHER)
        return identity

    async def _set_up(self, method: Method, deadline: Deadline) -> None:
        if self._prepared is method:
            return
        self._prepared = None
        settings = self._settings.methods.get(method)
        if settings is None:
            raise MeterError(f"has no set-up for {method.value}", MeterTrouble.DIALECT)
        for command in setup_commands(settings):
            self._dialogue.tell(command)
        await self._confirm(deadline, method.value)
        self._prepared = method

    async def _confirm(self, deadline: Deadline, what: str) -> None:
        """Read the error queue empty; raise its first entry, which is the cause of those that follow."""
        first: QueuedError | None = None
        for _ in range(_LONGEST_QUEUE):
            text = await self._dialogue.ask("SYST:ERR?", deadline)
            entry = parse_error(text)
            if entry is None:
                self._dialogue.lose_step()
                raise MeterError(f"answers {shown(text)} when asked for its errors", MeterTrouble.GARBAGE)
            if entry.code == 0:
                break
            first = first or entry
        if first is not None:
            unknown = "does not know the commands for" if first.code in _UNDEFINED else "refuses"
            text = f"{unknown} {what}: {first.code}, {shown(first.text)}"
            raise MeterError(text, MeterTrouble.DIALECT, code=first.code)
