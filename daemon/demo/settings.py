"""The configuration of a daemon that drives the simulated station: the same file a real station has."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

_TOML = """\
# Written by `reprobe demo`. A real station differs in names of ports only.
[station]
name = "demo"
data_dir = "station"
pictures = "all"
pictures_quota_mb = 500.0

[bus.main]
port = "{line}"
baudrate = 115200
parity = "N"

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

[lights]
kind = "modbus"
bus = "main"
address = 5
white = 0
red = 1
settle_ms = 40.0

[camera]
kind = "stream"
endpoint = "{camera}"
encoding = "mjpg"

[head]
radius_um = 14938.26      # the mean of the real head's record; its run-out is what the servo is for
phase_deg = -3.054

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


def write_settings(places: Places) -> Path:
    """Write station.toml and return its path."""
    path = places.out / "station.toml"
    path.write_text(
        _TOML.format(
            line=places.line, camera=places.socket("camera"), control=places.socket("control"),
            events=places.socket("events"),
        )
    )  # fmt: skip
    return path
