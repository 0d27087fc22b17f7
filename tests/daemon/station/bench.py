"""A station on fake devices, for the tests of what it does with them."""

from __future__ import annotations

from typing import Any

import numpy as np

from daemon.config.model import Config, load_config
from daemon.platform.clock import Stopwatch
from daemon.station.allowance import Allowance
from daemon.station.station import Search, Station
from drivers.deadline import Deadline
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import (
    EXAMPLE,
    FakeCamera,
    FakeGantry,
    FakeLights,
    hardware,
)

HERE = Position(50_000.0, 40_000.0, 5_200.0, 0.0)
ANYWHERE = Search((0.0, 0.0), 60.0, None)


class Bench:
    """A station on fake devices, and a caller with an hour to spend."""

    def __init__(self, **gantry: Any) -> None:
        config: Config = load_config(EXAMPLE)
        self.config = config.model_copy(update={"gantry": config.gantry.model_copy(update=gantry)})
        self.gantry, self.lights, self.camera = FakeGantry(config, HERE, HERE), FakeLights(), FakeCamera()
        self.camera.pixels = np.zeros((1200, 1600, 3), dtype=np.uint8)
        self.hardware = hardware(self.gantry, self.lights, self.camera)
        self.station = Station(self.config, self.hardware)
        self.caller = Allowance(Deadline.after(3_600.0), Stopwatch())

        self.station.needle.reported(HERE)

    def booked_ms(self, what: str) -> float | None:
        return self.caller.watch.timing_ms()["triggered"].get(what)
