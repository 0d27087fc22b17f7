"""Functions of the simulated meter: what each measures, its ranges, and how true what it says is."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

from sim_hw.electric.press import PIN_OHM

OVERLOAD = 9.9e37
_OVER_RANGE = 1.2
"""A range is good for 20 % more than its name."""
_LEAKING_OHM = 1e5
"""No capacitance can be measured past this."""
_NOISE = 2e-5
"""Of the range, one sigma at one cycle of the mains."""
DIODE_V = 5.0


class Leads(Protocol):
    """What the meter's leads are connected to."""

    def ohms(self, channels: Sequence[int], t_s: float) -> float:
        """Return the resistance from the pin's wire to the closed channels, leads not counted."""

    def farads(self, channels: Sequence[int], t_s: float) -> float:
        """Return the capacitance from the needle to the closed channels."""

    def diode_v(self, channels: Sequence[int], t_s: float) -> float:
        """Return the voltage that the diode test's current needs."""

    def apply_voltage(self, volts: float, t_s: float) -> None:
        """Put a voltage across the needle's contact."""

    def steady_since_s(self, t_s: float) -> float:
        """Return since when the needle has been in contact without a break."""


@dataclass(frozen=True)
class Function:
    """One function: header as manuals print it, unit of its parameters, ranges, and its quantity."""

    header: str
    unit: str
    ranges: tuple[float, ...]
    true: Callable[[Leads, Sequence[int], float, float], float]
    has_nplc: bool = False
    fixed: float | None = None
    """The one range of a function that has no other."""
    wets: bool = False
    """Its open-circuit voltage is put across the contact."""
    through: bool = False
    """A current has to flow all the while; without one its leads are open."""

    def range_for(self, value: float) -> float | None:
        """Return the lowest range for a value asked for; None: too large."""
        return next((one for one in self.ranges if abs(value) <= one * (1 + 1e-9)), None)

    def said(self, true: float, range_: float | None, nplc: float, rng: random.Random) -> float:
        """Return what the meter says of a true value, in a range or, without one, in the best."""
        within = range_ or next((one for one in self.ranges if abs(true) <= one * _OVER_RANGE), self.ranges[-1])
        if not abs(true) <= within * _OVER_RANGE:
            return OVERLOAD
        value = true + rng.gauss(0.0, 1.0) * within * _NOISE / math.sqrt(nplc)
        step = within * 1e-6
        return round(value / step) * step


def _two_wires(leads: Leads, channels: Sequence[int], lead_ohm: float, t_s: float) -> float:
    return leads.ohms(channels, t_s) + lead_ohm


def _four_wires(leads: Leads, channels: Sequence[int], _lead_ohm: float, t_s: float) -> float:
    """Measure from where the sense wires meet the others, at the pin: neither leads nor the pin itself count."""
    return leads.ohms(channels, t_s) - PIN_OHM


def _capacitance(leads: Leads, channels: Sequence[int], _lead_ohm: float, t_s: float) -> float:
    return math.inf if leads.ohms(channels, t_s) < _LEAKING_OHM else leads.farads(channels, t_s)


def _diode(leads: Leads, channels: Sequence[int], _lead_ohm: float, t_s: float) -> float:
    return leads.diode_v(channels, t_s)


def _voltage(_leads: Leads, _channels: Sequence[int], _lead_ohm: float, _t_s: float) -> float:
    """Return nothing: no board is powered."""
    return 0.0


_OHMS = (1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8)
FUNCTIONS: Mapping[str, Function] = MappingProxyType(
    {
        "RES": Function("RESistance", "OHM", _OHMS, _two_wires, has_nplc=True, wets=True, through=True),
        "FRES": Function("FRESistance", "OHM", _OHMS, _four_wires, has_nplc=True, wets=True, through=True),
        "CONT": Function("CONTinuity", "OHM", (1e3,), _two_wires, fixed=1e3, wets=True, through=True),
        "VOLT": Function("VOLTage[:DC]", "V", (0.1, 1.0, 10.0, 100.0, 1000.0), _voltage, has_nplc=True),
        "DIOD": Function("DIODe", "V", (DIODE_V,), _diode, fixed=DIODE_V, through=True),
        "CAP": Function("CAPacitance", "F", (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4), _capacitance),
    }
)
