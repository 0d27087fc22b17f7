"""A drive whose supply dips at any moment: nothing foreign is written, and no lost reference is believed."""

import contextlib
import dataclasses

import pytest

from drivers.deadline import Deadline
from drivers.errors import DeviceError, MotionError
from drivers.l4118 import Axis
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.l4118.conftest import CONFIG, MakeAxis
from tests.drivers.peers.drive import DriveModel
from tests.drivers.peers.line import Step

# What stands in a drive's own Rx mapping beside what the driver writes
FOREIGN = ((0x3202, 0), (0x6042, 0), (0x60FE, 1))


class Dip:
    """A drive that restarts, mapping and count with it, before it would answer a certain request."""

    def __init__(self, drive: DriveModel) -> None:
        self.drive = drive
        self.left: int | None = None
        self.asked = 0

    def __call__(self, request: bytes) -> list[Step]:
        self.asked += 1
        if self.left is not None:
            self.left -= 1
            if self.left == 0:
                self.drive.power_cycle()
                return []
        return self.drive.answer(request)


async def _asked(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> tuple[int, int]:
    """Count the requests of a homing run and of the move after it."""
    dip = Dip(DriveModel(3))
    axis = Axis(await open_bus(make_line(dip)), CONFIG)
    await axis.home(soon)
    homing = dip.asked
    await axis.move_to(20000.0, soon)
    return homing, dip.asked - homing


async def _dipped(make_line: MakeLine, open_bus: OpenBus, *, homing: int | None, move: int | None) -> DriveModel:
    """Home and move, with a dip before a request of the one or of the other; give the drive afterwards."""
    drive = DriveModel(3)
    dip = Dip(drive)
    bus = await open_bus(make_line(dip), timeout_s=0.02, late_reply_s=0.02)
    axis = Axis(bus, CONFIG)
    with contextlib.suppress(DeviceError):
        dip.left = homing
        await axis.home(Deadline.after(10.0))
        dip.left = move
        await axis.move_to(20000.0, Deadline.after(10.0))
    await bus.close()
    return drive


@pytest.mark.parametrize("part", ["homing", "move"])
async def test_a_dip_before_any_request_puts_nothing_into_foreign_objects(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, part: str
) -> None:
    """It should leave 3202h, 6042h and 60FEh as they are, move no drive that lost its count, and call none homed."""
    fresh = DriveModel(3)
    homing, move = await _asked(make_line, open_bus, soon)
    last, step = (homing, 3) if part == "homing" else (move, 1)
    for before in range(1, last + 1, step):
        drive = await _dipped(make_line, open_bus, **{"homing": None, "move": None, part: before})
        assert {place: drive.od[place] for place in FOREIGN} == {place: fresh.od[place] for place in FOREIGN}, before
        if not drive.referenced:
            assert drive.od[0x2400, 0x20][1] == 0, before
            assert drive.position == 0, before


async def test_the_start_writes_nothing_through_the_image(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should find the word order by reading alone, and later ones in moves write objects only."""
    drive = DriveModel(3)
    line = make_line(drive.answer)
    axis = Axis(await open_bus(line), CONFIG)
    await axis.home(soon)
    await axis.move_to(20000.0, soon)
    assert {request[1] for request in line.requests} == {0x03, 0x2B}
    assert drive.position == 20000 * 1638.4


@pytest.mark.parametrize(("found", "wanted"), [(0x00D20000, None), (-655_360 % 2**32, None), (0x9, 0x8)])
async def test_a_motor_mode_that_was_written_over_is_named(
    make_axis: MakeAxis, soon: Deadline, found: int, wanted: int | None
) -> None:
    """It should refuse to start with a target in 3202h, or with another mode than the configured one."""
    drive = DriveModel(3)
    drive.od[0x3202, 0][1] = found
    axis = await make_axis(drive, dataclasses.replace(CONFIG, motor_mode=wanted))
    with pytest.raises(MotionError, match=f"3202h reads {found:08X}h") as caught:
        await axis.start(soon)
    assert caught.value.object == "3202h:00"


async def test_a_motor_mode_as_configured_is_taken(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should tell what it is, and do without where a drive has none."""
    drive = DriveModel(3)
    assert (await (await make_axis(drive, dataclasses.replace(CONFIG, motor_mode=0x9))).start(soon)).motor_mode == 0x9
    del drive.od[0x3202, 0]
    assert (await (await make_axis(drive)).start(soon)).motor_mode is None


async def test_the_word_order_is_shown_by_the_first_value_that_has_two_different_words(
    make_axis: MakeAxis, soon: Deadline
) -> None:
    """It should be right all the way though the count stood at zero at the start, and both orders read the same."""
    drive = DriveModel(3)
    drive.variant.word_order = "little"
    axis = await make_axis(drive)
    assert (await axis.start(soon)).word_order is None
    await axis.home(soon)
    drive.step = 100_000
    status = await axis.move_to(777.0, soon)
    assert status.position_units == pytest.approx(777.0, abs=0.001)
    assert (await axis.start(soon)).word_order == "little"
