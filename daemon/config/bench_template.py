"""Template of a bench configuration: the station.toml of a daemon that drives the simulated station.

It is the same file that a real station has; what differs from bench to bench is in `BenchPlaces` and `BenchWaits`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Literal

GAP_MS, STILL_MS, LIT_MS = 3.0, 60.0, 40.0
"""Silence on the line, and how long the head and a lamp take to be steady, on a station whose time is the clock's."""
REPLY_MS = 200.0
"""How long a slave may take to answer; more where several stations share a computer, which then is what is slow."""
PICTURE_REPLIES = 15.0
"""A picture may take as long as so many answers of a slave."""

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
overtravel_um = 450.0       # most that the pin may ever be pushed in, at a second site
settle_ms = {still_ms:g}

[touch]
overtravel_um = 300.0

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
timeout_ms = {picture_ms:g}

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
live = "{live}"
"""


_ELECTRIC = """
[ladder]
order = ["look", "pump", "reference", "second_site"]

[reference]               # a gold coin beside the board, joined to the meter's return
x_um = 30000.0
y_um = 34000.0

[brush]
x_um = 30000.0
y_um = 40000.0

[meter]                   # the simulated station's own, on loopback
kind = "scpi"
address = "{address}"
contact_channel = {contact_channel}
{ground}
[meter.channels]          # of the scanner, for each net's pin of the harness
{channels}

[meter.methods.contact]
range = 100.0
nplc = 0.2
[meter.methods.continuity]
range = 100.0
nplc = 0.2
[meter.methods.resistance]
nplc = 0.2
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
    """ZeroMQ endpoint, as are the next three."""
    control: str
    events: str
    live: str = ""
    """Empty: no live pictures."""


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
        picture_ms=PICTURE_REPLIES * waits.reply_ms,
        still_ms=STILL_MS / waits.speed,
        lit_ms=LIT_MS / waits.speed,
    )


def bench_electric_toml(address: str, harness: Mapping[int, str], contact_channel: int) -> str:
    """Return what a station.toml has beside for probing: meter, reference pad, brush.

    `harness`: scanner channel -> net. `contact_channel`: of the needle's second wire.
    """
    ground = next((net for net in harness.values() if net.upper().strip("/") == "GND"), None)
    return _ELECTRIC.format(
        address=address,
        contact_channel=contact_channel,
        ground="" if ground is None else f"ground_net = {json.dumps(ground)}\n",
        channels="\n".join(f"{json.dumps(net)} = {channel}" for channel, net in harness.items()),
    )
