"""Simulated meter: a SCPI instrument with a scanner, whose leads are the needle and the harness.

It works off one message after another; a reading takes its integration time. What is NOT modelled: triggers other than
immediate, several readings at once, memory, status registers beyond what IEEE 488.2 asks for, a front panel.
"""

from __future__ import annotations

import random
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from sim_hw.electric.dialect import FOREIGN, TERSE, is_foreign, terse
from sim_hw.electric.functions import DIODE_V, FUNCTIONS, OVERLOAD, Function, Leads
from sim_hw.electric.instrument import Command, Instrument, no_parameter, one_parameter
from sim_hw.electric.scpi import (
    NOT_ALLOWED,
    OUT_OF_RANGE,
    STALE,
    UNDEFINED_HEADER,
    ScpiError,
    Unit,
    channel_list,
    number,
)
from sim_hw.plant.faults import Faults
from sim_hw.plant.knobs import Knobs

IDENTITY = "Simulated Instruments,SIM-6500,0001,1.0"
_NPLC = (0.02, 0.2, 1.0, 10.0, 100.0)
_STUCK_AT = {"zero": f"{0.0:+.8E}", "overload": f"{OVERLOAD:+.8E}"}
_MAINS_S = 0.02
_SETTLE_S = 0.003

Note = Callable[[float, str, Mapping[str, object]], None]


@dataclass(frozen=True)
class Time:
    """The meter's clock: simulated seconds, and how to wait until one of them."""

    now_s: Callable[[], float]
    until: Callable[[float], Awaitable[None]]


@dataclass
class _State:
    function: str = "VOLT"
    ranges: dict[str, float | None] = field(default_factory=dict)
    nplc: dict[str, float] = field(default_factory=dict)
    last: str | None = None


class Meter(Instrument):
    """One instrument."""

    identity = IDENTITY

    def __init__(
        self, leads: Leads, time: Time, faults: Faults, knobs: Callable[[], Knobs], note: Note, seed: int
    ) -> None:
        self._leads, self._time, self._faults, self._knobs, self._note = leads, time, faults, knobs, note
        self._rng = random.Random(f"{seed}/meter")
        self._state = _State()
        self._stuck: str | None = None
        self.channels: tuple[int, ...] = ()
        """Channels of the scanner that are closed."""
        super().__init__()

    def commands(self) -> list[Command]:
        """Return all that it understands."""
        found: list[Command] = [
            *super().commands(),
            ("CONFigure", True, self._configured),
            ("ROUTe:CLOSe", False, self._close_channels), ("ROUTe:CLOSe", True, self._closed),
            ("ROUTe:OPEN", False, self._open_channels), ("ROUTe:OPEN:ALL", False, self._open_all),
            ("READ", True, self._read), ("INITiate[:IMMediate]", False, self._initiate), ("FETCh", True, self._fetch),
        ]  # fmt: skip
        for name, function in FUNCTIONS.items():
            found.append((f"CONFigure:{function.header}", False, partial(self._configure, name)))
            found.append((f"MEASure:{function.header}", True, partial(self._measure, name)))
            if not function.fixed:
                found.append((f"[SENSe:]{function.header}:RANGe", False, partial(self._set_range, name)))
            if function.has_nplc:
                found.append((f"[SENSe:]{function.header}:NPLCycles", False, partial(self._set_nplc, name)))
                found.append((f"[SENSe:]{function.header}:NPLCycles", True, partial(self._nplc, name)))
        return found

    def power_up(self) -> None:
        """Be as at power-up, the scanner open."""
        self._state = _State()
        self.channels = ()

    async def work_off(self, unit: Unit) -> str | None:
        """Work off one unit, in the dialect it speaks today."""
        if self._faults.hits("meter_dialect", "dialect", FOREIGN) and is_foreign(unit.header):
            raise ScpiError(UNDEFINED_HEADER)
        said = await super().work_off(unit)
        return terse(said) if said is not None and self._faults.hits("meter_dialect", "dialect", TERSE) else said

    # ------------------------------------------------------------------ set-up

    async def _configure(self, name: str, unit: Unit) -> None:
        """CONFigure:FUNCTION [range][,resolution]."""
        function = FUNCTIONS[name]
        if len(unit.parameters) > (0 if function.fixed else 2):
            raise ScpiError(NOT_ALLOWED)
        self._state.ranges[name] = _range(function, unit.parameters[0]) if unit.parameters else None
        self._state.function = name
        self._state.last = None

    async def _configured(self, unit: Unit) -> str:
        """CONFigure?."""
        no_parameter(unit)
        name = self._state.function
        range_ = self._state.ranges.get(name)
        return f'"{name} {"AUTO" if range_ is None else f"{range_:+.8E}"}"'

    async def _set_range(self, name: str, unit: Unit) -> None:
        """[SENSe:]FUNCTION:RANGe."""
        self._state.ranges[name] = _range(FUNCTIONS[name], one_parameter(unit))

    async def _set_nplc(self, name: str, unit: Unit) -> None:
        """[SENSe:]FUNCTION:NPLCycles: the next longer time there is."""
        text = one_parameter(unit).upper()
        value = {"MIN": _NPLC[0], "MAX": _NPLC[-1], "DEF": 1.0}.get(text) or number(text)
        if not 0.0 < value <= _NPLC[-1]:
            raise ScpiError(OUT_OF_RANGE)
        self._state.nplc[name] = next(one for one in _NPLC if value <= one)

    async def _nplc(self, name: str, unit: Unit) -> str:
        """[SENSe:]FUNCTION:NPLCycles?."""
        no_parameter(unit)
        return f"{self._state.nplc.get(name, 1.0):+.8E}"

    # ------------------------------------------------------------------ scanner

    async def _close_channels(self, unit: Unit) -> None:
        """ROUTe:CLOSe (@list): these too."""
        self.channels = tuple(sorted({*self.channels, *channel_list(one_parameter(unit))}))

    async def _open_channels(self, unit: Unit) -> None:
        """ROUTe:OPEN (@list)."""
        self.channels = tuple(sorted({*self.channels} - {*channel_list(one_parameter(unit))}))

    async def _open_all(self, unit: Unit) -> None:
        """ROUTe:OPEN:ALL."""
        no_parameter(unit)
        self.channels = ()

    async def _closed(self, unit: Unit) -> str:
        """ROUTe:CLOSe?."""
        no_parameter(unit)
        return f"(@{','.join(map(str, self.channels))})"

    @property
    def _truly_closed(self) -> Sequence[int]:
        """Return the channels that are closed, with the one that opens no more: the instrument does not know of it."""
        welded = {int(self._faults.get("relay_welded")["channel"])} if self._faults.on("relay_welded") else set()
        return tuple(sorted({*self.channels} | welded))

    # ------------------------------------------------------------------ readings

    async def _read(self, unit: Unit) -> str:
        """READ?."""
        no_parameter(unit)
        return await self._reading()

    async def _initiate(self, unit: Unit) -> None:
        """INITiate[:IMMediate]: measure, and keep it for FETCh?."""
        no_parameter(unit)
        await self._reading()

    async def _fetch(self, unit: Unit) -> str:
        """FETCh?."""
        no_parameter(unit)
        if self._state.last is None:
            raise ScpiError(STALE)
        return self._state.last

    async def _measure(self, name: str, unit: Unit) -> str:
        """MEASure:FUNCTION?: configure and read."""
        await self._configure(name, unit)
        return await self._reading()

    async def _reading(self) -> str:
        name = self._state.function
        function, nplc = FUNCTIONS[name], self._state.nplc.get(name, 1.0)
        range_ = function.fixed or self._state.ranges.get(name)
        begun_s = self._time.now_s()
        # Looking for a range takes one more measurement.
        done_s = begun_s + _SETTLE_S + _MAINS_S * (nplc if range_ is not None else 2.0 * nplc)
        await self._time.until(done_s)
        delay_s = float(self._faults.get("meter_slow")["delay_s"])
        if self._faults.use("meter_slow"):
            await self._time.until(done_s + delay_s)
        true = self._true(name, function, begun_s, done_s)
        said = function.said(true, range_, nplc, self._rng)
        text = f"{said:+.8E}"
        if self._faults.on("meter_stuck"):
            self._stuck = _STUCK_AT.get(self._faults.get("meter_stuck")["at"]) or self._stuck or text
            text = self._stuck
        else:
            self._stuck = text
        self._state.last = text
        facts = {"function": name, "channels": list(self._truly_closed), "begun_s": begun_s}
        known = {"true": true if abs(true) < OVERLOAD else None, "said": None if said >= OVERLOAD else said}
        self._note(done_s, "read", {**facts, **known, "answer": text})
        return text

    def _true(self, name: str, function: Function, begun_s: float, done_s: float) -> float:
        """Return what is there: an open pair of leads unless the contact held all the time."""
        volts = DIODE_V if name == "DIOD" else self._knobs().meter_open_v if function.wets else 0.0
        self._leads.apply_voltage(volts, done_s)
        channels = self._truly_closed
        if self._leads.steady_since_s(done_s) > begun_s and function.through:
            return float("inf")
        return function.true(self._leads, channels, self._knobs().meter_lead_ohm, done_s)


def _range(function: Function, text: str) -> float | None:
    word = text.upper()
    if word in ("AUTO", "DEF", "DEFAULT"):
        return None
    if word in ("MIN", "MAX", "MINIMUM", "MAXIMUM"):
        return function.ranges[0 if word.startswith("MIN") else -1]
    value = number(text, unit=function.unit)
    range_ = function.range_for(value)
    if range_ is None or value < 0.0:
        raise ScpiError(OUT_OF_RANGE)
    return range_
