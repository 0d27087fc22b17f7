"""Measuring instrument: what it promises, and its settings. No I/O."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Literal, Protocol

from drivers.deadline import Deadline
from drivers.meter.identify import Identity

Unit = Literal["ohm", "V", "F"]
TERMINATORS: Mapping[str, str] = MappingProxyType({"lf": "\n", "crlf": "\r\n", "cr": "\r"})


@dataclass(frozen=True)
class Reading:
    """One value the instrument measured.

    `value` is in `unit`; an overload is infinite, with the sign the instrument gave it. `at_s` is when the answer was
    complete (CLOCK_MONOTONIC, seconds): what was measured had been so for the integration time before.
    """

    value: float
    unit: Unit
    overload: bool
    at_s: float


class Function(Enum):
    """What an instrument can measure."""

    RESISTANCE = "resistance"
    FRES = "fres"
    """Resistance by four wires."""
    CONTINUITY = "continuity"
    VOLTAGE = "voltage"
    DIODE = "diode"
    CAPACITANCE = "capacitance"


class Method(Enum):
    """What is asked about a point; each is measured by one function of the instrument."""

    CONTACT = "contact"
    """Does the needle stand on metal: between its own two wires, or against ground by capacitance."""
    CONTINUITY = "continuity"
    RESISTANCE = "resistance"
    FRES = "fres"
    VOLTAGE = "voltage"
    DIODE = "diode"
    CAPACITANCE = "capacitance"


DEFAULT_FUNCTIONS: Mapping[Method, Function] = MappingProxyType(
    {
        Method.CONTACT: Function.RESISTANCE,
        Method.CONTINUITY: Function.RESISTANCE,
        Method.RESISTANCE: Function.RESISTANCE,
        Method.FRES: Function.FRES,
        Method.VOLTAGE: Function.VOLTAGE,
        Method.DIODE: Function.DIODE,
        Method.CAPACITANCE: Function.CAPACITANCE,
    }
)
"""Continuity by ohms too: the continuity function of most instruments has one coarse range."""


@dataclass(frozen=True)
class MethodSettings:
    """How a method is measured."""

    function: Function
    range: float | None = None
    """Largest value expected, in the function's unit; None: the instrument chooses, which takes longer."""
    nplc: float | None = None
    """Integration time in cycles of the mains; None: the instrument's own."""
    commands: tuple[str, ...] = ()
    """Sent instead of what the function would send, for an instrument with other words."""
    read: str = "READ?"


@dataclass(frozen=True)
class TcpAddress:
    """A SCPI socket."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


@dataclass(frozen=True)
class SerialAddress:
    """A serial port."""

    port: str

    def __str__(self) -> str:
        return self.port


_HOST_PORT = re.compile(r"(?:\[(?P<six>[0-9A-Fa-f:.]+)\]|(?P<host>[A-Za-z0-9._-]+)):(?P<port>\d{1,5})")


def parse_address(text: str) -> TcpAddress | SerialAddress:
    """Return what an address means: "host:port", "[::1]:port", or the path of a serial port.

    Raises:
        ValueError: it is neither.

    """
    found = _HOST_PORT.fullmatch(text)
    if found and 0 < int(found["port"]) <= 65535:
        return TcpAddress(found["six"] or found["host"], int(found["port"]))
    if text.startswith("/"):
        return SerialAddress(text)
    raise ValueError(f"{text!r} is neither host:port (192.168.0.7:5025) nor a serial port (/dev/ttyUSB0)")


@dataclass(frozen=True)
class MeterSettings:
    """Everything an instrument is opened with."""

    address: TcpAddress | SerialAddress
    methods: Mapping[Method, MethodSettings]
    baudrate: int = 9600
    terminator: Literal["lf", "crlf", "cr"] = "lf"
    answer_s: float = 2.0
    """Longest wait for one answer."""
    setup: tuple[str, ...] = ()
    """Sent after each opening, such as SYST:REM for an instrument on a serial port."""
    model: str | None = None
    """Another instrument than this one is refused."""
    close_channels: str = "ROUT:CLOS (@{channels})"
    open_channels: str = "ROUT:OPEN:ALL"
    """Words of its scanner, which connects it to the pins of the harness."""


class Meter(Protocol):
    """An instrument that measures one value at a time.

    Everything raises MeterError (MeterTimeout, when it does not answer in time). After a failure or a cancel the next
    call begins by getting rid of what was left over: an answer that comes late is never taken for another question's.
    """

    @property
    def identity(self) -> Identity:
        """Who it said it is."""

    async def connect(self, channels: Sequence[int], deadline: Deadline) -> None:
        """Close these channels of the scanner and open all others."""

    async def prepare(self, method: Method, deadline: Deadline) -> None:
        """Set it up for a method, so that the next reading is a quick one."""

    async def measure(self, method: Method, deadline: Deadline) -> Reading:
        """Measure; sets it up first where it is set up for something else."""

    async def check(self, deadline: Deadline) -> None:
        """Raise unless it answers, and still is who it was."""

    async def close(self) -> None:
        """Let go of it."""
