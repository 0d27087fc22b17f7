"""CiA 402 power state machine as data (drive manual, 6040h and 6041h)."""

from __future__ import annotations

from enum import Enum, auto


class PowerState(Enum):
    """State of the drive; the value is its statusword pattern (bits 0..3, 5, 6)."""

    NOT_READY = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    ENABLED = 0x27
    QUICK_STOP = 0x07
    FAULT_REACTION = 0x0F
    FAULT = 0x08


class Command(Enum):
    """What a controlword asks for."""

    SHUTDOWN = auto()
    SWITCH_ON = auto()
    ENABLE = auto()
    DISABLE_VOLTAGE = auto()
    QUICK_STOP = auto()


_OFF = PowerState.SWITCH_ON_DISABLED

TRANSITIONS: dict[PowerState, dict[Command, PowerState]] = {
    PowerState.NOT_READY: {},
    PowerState.SWITCH_ON_DISABLED: {Command.SHUTDOWN: PowerState.READY},
    PowerState.READY: {
        Command.SWITCH_ON: PowerState.SWITCHED_ON,
        Command.DISABLE_VOLTAGE: _OFF,
        Command.QUICK_STOP: _OFF,
    },
    PowerState.SWITCHED_ON: {
        Command.SHUTDOWN: PowerState.READY,
        Command.ENABLE: PowerState.ENABLED,
        Command.DISABLE_VOLTAGE: _OFF,
        Command.QUICK_STOP: _OFF,
    },
    PowerState.ENABLED: {
        Command.SHUTDOWN: PowerState.READY,
        Command.SWITCH_ON: PowerState.SWITCHED_ON,
        Command.DISABLE_VOLTAGE: _OFF,
        Command.QUICK_STOP: PowerState.QUICK_STOP,
    },
    # Transition 16 (back to enabled) needs a rising edge of bit 2, which only the drive can see.
    PowerState.QUICK_STOP: {Command.ENABLE: PowerState.ENABLED, Command.DISABLE_VOLTAGE: _OFF},
    PowerState.FAULT_REACTION: {},
    PowerState.FAULT: {},
}
"""Unlisted pairs change nothing. Faults and their reset are the drive's own transitions."""

_PATTERNS = (
    (0b1000_0010, 0b0000_0000, Command.DISABLE_VOLTAGE),
    (0b1000_0110, 0b0000_0010, Command.QUICK_STOP),
    (0b1000_0111, 0b0000_0110, Command.SHUTDOWN),
    (0b1000_1111, 0b0000_0111, Command.SWITCH_ON),
    (0b1000_1111, 0b0000_1111, Command.ENABLE),
)
"""Controlword masks and patterns; bits 0..3 and 7."""


def command_of(controlword: int) -> Command | None:
    """Return what a controlword asks for; None while the fault-reset bit is set."""
    return next((command for mask, value, command in _PATTERNS if controlword & mask == value), None)
