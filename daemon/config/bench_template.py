"""Template of a bench configuration: the station.toml of a daemon that drives the simulated station.

It is the same file that a real station has; what differs from bench to bench is in `BenchPlaces` and `BenchWaits`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

GAP_MS, STILL_MS, LIT_MS = 3.0, 60.0, 40.0
"""Silence on the line, and how long the head and a lamp take to be steady, on a station whose time is the clock's."""
REPLY_MS = 200.0
"""How long a slave may take to answer; more where several stations share a computer, which then is what is slow."""

_TOML = """\
# Written by `{by}`. A real station differs in names of ports only.
[station]
name = "{name}"
data_dir = "{data_dir}"
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
class BenchPlaces:
    """Who wrote the file, the station's name, and where its data, its line and its sockets are."""

    by: str
    """The command, for the file's first line."""
    name: str
    data_dir: str
    """Relative to the file, or absolute."""
    line: str
    """The serial line."""
    camera: str
    """ZeroMQ endpoint, as are the next two."""
    control: str
    events: str


@dataclass(frozen=True)
class BenchWaits:
    """How long to wait, ms: on a station whose time runs `speed` times as fast, what goes by the clock is over sooner.

    Timeouts do not shrink: they are for the two programs, which are no faster there.
    """

    speed: float = 1.0
    reply_ms: float = REPLY_MS


def bench_toml(places: BenchPlaces, waits: BenchWaits, pictures: Literal["failed", "all", "none"]) -> str:
    """Return the text of a station.toml; `pictures`: which jobs' pictures are kept."""
    return _TOML.format(
        **asdict(places),
        pictures=pictures,
        gap_ms=GAP_MS / waits.speed,
        reply_ms=waits.reply_ms,
        still_ms=STILL_MS / waits.speed,
        lit_ms=LIT_MS / waits.speed,
    )
