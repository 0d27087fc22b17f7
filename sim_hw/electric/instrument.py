"""Instrument that speaks SCPI: works off messages, and knows the common commands (IEEE 488.2) and the error queue."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import ClassVar

from sim_hw.electric.scpi import (
    MISSING,
    NOT_ALLOWED,
    OUT_OF_RANGE,
    UNDEFINED_HEADER,
    ErrorQueue,
    ScpiError,
    Unit,
    number,
    pattern,
    units,
)

Handler = Callable[[Unit], Awaitable[str | None]]
Command = tuple[str, bool, Handler]
"""A header as manuals print it, whether it is a query, and what works it off."""


class Instrument:
    """What every SCPI instrument does; one kind of it adds its commands."""

    identity: ClassVar[str]

    def __init__(self) -> None:
        self._errors = ErrorQueue()
        self._enable = {"ESE": 0, "SRE": 0}
        self._table = [(pattern(header), query, handler) for header, query, handler in self.commands()]

    def commands(self) -> list[Command]:
        """Return all that it understands."""
        return [
            ("*IDN", True, self._identify), ("*RST", False, self._reset), ("*CLS", False, self._clear),
            ("*OPC", True, self._complete), ("*OPC", False, self._nothing), ("*WAI", False, self._nothing),
            ("*STB", True, self._status), ("*ESR", True, self._status), ("*TST", True, self._test),
            ("*ESE", False, self._set_enable), ("*SRE", False, self._set_enable),
            ("*ESE", True, self._enabled), ("*SRE", True, self._enabled),
            ("SYSTem:ERRor[:NEXT]", True, self._error), ("SYSTem:VERSion", True, self._version),
            ("SYSTem:REMote", False, self._nothing), ("SYSTem:LOCal", False, self._nothing),
        ]  # fmt: skip

    def power_up(self) -> None:
        """Be as at power-up; the error queue stays."""

    async def answer(self, message: str) -> str | None:
        """Work off one message; return its response without terminator, or None where nothing was asked."""
        answers = []
        for unit in units(message):
            try:
                said = await self.work_off(unit)
            except ScpiError as error:
                self._errors.put(error.entry)
                continue
            if said is not None:
                answers.append(said)
        return ";".join(answers) if answers else None

    async def work_off(self, unit: Unit) -> str | None:
        """Work off one unit of a message; raise ScpiError for what it does not know."""
        for header, query, handler in self._table:
            if unit.query == query and header.fullmatch(unit.header):
                return await handler(unit)
        raise ScpiError(UNDEFINED_HEADER)

    async def _identify(self, unit: Unit) -> str:
        """*IDN?."""
        no_parameter(unit)
        return self.identity

    async def _reset(self, unit: Unit) -> None:
        """*RST."""
        no_parameter(unit)
        self.power_up()

    async def _clear(self, unit: Unit) -> None:
        """*CLS."""
        no_parameter(unit)
        self._errors.clear()

    async def _complete(self, unit: Unit) -> str:
        """*OPC?: nothing overlaps."""
        no_parameter(unit)
        return "1"

    async def _nothing(self, unit: Unit) -> None:
        """*OPC, *WAI, SYSTem:REMote, SYSTem:LOCal."""
        no_parameter(unit)

    async def _status(self, unit: Unit) -> str:
        """*STB?, *ESR?: bit 2 of the status byte says that errors wait."""
        no_parameter(unit)
        return str(4 if unit.header == "*STB" and len(self._errors) else 0)

    async def _test(self, unit: Unit) -> str:
        """*TST?."""
        no_parameter(unit)
        return "0"

    async def _set_enable(self, unit: Unit) -> None:
        """*ESE, *SRE."""
        value = number(one_parameter(unit))
        if not 0 <= value <= 255:
            raise ScpiError(OUT_OF_RANGE)
        self._enable[unit.header[1:]] = int(value)

    async def _enabled(self, unit: Unit) -> str:
        """*ESE?, *SRE?."""
        no_parameter(unit)
        return str(self._enable[unit.header[1:]])

    async def _error(self, unit: Unit) -> str:
        """SYSTem:ERRor[:NEXT]?."""
        no_parameter(unit)
        return self._errors.take()

    async def _version(self, unit: Unit) -> str:
        """SYSTem:VERSion?."""
        no_parameter(unit)
        return "1999.0"


def no_parameter(unit: Unit) -> None:
    """Raise ScpiError where parameters are given."""
    if unit.parameters:
        raise ScpiError(NOT_ALLOWED)


def one_parameter(unit: Unit) -> str:
    """Return the one parameter; raise ScpiError."""
    if not unit.parameters:
        raise ScpiError(MISSING)
    if len(unit.parameters) > 1:
        raise ScpiError(NOT_ALLOWED)
    return unit.parameters[0]
