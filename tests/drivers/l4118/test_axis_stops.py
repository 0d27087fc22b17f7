"""One axis over real bytes: power cuts, stops and homing."""

import asyncio
import dataclasses
from typing import Any

import pytest

from drivers.deadline import Deadline
from drivers.errors import (
    EmergencyStop,
    MotionError,
    MotionTimeout,
    NotHomed,
)
from drivers.l4118 import Axis, AxisStatus, HomingConfig
from tests.drivers.l4118.conftest import CONFIG, Homed, MakeAxis
from tests.drivers.peers.drive import DriveModel

# 603Fh and the newest entry of 1003h
UNDER_VOLTAGE = (0x3220, 0x03043220)


# ---------------------------------------------------------------- power and stops
async def test_power_lost_at_rest_is_an_emergency_stop_until_the_drive_is_started(homed: Homed, soon: Deadline) -> None:
    """It should miss the marker and move nothing; then the axis is not homed, and homing makes it whole again."""
    axis, drive = homed
    drive.power_cycle()
    for question in (axis.homed(soon), axis.move_to(100.0, soon)):
        with pytest.raises(EmergencyStop, match="its reference is gone"):
            await question
    assert drive.log == []
    await axis.start(soon)
    assert not await axis.homed(soon)
    with pytest.raises(NotHomed):
        await axis.move_to(100.0, soon)
    await axis.home(soon)
    await axis.move_to(100.0, soon)
    assert drive.position == 100 * 1638.4


async def test_power_lost_in_a_move_is_an_emergency_stop(homed: Homed, soon: Deadline) -> None:
    """It should raise EmergencyStop in the move, and not believe the position afterwards."""
    axis, drive = homed
    task = await _under_way(axis, drive, soon)
    drive.power_cycle()
    with pytest.raises(EmergencyStop, match="lost power"):
        await task
    await axis.start(soon)
    assert not await axis.homed(soon)


async def test_a_power_stage_switched_off_is_an_emergency_stop(homed: Homed, soon: Deadline) -> None:
    """It should raise EmergencyStop in the move, and again while there is no motor voltage."""
    axis, drive = homed
    task = await _under_way(axis, drive, soon)
    drive.motor_voltage, drive.state = False, 0x40
    with pytest.raises(EmergencyStop, match="switched off from outside"):
        await task
    await axis.start(soon)
    axis.release()
    with pytest.raises(EmergencyStop, match="no motor voltage"):
        await axis.move_to(100.0, soon)


async def test_a_drive_switched_off_at_rest_does_not_move_before_it_is_started(homed: Homed, soon: Deadline) -> None:
    """It should tell it from the health and from the next move, though the voltage is back: the axis may have slipped.

    What the program switched off itself is no such thing.
    """
    axis, drive = homed
    await axis.move_to(500.0, soon)
    assert (await axis.health(soon)).trouble() is None
    drive.state = 0x40
    drive.log.clear()
    assert isinstance((await axis.health(soon)).trouble(), EmergencyStop)
    with pytest.raises(EmergencyStop, match="switched off from outside"):
        await axis.move_to(100.0, soon)
    assert drive.log == []
    await axis.start(soon)
    axis.release()
    await axis.move_to(100.0, soon)
    for stop in (axis.halt, axis.quick_stop):
        await stop()
        assert (await axis.health(soon)).trouble() is None
        axis.release()
        await axis.move_to(200.0, soon)


@pytest.mark.parametrize("cut", [UNDER_VOLTAGE, None], ids=["supply cut", "restarted"])
async def test_a_stop_that_has_passed_while_the_drive_is_being_enabled_is_named(
    homed: Homed, soon: Deadline, cut: tuple[int, int] | None
) -> None:
    """It should not speak of a step that led elsewhere, with the voltage back before anybody looked."""
    axis, drive = homed
    await axis.halt()
    axis.release()
    keep = drive.write_control

    def write_control(word: int) -> None:
        keep(word)
        if word == 0x07:
            drive.fail(*cut) if cut else drive.power_cycle()

    drive.write_control = write_control  # type: ignore[method-assign]
    with pytest.raises(EmergencyStop):
        await axis.move_to(100.0, soon)


async def _under_way(axis: Axis, drive: DriveModel, soon: Deadline) -> asyncio.Task[AxisStatus]:
    """Begin a long move and return it once the axis has left its place."""
    drive.step = 1000
    task = asyncio.create_task(axis.move_to(20000.0, soon))
    while not drive.position:
        await axis.status(soon)
    return task


async def test_a_quick_stop_wins_over_the_move_it_stops(homed: Homed, soon: Deadline) -> None:
    """It should end the move with EmergencyStop and not let its next command start the drive again."""
    axis, drive = homed
    task = await _under_way(axis, drive, soon)
    await axis.quick_stop()
    with pytest.raises(EmergencyStop):
        await task
    assert drive.state == 0x07
    with pytest.raises(EmergencyStop, match="stopped"):
        await axis.move_to(100.0, soon)
    axis.release()
    drive.step = 2_000_000
    await axis.move_to(100.0, soon)
    assert drive.position == 100 * 1638.4


async def test_a_quick_stop_after_a_power_cut_writes_no_foreign_object(homed: Homed) -> None:
    """It should not carry a target into the drive's own mapping, where other objects lie."""
    axis, drive = homed
    drive.power_cycle()
    before = {key: list(value) for key, value in drive.od.items()}
    await axis.quick_stop()
    assert drive.control == 0x02
    assert drive.od == before


# ---------------------------------------------------------------- homing
async def test_homing_sets_its_place_and_marker(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should put the configured coordinate to the home place, with 607Ch zero."""
    drive = DriveModel(3)
    config = dataclasses.replace(CONFIG, homing=HomingConfig(method=18, home_position_units=30000.0))
    axis = await make_axis(drive, config)
    await axis.home(soon)
    assert await axis.position(soon) == 30000.0
    assert drive.od[0x6098, 0][1] == 18
    assert drive.od[0x607C, 0][1] == 0
    assert drive.od[0x2400, 0x20][1] == config.homed_marker
    await axis.move_to(10000.0, soon)
    assert drive.position == -20000 * 1638.4


async def test_homing_under_other_settings_does_not_count(make_axis: MakeAxis, homed: Homed, soon: Deadline) -> None:
    """It should want a new homing when the home place was configured anew."""
    _, drive = homed
    other = dataclasses.replace(CONFIG, homing=HomingConfig(home_position_units=5.0))
    assert not await (await make_axis(drive, other)).homed(soon)
    assert await (await make_axis(drive)).homed(soon)


async def test_a_second_homing_is_not_taken_for_the_first(homed: Homed, soon: Deadline) -> None:
    """It should wait until the old homing-attained bit is gone."""
    axis, drive = homed
    await axis.move_to(500.0, soon)
    drive.log.clear()
    await axis.home(soon)
    assert drive.log.count("homing") == 1
    await axis.home(soon)
    assert drive.log.count("homing") == 2
    assert drive.position == 0


async def test_a_failed_homing_leaves_the_axis_unhomed(homed: Homed, soon: Deadline) -> None:
    """It should raise on bit 13 and take the marker away."""
    axis, drive = homed
    drive.homing_fails = True
    with pytest.raises(MotionError, match="method 17 failed"):
        await axis.home(soon)
    assert not await axis.homed(soon)
    assert drive.state == 0x21


@pytest.mark.parametrize("mode_error", [False, True])
async def test_an_emergency_stop_in_homing_is_named_and_leaves_the_axis_unhomed(
    make_axis: MakeAxis, soon: Deadline, mode_error: bool
) -> None:
    """It should look at the drive's state before the bits of the mode: a faulted drive may show any of them."""
    drive = DriveModel(3, homing_looks=10**9)
    axis = await make_axis(drive)
    task = asyncio.create_task(axis.home(soon))
    while "homing" not in drive.log:
        await axis.position(soon)
    drive.fail(*UNDER_VOLTAGE)
    drive.following_error = mode_error
    with pytest.raises(EmergencyStop, match="under-voltage") as caught:
        await task
    assert caught.value.drive_code == 0x3220
    assert not await axis.homed(soon)


async def test_homing_has_its_own_deadline(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should give up and halt when no switch comes."""
    drive = DriveModel(3, homing_looks=10**9)
    config = dataclasses.replace(CONFIG, homing=HomingConfig(timeout_s=1.5))
    axis = await make_axis(drive, config)
    with pytest.raises(MotionTimeout, match="deadline"):
        await axis.home(soon)
    assert drive.state == 0x21
    assert not await axis.homed(soon)


async def test_a_changed_unit_takes_the_reference_away(homed: Homed, soon: Deadline) -> None:
    """It should not trust a position counted in another unit."""
    axis, drive = homed
    drive.od[0x60A8, 0][1] = 0xFF410000
    assert not (await axis.start(soon)).homed


async def test_nothing_moves_before_start(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should say that start has not run."""
    axis = await make_axis(DriveModel(3))
    with pytest.raises(MotionError, match="start"):
        await axis.begin_move(10.0, soon)
    with pytest.raises(MotionError, match="no move"):
        await axis.arrived(soon)


@pytest.mark.parametrize(
    "change",
    [{"min_units": 30000.0}, {"increments_per_unit": 0.0}, {"window_units": 0.0}, {"speed_units_s": -1.0}],
)
def test_impossible_settings_are_refused(change: dict[str, Any]) -> None:
    """It should name the axis."""
    with pytest.raises(ValueError, match="Z: "):
        dataclasses.replace(CONFIG, **change)
