"""The measuring instrument: what it reads between the needle and what it is connected to."""

from drivers.meter.contract import (
    DEFAULT_FUNCTIONS,
    Function,
    Meter,
    MeterSettings,
    Method,
    MethodSettings,
    Reading,
    SerialAddress,
    TcpAddress,
    parse_address,
)
from drivers.meter.functions import WITHOUT_NPLC, WITHOUT_RANGE
from drivers.meter.identify import Identity, parse_identity
from drivers.meter.scpi import ScpiMeter

__all__ = [
    "DEFAULT_FUNCTIONS",
    "WITHOUT_NPLC",
    "WITHOUT_RANGE",
    "Function",
    "Identity",
    "Meter",
    "MeterSettings",
    "Method",
    "MethodSettings",
    "Reading",
    "ScpiMeter",
    "SerialAddress",
    "TcpAddress",
    "parse_address",
    "parse_identity",
]
