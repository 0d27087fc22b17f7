"""A machine of four drives, and one that is homed."""

import pytest

from drivers.deadline import Deadline
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.gantry.machine import AXES, Machine, make_machine


@pytest.fixture
async def machine(make_line: MakeLine, open_bus: OpenBus) -> Machine:
    return await make_machine(make_line, open_bus, AXES)


@pytest.fixture
async def homed(machine: Machine, soon: Deadline) -> Machine:
    await machine.gantry.home(soon)
    for drive in machine.drives.values():
        drive.log.clear()
    return machine
