"""Stops that the drive does not heed or the line does not carry, and homing runs that have no end."""

import dataclasses

import pytest

from drivers.deadline import Deadline
from drivers.errors import DeviceRefused, LinkTimeout, MotionError, MotionTimeout, ReplyError
from drivers.l4118 import Axis, HomingConfig
from tests.drivers.l4118.conftest import CONFIG, Homed, MakeAxis
from tests.drivers.peers.drive import Abort, DriveModel


async def _runs(axis: Axis, drive: DriveModel, soon: Deadline) -> None:
    """Begin a move that takes long."""
    drive.step = 1000  # more than half a window a look: however late one comes, it has moved
    await axis.begin_move(20000.0, soon)
    while not drive.position:
        await axis.arrived(soon)


async def _stands(axis: Axis, drive: DriveModel, soon: Deadline) -> bool:
    at = drive.position
    await axis.status(soon)
    return drive.position == at


@pytest.mark.parametrize("heeds_shutdown", [True, False])
async def test_a_drive_that_ignores_the_halt_bit_is_switched_off(
    homed: Homed, soon: Deadline, heeds_shutdown: bool
) -> None:
    """It should not stop at waiting for the standstill: shutdown, and where that is not heeded no voltage."""
    axis, drive = homed
    drive.heeds_halt, drive.heeds_shutdown = False, heeds_shutdown
    await _runs(axis, drive, soon)
    await axis.halt()
    assert drive.state == (0x21 if heeds_shutdown else 0x40)
    assert await _stands(axis, drive, soon)
    assert not axis.unstopped


async def test_a_running_drive_that_ignores_the_halt_bit_is_switched_off_at_the_start(
    make_axis: MakeAxis, homed: Homed, soon: Deadline
) -> None:
    """It should do so for a drive whose former owner died in a move, too."""
    axis, drive = homed
    drive.heeds_halt = False
    await _runs(axis, drive, soon)
    await (await make_axis(drive)).start(soon)
    assert drive.state == 0x40


async def test_a_drive_that_cannot_be_switched_off_is_told_and_stays_to_be_stopped(
    homed: Homed, soon: Deadline
) -> None:
    """It should say so by name instead of taking it for stopped."""
    axis, drive = homed
    await _runs(axis, drive, soon)
    keep = drive.write_control
    drive.write_control = lambda word: None  # type: ignore[method-assign]  # noqa: ARG005
    drive.heeds_halt = False
    with pytest.raises(MotionTimeout, match="cannot be switched off"):
        await axis.halt()
    assert axis.unstopped
    drive.write_control = keep  # type: ignore[method-assign]
    await axis.halt()
    assert not axis.unstopped


async def test_a_stop_that_a_silent_line_swallowed_is_remembered(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should be known that the motor may still run, until a stop was confirmed."""
    drive = DriveModel(3)
    axis = await make_axis(drive, timeout_s=0.3)
    await axis.home(soon)
    for stop in (axis.halt, axis.quick_stop):
        axis.release()
        await _runs(axis, drive, soon)
        drive.silent = True
        with pytest.raises(LinkTimeout):
            await stop()
        assert axis.unstopped
        drive.silent = False
        assert drive.state == 0x27
        await axis.halt()
        assert drive.state == 0x21
        assert not axis.unstopped
        drive.position = drive.goal = 0


# ---------------------------------------------------------------- homing
async def test_homing_does_not_begin_with_its_switch_ignored(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should name 3240h:01, which would let the axis run past the switch, and move nothing."""
    drive = DriveModel(3)
    drive.od[0x3240, 1][1] = 0
    axis = await make_axis(drive)
    assert (await axis.start(soon)).switch_inputs == 0
    with pytest.raises(MotionError, match="3240h:01 = 0h, without bit 0") as caught:
        await axis.home(soon)
    assert caught.value.object == "3240h:01"
    assert "homing" not in drive.log


async def test_the_switch_inputs_are_written_where_the_configuration_says_so(
    make_axis: MakeAxis, soon: Deadline
) -> None:
    """It should set 3240h:01 at every start, and read it back."""
    drive = DriveModel(3)
    drive.od[0x3240, 1][1] = 0
    axis = await make_axis(drive, dataclasses.replace(CONFIG, switch_inputs=7))
    assert (await axis.start(soon)).switch_inputs == 7
    assert drive.od[0x3240, 1][1] == 7
    await axis.home(soon)
    assert await axis.homed(soon)


@pytest.mark.parametrize("step", [3_000_000, -3_000_000])
async def test_a_homing_run_ends_after_more_than_the_axis_is_long(
    make_axis: MakeAxis, soon: Deadline, step: int
) -> None:
    """It should halt and say how far it went, long before its time is over."""
    drive = DriveModel(3, homing_looks=10**9)
    homing = HomingConfig(switch_speed_units_s=1e6)
    axis = await make_axis(drive, dataclasses.replace(CONFIG, homing=homing))
    drive.homing_step = step
    with pytest.raises(MotionError, match="met no switch"):
        await axis.home(soon)
    assert drive.state == 0x21
    assert 1.2 * 30000 < abs(drive.position) / 1638.4 < 1.6 * 30000
    assert not await axis.homed(soon)


async def test_a_drive_that_another_program_left_running_is_stopped_without_a_start(
    make_axis: MakeAxis, homed: Homed, soon: Deadline
) -> None:
    axis, drive = homed
    drive.step = 1000
    await axis.begin_move(20000.0, soon)
    other = await make_axis(drive)
    await other.rest(soon)
    stands = drive.position
    assert drive.state != 0x27
    for _ in range(5):
        drive.look()
    assert drive.position == stands
    drive.log.clear()
    await other.rest(soon)
    assert drive.log == [], "one that stands is left alone"


@pytest.mark.parametrize("how", ["by the start", "without a start"])
async def test_a_running_drive_of_another_maker_is_stopped_before_it_is_refused_by_name(
    make_axis: MakeAxis, homed: Homed, soon: Deadline, how: str
) -> None:
    """It should stop what runs, whoever made it: any drive of CiA 402 has the same controlword."""
    axis, drive = homed
    await _runs(axis, drive, soon)
    drive.od[0x1018, 1] = [4, 0x99]
    other = await make_axis(drive)
    if how == "by the start":
        with pytest.raises(ReplyError, match=r"it ran, and was stopped .*vendor 00000099h") as told:
            await other.start(soon)
        assert told.value.device == "Z"
    else:
        await other.rest(soon)
    assert drive.state != 0x27
    assert await _stands(axis, drive, soon)


async def test_a_drive_of_another_maker_that_stands_is_left_alone(
    make_axis: MakeAxis, homed: Homed, soon: Deadline
) -> None:
    axis, drive = homed
    await axis.halt()
    drive.od[0x1018, 1] = [4, 0x99]
    drive.log.clear()
    other = await make_axis(drive)
    with pytest.raises(ReplyError, match="vendor 00000099h"):
        await other.start(soon)
    await other.rest(soon)
    assert drive.log == []


async def test_a_drive_of_another_maker_that_does_not_stop_is_told_of(
    make_axis: MakeAxis, homed: Homed, soon: Deadline
) -> None:
    axis, drive = homed
    await _runs(axis, drive, soon)
    drive.od[0x1018, 1] = [4, 0x99]
    other = await make_axis(drive)
    drive.write_control = lambda _word: None  # type: ignore[method-assign]
    with pytest.raises(MotionTimeout, match="cannot be switched off"):
        await other.start(soon)
    with pytest.raises(MotionTimeout, match="cannot be switched off"):
        await other.rest(soon)


async def test_what_answers_and_is_no_drive_is_refused_and_not_taken_for_one_that_stands(
    make_axis: MakeAxis, soon: Deadline
) -> None:
    drive = DriveModel(3)
    drive.od[0x1018, 1] = [4, 0x99]
    know = drive.get

    def get(index: int, sub: int) -> tuple[int, int]:
        if index >= 0x6000:
            raise Abort(0x06020000)
        return know(index, sub)

    drive.get = get  # type: ignore[method-assign]
    axis = await make_axis(drive)
    with pytest.raises(ReplyError, match=r"whether it runs is not known .*vendor 00000099h"):
        await axis.start(soon)
    with pytest.raises(DeviceRefused):
        await axis.rest(soon)
