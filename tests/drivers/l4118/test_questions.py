"""How often a drive is asked, and what may be told by a look that was taken already."""

import asyncio
import math
import time

import pytest

from drivers.deadline import Deadline
from drivers.errors import EmergencyStop, MotionTimeout
from drivers.l4118 import Axis, AxisStatus
from drivers.l4118.access import DriveAccess
from drivers.l4118.arrival import travel_s
from drivers.l4118.power import PowerMachine
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.l4118.conftest import CONFIG, Homed
from tests.drivers.peers.drive import DriveModel
from tests.drivers.peers.line import PtyLine

IMAGE, OBJECT = 0x03, 0x2B
Ran = tuple[Axis, DriveModel, PtyLine]


@pytest.fixture
async def ran(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> Ran:
    """An axis that was homed and has moved, so that its drive is on."""
    drive = DriveModel(3)
    line = make_line(drive.answer)
    axis = Axis(await open_bus(line), CONFIG)
    await axis.home(soon)
    await axis.move_to(500.0, soon)
    line.requests.clear()
    return axis, drive, line


def asked(line: PtyLine) -> list[int]:
    functions = [request[1] for request in line.requests]
    line.requests.clear()
    return functions


async def test_a_drive_that_runs_tells_reference_and_place_in_one_frame(ran: Ran, soon: Deadline) -> None:
    """It should ask for the image once, and for nothing where a look was just taken."""
    axis, _, line = ran
    before_s = time.monotonic()
    assert await axis.homed(soon)
    assert await axis.position(soon, before_s) == pytest.approx(500.0)
    assert asked(line) == [IMAGE]
    assert await axis.position(soon) == pytest.approx(500.0)
    assert asked(line) == [IMAGE]


async def test_a_restart_is_seen_though_the_marker_is_not_asked_for(ran: Ran, soon: Deadline) -> None:
    """It should see that the drive does not run any more, ask what it is, and say so."""
    axis, drive, line = ran
    assert await axis.homed(soon)
    drive.power_cycle()
    asked(line)
    with pytest.raises(EmergencyStop, match="lost power"):
        await axis.homed(soon)
    assert OBJECT in asked(line)


async def test_a_place_is_read_by_its_object_once_the_drive_restarted(ran: Ran, soon: Deadline) -> None:
    """It should not believe an image whose mapping may be another, however fresh the last look is."""
    axis, drive, line = ran
    drive.power_cycle()
    drive.position = round(1000 * 1638.4)
    assert await axis.position(soon) == pytest.approx(1000.0)
    assert asked(line) == [IMAGE, OBJECT]


async def test_a_stopped_or_forgotten_axis_is_asked_for_its_marker(ran: Ran, soon: Deadline) -> None:
    """It should trust the running drive only as long as nobody switched it off or took its reference away."""
    axis, _, line = ran
    await axis.forget_homing(soon)
    assert not await axis.homed(soon)
    await axis.home(soon)
    axis.release()
    await axis.move_to(200.0, soon)
    await axis.quick_stop()
    asked(line)
    assert await axis.homed(soon)
    assert asked(line) == [OBJECT]


async def test_the_place_of_an_axis_under_way_is_asked_for_each_time(ran: Ran, soon: Deadline) -> None:
    """It should not tell where it was."""
    axis, drive, line = ran
    drive.step = 1000
    await axis.begin_move(20000.0, soon)
    await axis.arrived(soon)
    before_s = time.monotonic() - 10.0
    asked(line)
    first = await axis.position(soon, before_s)
    assert await axis.position(soon, before_s) > first
    assert asked(line) == [IMAGE, IMAGE]


async def test_an_aim_moves_nothing_and_takes_a_look_that_is_there(ran: Ran, soon: Deadline) -> None:
    """It should write the target alone; without a look that is new enough it looks."""
    axis, drive, line = ran
    since_s = time.monotonic()
    await axis.status(soon)
    asked(line)
    await axis.aim(700.0, soon, since_s=since_s)
    assert asked(line) == [OBJECT]
    drive.look()
    assert drive.position == 500 * 1638.4
    await axis.aim(700.0, soon, since_s=since_s)
    assert asked(line) == [IMAGE, OBJECT], "what was told to the drive made the look worthless"
    await axis.go(soon)
    while not await axis.arrived(soon):
        pass
    assert drive.position == 700 * 1638.4


@pytest.mark.parametrize(("target", "questions"), [(501.5, [IMAGE, OBJECT]), (700.0, [OBJECT])])
async def test_an_old_acknowledge_is_seen_to_be_gone_only_where_the_way_would_not_show_it(
    ran: Ran, soon: Deadline, target: float, questions: list[int]
) -> None:
    """It should look again before a way that is hardly longer than the window; of any other the going tells."""
    axis, drive, line = ran
    since_s = time.monotonic()
    drive.acknowledge = True
    assert (await axis.status(soon)).acknowledged
    drive.acknowledge = False
    assert axis.aims_at_once(target, since_s) == (questions == [OBJECT])
    asked(line)
    await axis.aim(target, soon, since_s=since_s)
    assert asked(line) == questions


async def test_an_old_acknowledge_is_not_taken_for_that_of_a_target_that_the_drive_did_not_take(
    ran: Ran, soon: Deadline
) -> None:
    """It should go on asking while the axis stands where it was, and give up in time."""
    axis, drive, _ = ran
    since_s = time.monotonic()
    drive.acknowledge = drive.no_acknowledge = True
    await axis.status(soon)
    await axis.aim(700.0, soon, since_s=since_s)
    await axis.go(soon)

    async def wait() -> None:
        while not await axis.arrived(soon):
            assert not axis.holds_start

    with pytest.raises(MotionTimeout, match="not acknowledged"):
        await wait()
    assert drive.position == 500 * 1638.4


async def test_a_taken_target_leaves_bit_4_to_fall_when_the_line_is_free(ran: Ran, soon: Deadline) -> None:
    """It should tell that it stands, let it fall once, and let it fall by itself before the next target rises."""
    axis, drive, line = ran
    for target, lets_go in ((700.0, True), (900.0, False), (1100.0, True)):
        await axis.begin_move(target, soon)
        while not await axis.arrived(soon):
            pass
        assert axis.holds_start
        assert drive.control == 0x3F
        if lets_go:
            await axis.let_go(soon)
            assert (axis.holds_start, drive.control) == (False, 0x0F)
            asked(line)
            await axis.let_go(soon)
            assert asked(line) == []
    assert drive.log[-3:] == [f"move {target * 1638.4:.0f}" for target in (700, 900, 1100)]


async def test_a_drive_that_dips_after_its_last_look_takes_no_set_point(ran: Ran, soon: Deadline) -> None:
    """It should not move, and the first look after the start says what happened."""
    axis, drive, _ = ran
    since_s = time.monotonic()
    await axis.status(soon)
    drive.power_cycle()
    await axis.aim(700.0, soon, since_s=since_s)
    await axis.go(soon)
    with pytest.raises(EmergencyStop):
        await axis.arrived(soon)
    assert drive.position == 0
    assert not any(entry.startswith("move 1146880") for entry in drive.log)


async def test_arrival_is_not_believed_before_the_set_point_was_taken(homed: Homed, soon: Deadline) -> None:
    """It should go on asking though target and bit 10 of the move before fit, and give up in time."""
    axis, drive = homed
    await axis.move_to(500.0, soon)
    drive.no_acknowledge = True
    await axis.begin_move(500.0, soon)
    assert not await axis.arrived(soon)

    async def wait() -> None:
        while not await axis.arrived(soon):
            pass

    with pytest.raises(MotionTimeout, match="not acknowledged"):
        await wait()


async def test_a_move_is_due_when_its_trapezoid_ends(ran: Ran, soon: Deadline) -> None:
    """It should reckon with the speed of this move, not only with the axis' own."""
    axis, _, _ = ran
    for target, speed, seconds in ((2500.0, None, 2 * math.sqrt(2000 / 1e5)), (500.0, 1000.0, 2.0 + 0.01)):
        before_s = time.monotonic()
        await axis.begin_move(target, soon, speed)
        after_s = time.monotonic()
        assert before_s + seconds <= axis.due_s <= after_s + seconds
        while not await axis.arrived(soon):
            pass


@pytest.mark.parametrize(("distance", "seconds"), [(0.0, 0.0), (-2.5, 0.1), (10.0, 0.2), (110.0, 1.2)])
def test_a_short_way_never_comes_to_full_speed(distance: float, seconds: float) -> None:
    """It should be two ramps, and a flat top only beyond both; 100 units/s and 1000 units/s2 here."""
    assert travel_s(distance, 100.0, 1000.0) == pytest.approx(seconds)


async def test_a_look_that_was_on_its_way_while_the_drive_was_stopped_is_not_believed(
    ran: Ran, soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should switch the drive on again for the next move, and not take it for running by what came late."""
    axis, drive, _ = ran
    answered, let_go = asyncio.Event(), asyncio.Event()
    look = DriveAccess.status

    async def late(access: DriveAccess, deadline: Deadline) -> AxisStatus:
        status = await look(access, deadline)
        answered.set()
        await let_go.wait()
        return status

    monkeypatch.setattr(DriveAccess, "status", late)
    looking = asyncio.create_task(axis.position(soon))
    await answered.wait()
    monkeypatch.setattr(DriveAccess, "status", look)
    await axis.halt()
    let_go.set()
    assert await looking == pytest.approx(500.0)
    assert axis.looked_at_s == -math.inf
    axis.release()
    await axis.aim(900.0, soon, since_s=0.0)
    await axis.go(soon)
    while not await axis.arrived(soon):  # noqa: ASYNC110 - each turn asks the drive
        await asyncio.sleep(CONFIG.poll_s)
    assert drive.position == pytest.approx(900.0 * 1638.4, abs=1638.4)


async def test_a_look_taken_while_the_drive_is_being_stopped_is_forgotten_with_the_stop(
    ran: Ran, soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should know nothing after a stop, though somebody looked on the ramp."""
    axis, _, _ = ran
    stop = PowerMachine.halt

    async def looked_at(power: PowerMachine) -> None:
        await axis.position(soon)
        await stop(power)

    monkeypatch.setattr(PowerMachine, "halt", looked_at)
    await axis.halt()
    assert axis.looked_at_s == -math.inf
