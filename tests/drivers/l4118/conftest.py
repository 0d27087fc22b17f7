"""One axis on one line, new or homed."""

from collections.abc import Awaitable, Callable

import pytest

from drivers.deadline import Deadline
from drivers.l4118 import Axis, AxisConfig
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.peers.drive import DriveModel

MakeAxis = Callable[..., Awaitable[Axis]]
Homed = tuple[Axis, DriveModel]

CONFIG = AxisConfig(
    "Z", 3, 1638.4, 0.0, 30000.0, 20000.0, 100000.0, 1.0, poll_s=0.001, stall_s=0.5, state_timeout_s=1.0
)


@pytest.fixture
def make_axis(make_line: MakeLine, open_bus: OpenBus) -> MakeAxis:
    async def make(drive: DriveModel, config: AxisConfig = CONFIG, **bus: object) -> Axis:
        return Axis(await open_bus(make_line(drive.answer), **bus), config)

    return make


@pytest.fixture
async def homed(make_axis: MakeAxis, soon: Deadline) -> Homed:
    drive = DriveModel(3)
    axis = await make_axis(drive)
    await axis.home(soon)
    drive.log.clear()
    return axis, drive
