"""Faults: what can be broken from outside, and whether it is broken now.

A fault is a flag with parameters. Its owner enforces it: the line reads `cable_out`, the drives read
`stall`, the camera reads `frozen`, and so on. Any fault may carry `count`: it then clears itself after that many uses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

_AXES = ("x", "y", "z", "theta", "all")

DEFAULTS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        # line
        "cable_out": {},
        "crc_noise": {"rate": 1.0},
        "late_replies": {"delay_s": 0.5, "rate": 1.0},
        "exceptions": {"code": 4, "address": 0, "rate": 1.0},
        "absent_slave": {"address": 1},
        # drives
        "stall": {"axis": "x", "detected": False},
        "limit": {"axis": "x", "side": "both"},
        "estop": {},
        "slip": {"axis": "x", "um": 300.0},
        # lights
        "dead_lamp": {"lamp": "white"},
        "relay_stuck": {},
        # camera
        "frozen": {},
        "black": {},
        "torn": {},
        "silent": {},
        "unplugged": {},
        "mirrored": {},
        "glint": {"px": 5.0},
        # board
        "board_displaced": {"dx_um": 0.0, "dy_um": 0.0, "turn_deg": 0.0},
        "board_turned": {"turn_deg": 180.0},
        "board_gone": {},
        # control-point card
        "card_gone": {},
        "card_covered": {},
        # needle
        "bent": {"px": 10.0},
        "missing": {},
        "pin_stuck": {},
        # touch sense and meter
        "sense_stuck": {"closed": True},
        "harness_open": {"channel": 0},
        "harness_joined": {"channel": 101, "other": 102},
        "relay_welded": {"channel": 1},
        "meter_silent": {},
        "meter_garbage": {},
        "meter_stuck": {"at": "last"},
        "meter_slow": {"delay_s": 3.0},
        "meter_dialect": {"dialect": "foreign"},
    }
)
"""Every fault with its parameters' defaults. A value outside `CHOICES` or of another type is refused."""

CHOICES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "axis": _AXES,
        "side": ("negative", "positive", "both"),
        "lamp": ("white", "red", "both"),
        "dialect": ("foreign", "terse"),
        "at": ("last", "zero", "overload"),
    }
)

_CHOICES_OF: Mapping[tuple[str, str], tuple[str, ...]] = MappingProxyType({("slip", "axis"): ("x", "y")})
"""A linear axis slips by micrometres."""

Listener = Callable[[str, bool, Mapping[str, Any]], None]


class Faults:
    """Hold the faults that are on."""

    def __init__(self) -> None:
        self._on: dict[str, dict[str, Any]] = {}
        self._times: dict[str, int] = {}
        self._listeners: list[Listener] = []

    def listen(self, listener: Listener) -> None:
        """Call `listener(name, on, parameters)` after each change."""
        self._listeners.append(listener)

    def switch(self, name: str, *, on: bool, **parameters: Any) -> None:
        """Switch a fault on (replacing its parameters) or off.

        Raises:
            ValueError: the fault or a parameter is unknown, or a value does not fit.

        """
        if name not in DEFAULTS:
            raise ValueError(f"unknown fault {name!r}; known: {', '.join(DEFAULTS)}")
        if on:
            self._on[name] = _checked(name, parameters)
            self._times[name] = self.times(name) + 1
        else:
            self._on.pop(name, None)
        self._tell(name, on=on)

    def on(self, name: str) -> bool:
        """Tell whether a fault is on."""
        return name in self._on

    def times(self, name: str) -> int:
        """Return how often a fault was switched on so far, for what happens once each time."""
        return self._times.get(name, 0)

    def get(self, name: str) -> Mapping[str, Any]:
        """Return the parameters of a fault: those in force, or the defaults while it is off."""
        return MappingProxyType(self._on.get(name, dict(DEFAULTS[name])))

    def hits(self, name: str, key: str, value: str) -> bool:
        """Tell whether a fault is on for one of several things, such as `hits("stall", "axis", "y")`."""
        return self.on(name) and self._on[name][key] in (value, "all", "both")

    def use(self, name: str) -> bool:
        """Tell whether a fault is on and count this use; a fault given `count` clears itself when used up."""
        if name not in self._on:
            return False
        left = self._on[name].get("count")
        if left is not None:
            self._on[name]["count"] = left - 1
            if left <= 1:
                del self._on[name]
                self._tell(name, on=False)
        return True

    def listing(self) -> dict[str, dict[str, Any]]:
        """Return every known fault with its state and parameters."""
        return {name: {"on": self.on(name), **self.get(name)} for name in DEFAULTS}

    def _tell(self, name: str, *, on: bool) -> None:
        for listener in self._listeners:
            listener(name, on, self.get(name))


def _checked(name: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(DEFAULTS[name])
    for key, value in parameters.items():
        if key == "count":
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise ValueError(f"fault {name!r}: count must be a whole number above zero, not {value!r}")
        elif key not in merged:
            raise ValueError(f"fault {name!r} has no parameter {key!r}; it has: {', '.join(merged) or 'none'}")
        elif key in CHOICES and value not in (choices := _CHOICES_OF.get((name, key), CHOICES[key])):
            raise ValueError(f"fault {name!r}: {key} must be one of {', '.join(choices)}, not {value!r}")
        elif key not in CHOICES:
            value = _like(name, key, merged[key], value)
        merged[key] = value
    return merged


def _like(name: str, key: str, default: Any, value: Any) -> Any:
    """Return `value` as the type of `default`."""
    wanted = type(default)
    fits = isinstance(value, bool) if wanted is bool else isinstance(value, int | float) and not isinstance(value, bool)
    if not fits or (wanted is int and value != int(value)):
        raise ValueError(f"fault {name!r}: {key} must be of type {wanted.__name__}, not {value!r}")
    return wanted(value)
