"""Words of SCPI for what an instrument measures (SCPI-99 volume 2: CONFigure, SENSe:...:NPLCycles). Pure."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from drivers.meter.contract import Function, MethodSettings, Unit

_CONFIGURE: Mapping[Function, str] = MappingProxyType(
    {
        Function.RESISTANCE: "CONF:RES",
        Function.FRES: "CONF:FRES",
        Function.CONTINUITY: "CONF:CONT",
        Function.VOLTAGE: "CONF:VOLT:DC",
        Function.DIODE: "CONF:DIOD",
        Function.CAPACITANCE: "CONF:CAP",
    }
)
_INTEGRATE: Mapping[Function, str] = MappingProxyType(
    {Function.RESISTANCE: "RES:NPLC", Function.FRES: "FRES:NPLC", Function.VOLTAGE: "VOLT:DC:NPLC"}
)
"""Functions whose integration time can be set."""
WITHOUT_RANGE = frozenset({Function.CONTINUITY, Function.DIODE})
WITHOUT_NPLC = frozenset(Function) - frozenset(_INTEGRATE)
UNITS: Mapping[Function, Unit] = MappingProxyType(
    {
        Function.RESISTANCE: "ohm",
        Function.FRES: "ohm",
        Function.CONTINUITY: "ohm",
        Function.VOLTAGE: "V",
        Function.DIODE: "V",
        Function.CAPACITANCE: "F",
    }
)


def setup_commands(settings: MethodSettings) -> tuple[str, ...]:
    """Return what is sent once before readings of a method."""
    if settings.commands:
        return settings.commands
    configure = _CONFIGURE[settings.function]
    if settings.range is not None:
        configure += f" {settings.range:g}"
    if settings.nplc is None:
        return (configure,)
    return configure, f"{_INTEGRATE[settings.function]} {settings.nplc:g}"
