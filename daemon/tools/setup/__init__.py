"""Guided set-up of a station: its notes, its configuration file, and finding what is plugged in. Nothing here moves."""

from daemon.tools.setup.edit import EXAMPLE, read_value, with_values
from daemon.tools.setup.found import Answering, cameras, serial_ports, who_answers
from daemon.tools.setup.notes import Notes
from daemon.tools.setup.scale import corrected_increments, increments_per_unit

__all__ = [
    "EXAMPLE",
    "Answering",
    "Notes",
    "cameras",
    "corrected_increments",
    "increments_per_unit",
    "read_value",
    "serial_ports",
    "who_answers",
    "with_values",
]
