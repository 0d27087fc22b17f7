"""The configuration of a daemon that drives the simulated station: the same file a real station has."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

GAP_MS, STILL_MS, LIT_MS = 3.0, 60.0, 40.0
"""Silence on the line, and how long the head and a lamp take to be steady, on a station whose time is the clock's."""
REPLY_MS = 200.0
"""How long a slave may take to answer; more where several stations share a computer, which then is what is slow."""

_TOML = """\
# Written by `reprobe demo`. A real station differs in names of ports only.
[station]
name = "demo"
data_dir = "station"
pictures = "{pictures}"
pictures_quota_mb = 500.0

[bus.main]
port = "{line}"
baudrate = 115200
parity = "N"
gap_ms = {gap_ms:g}
timeout_ms = {reply_ms:g}

[axes.x]
bus = "main"
address = 1
increments_per_unit = 655.36        # 65536 x 50 increments a turn, 5 mm lead
minimum = 0.0
maximum = 200000.0
speed = 150000.0
acceleration = 2000000.0
homing_method = 21                  # home switch on the negative side
homing_speed = 30000.0

[axes.y]
bus = "main"
address = 2
increments_per_unit = 655.36
minimum = 0.0
maximum = 150000.0
speed = 150000.0
acceleration = 2000000.0
homing_method = 21                  # home switch on the negative side
homing_speed = 30000.0

[axes.z]
bus = "main"
address = 3
increments_per_unit = 1638.4        # 2 mm lead
minimum = 0.0
maximum = 30000.0
speed = 40000.0
acceleration = 1000000.0
homing_method = 19                  # home switch on the positive side: homing lifts the needle
homing_speed = 20000.0
homing_position = 30000.0

[axes.theta]
bus = "main"
address = 4
increments_per_unit = 9102.222222222223   # 512 increments are 0.05625 degrees
minimum = -220.0
maximum = 100.0
speed = 180.0
acceleration = 2000.0
homing_method = 19
homing_speed = 60.0

[gantry]
safe_z_um = 12000.0
work_z_um = 5200.0
touch_z_um = 5000.0
press_um = 200.0
settle_ms = {still_ms:g}

[lights]
kind = "modbus"
bus = "main"
address = 5
white = 0
red = 1
settle_ms = {lit_ms:g}

[camera]
kind = "stream"
endpoint = "{camera}"
encoding = "mjpg"

[head]
radius_um = 14938.26      # the mean of the real head's record; its run-out is what the servo is for
phase_deg = -3.054

[control_point]           # the printed cross beside the board
x_um = 30000.0
y_um = 22000.0

[board]
file = "board.json"
origin_x_um = 60000.0
origin_y_um = 40000.0

[api]
control = "{control}"
events = "{events}"
"""


@dataclass(frozen=True)
class Places:
    """Where everything of one demonstration is: files in `out`, sockets in a short folder of their own."""

    out: Path
    sockets: Path

    @property
    def line(self) -> str:
        """The serial line."""
        return str(self.sockets / "bus")

    def socket(self, name: str) -> str:
        """Return the ZeroMQ endpoint of that name."""
        return f"ipc://{self.sockets / name}"


def write_settings(
    places: Places,
    *,
    speed: float = 1.0,
    reply_ms: float = REPLY_MS,
    pictures: Literal["failed", "all", "none"] = "all",
) -> Path:
    """Write station.toml and return its path.

    On a station whose time runs `speed` times as fast, what the daemon waits for by the clock is over as much sooner.
    Timeouts do not shrink: they are for the two programs, which are no faster there.
    """
    path = places.out / "station.toml"
    path.write_text(
        _TOML.format(
            line=places.line, camera=places.socket("camera"), control=places.socket("control"),
            events=places.socket("events"), pictures=pictures, gap_ms=GAP_MS / speed,
            reply_ms=reply_ms, still_ms=STILL_MS / speed,
            lit_ms=LIT_MS / speed,
        )
    )  # fmt: skip
    return path
