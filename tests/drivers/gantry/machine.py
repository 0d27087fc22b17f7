"""Four model drives on one line as one machine, for the tests of the gantry."""

import asyncio
from collections.abc import Mapping

from drivers.gantry import Gantry, GantryConfig, Position
from drivers.l4118 import Axis, AxisConfig, HomingConfig
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.peers.drive import DriveModel, several
from tests.drivers.peers.line import PtyLine

QUICK = {"poll_s": 0.001, "stall_s": 0.4, "state_timeout_s": 1.0}
TOP = HomingConfig(method=18, home_position_units=30000.0)
AXES = {
    "x": AxisConfig("X", 1, 655.36, 0.0, 200000.0, 50000.0, 2e5, 1.0, **QUICK),
    "y": AxisConfig("Y", 2, 655.36, 0.0, 150000.0, 50000.0, 2e5, 1.0, **QUICK),
    "z": AxisConfig("Z", 3, 1638.4, 0.0, 30000.0, 10000.0, 1e5, 1.0, homing=TOP, **QUICK),
    "theta": AxisConfig("theta", 4, 3276800 / 360, -220.0, 100.0, 60.0, 300.0, 0.01, **QUICK),
}
PLACE = Position(60000.0, 40000.0, 5200.0, 350.0)


class Machine:
    def __init__(self, gantry: Gantry, drives: dict[str, DriveModel], line: PtyLine) -> None:
        self.gantry = gantry
        self.drives = drives
        self.line = line

    def at(self, name: str) -> float:
        return AXES[name].to_units(self.drives[name].position)

    def slow(self, step: int) -> None:
        for drive in self.drives.values():
            drive.step = step

    async def under_way(self, task: asyncio.Task) -> None:
        """Wait until X has begun to move."""
        began = self.drives["x"].position
        while self.drives["x"].position == began:
            assert not task.done(), task
            await asyncio.sleep(0.001)


async def make_machine(
    make_line: MakeLine,
    open_bus: OpenBus,
    axes: Mapping[str, AxisConfig],
    config: GantryConfig = GantryConfig(),  # noqa: B008 - frozen
) -> Machine:
    drives = {name: DriveModel(config.address, step=20_000_000) for name, config in axes.items()}
    line = make_line(several(*drives.values()))
    bus = await open_bus(line, timeout_s=0.4, late_reply_s=0.4, attempts=2)
    return Machine(Gantry({name: Axis(bus, c) for name, c in axes.items()}, config), drives, line)
