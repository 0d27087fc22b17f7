"""What stops a machine of four drives, and in which order; what a stop that failed leaves to do."""

import asyncio
import dataclasses
from collections.abc import Callable, Iterable
from typing import Any

import pytest

from drivers.deadline import Deadline
from drivers.errors import (
    DeviceError,
    DriveFault,
    EmergencyStop,
    LinkError,
    MotionError,
    MotionTimeout,
    Stalled,
)
from drivers.gantry import Gantry, GantryConfig
from drivers.l4118 import Axis
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.gantry.machine import AXES, PLACE, Machine
from tests.drivers.peers.drive import DriveModel, several


async def test_a_cancelled_move_stops_every_axis(homed: Machine, soon: Deadline) -> None:
    """It should stop all before the cancellation goes on, even if cancelled twice."""
    homed.slow(100_000)
    task = asyncio.create_task(homed.gantry.move_to(PLACE, soon))
    await homed.under_way(task)
    task.cancel()
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert all(drive.state != 0x27 for drive in homed.drives.values())
    assert not homed.gantry.moving
    homed.slow(20_000_000)
    await homed.gantry.move_to(PLACE, soon)
    assert homed.at("x") == pytest.approx(60000.0, abs=0.01)


@pytest.mark.parametrize(
    ("spoil", "error"),
    [
        (lambda m: m.drives["y"].fail(0x3210, 0x01003210), DriveFault),
        (lambda m: setattr(m.drives["y"], "stuck", True), Stalled),
        (lambda m: m.drives["y"].power_cycle(), EmergencyStop),
        (lambda m: m.drives["y"].fail(0x3220, 0x03043220), EmergencyStop),
        (lambda m: setattr(m.drives["y"], "silent", True), LinkError),
        (lambda m: m.line.unplug(), LinkError),
    ],
    ids=["fault", "stuck", "power cut", "supply cut", "silent", "cable out"],
)
async def test_one_failing_axis_stops_the_others(
    homed: Machine, soon: Deadline, spoil: Callable[[Any], object], error: type[DeviceError]
) -> None:
    """It should raise what happened and leave no reachable axis running."""
    homed.slow(100_000)
    task = asyncio.create_task(homed.gantry.move_to(PLACE, soon))
    await homed.under_way(task)
    spoil(homed)
    with pytest.raises(error):
        await task
    if homed.line.plugged:
        assert all(drive.state != 0x27 for name, drive in homed.drives.items() if name != "y")


STANDING_TROUBLE: dict[str, tuple[Callable[[DriveModel], object], type[DeviceError]]] = {
    "fault": (lambda drive: drive.fail(0x3210, 0x01003210), DriveFault),
    "supply cut": (lambda drive: drive.fail(0x3220, 0x03043220), EmergencyStop),
    "power cut": (lambda drive: drive.power_cycle(), EmergencyStop),
    "silent": (lambda drive: setattr(drive, "silent", True), LinkError),
}


@pytest.mark.parametrize("trouble", STANDING_TROUBLE)
@pytest.mark.parametrize("axis", ["z", "theta"])
async def test_an_axis_that_fails_while_others_travel_stops_them_on_their_way(
    homed: Machine, axis: str, trouble: str
) -> None:
    """It should look at all axes in each round, not only at those of the leg."""
    spoil, error = STANDING_TROUBLE[trouble]
    homed.slow(100_000)
    target, deadline = dataclasses.replace(PLACE, theta_deg=0.0), Deadline.after(60.0)
    task = asyncio.create_task(homed.gantry.move_to(target, deadline))
    await homed.under_way(task)
    spoil(homed.drives[axis])
    with pytest.raises(error):
        await task
    assert homed.at("x") < PLACE.x_um - 5_000.0, "it went on to its target"
    assert all(homed.drives[name].state != 0x27 for name in ("x", "y"))


@pytest.mark.parametrize(
    ("homing", "standing"), [("z", "x"), ("z", "theta"), ("theta", "z"), ("x", "z"), ("y", "theta")]
)
async def test_an_axis_that_stands_and_faults_while_another_homes_stops_it_at_once(
    homed: Machine, soon: Deadline, homing: str, standing: str
) -> None:
    """It should not go on to look for a switch with an axis that is not held any more."""
    homed.drives[homing].homing_looks = 1_000_000
    task = asyncio.create_task(homed.gantry.home(soon))
    while homed.drives[homing].log[-1:] != ["homing"]:
        assert not task.done(), task
        await asyncio.sleep(0.001)
    homed.drives[standing].fail(0x4310, 0x02004310)
    with pytest.raises(DriveFault, match="4310h") as told:
        await task
    assert told.value.device.lower() == standing
    assert all(drive.state != 0x27 for drive in homed.drives.values())
    assert not homed.gantry.moving


async def test_an_axis_that_was_never_switched_on_may_stand_so_while_others_travel(
    homed: Machine, soon: Deadline
) -> None:
    """It should not take a drive for failed that nobody has enabled since the start."""
    await homed.gantry.quick_stop()
    await homed.gantry.move_to(dataclasses.replace(PLACE, theta_deg=0.0), soon)
    assert homed.at("x") == pytest.approx(60000.0, abs=0.01)


class _Dip:
    """A drive that restarts before a certain request to any drive of the line."""

    def __init__(self, machine: Machine, axis: str) -> None:
        self.left: int | None = None
        self.asked = 0
        self._drive = machine.drives[axis]
        self._answer = machine.line.answer

    def __call__(self, request: bytes) -> list[Any]:
        self.asked += 1
        if self.left is not None:
            self.left -= 1
            if self.left == 0:
                self._drive.power_cycle()
        return self._answer(request)


@pytest.mark.parametrize("axis", ["y", "z"])
async def test_a_dip_before_any_request_of_a_move_moves_no_drive_that_lost_its_count(
    homed: Machine, soon: Deadline, axis: str
) -> None:
    """It should leave that drive where it is, and be named: by the move, which ends with all drives off, or else next.

    Else: it came after the move's last look at that drive, of which not more than four requests are left then.
    """
    away = dataclasses.replace(PLACE, x_um=61_000.0, y_um=41_000.0)
    await homed.gantry.move_to(PLACE, soon)
    dip = _Dip(homed, axis)
    homed.line.answer = dip
    await homed.gantry.move_to(away, soon)
    total = dip.asked
    for before in range(1, total + 1, 2):
        await homed.gantry.home(Deadline.after(30.0))
        await homed.gantry.move_to(PLACE, Deadline.after(30.0))
        dip.left = before
        homed.line.requests.clear()
        try:
            await homed.gantry.move_to(away, Deadline.after(30.0))
        except DeviceError:
            assert all(drive.state != 0x27 for drive in homed.drives.values()), before
        else:
            late = homed.line.requests[before - 1 :]
            assert len(late) <= 4, before
            assert not any(one[:2] == bytes([AXES[axis].address, 3]) for one in late), "it was looked at after that"
            with pytest.raises(EmergencyStop, match="lost power"):
                await homed.gantry.homed()
            await homed.gantry.quick_stop()
        assert homed.drives[axis].position == 0, before
        dip.left = None
        await homed.gantry.start(Deadline.after(30.0))


async def test_a_deadline_stops_every_axis(homed: Machine) -> None:
    """It should raise MotionTimeout with all axes off."""
    homed.slow(10_000)
    with pytest.raises(MotionTimeout, match="deadline"):
        await homed.gantry.move_to(PLACE, Deadline.after(0.5))
    assert all(drive.state != 0x27 for drive in homed.drives.values())


async def test_a_quick_stop_ends_the_move(homed: Machine, soon: Deadline) -> None:
    """It should get through to all axes while a move polls them, and the move raises EmergencyStop."""
    homed.slow(100_000)
    task = asyncio.create_task(homed.gantry.move_to(PLACE, soon))
    await homed.under_way(task)
    await homed.gantry.quick_stop()
    assert all(drive.control == 0x02 for drive in homed.drives.values())
    with pytest.raises(EmergencyStop):
        await task
    assert await homed.gantry.homed(soon)


async def test_a_quick_stop_reaches_the_axes_that_answer(homed: Machine, soon: Deadline) -> None:
    """It should stop the others although one drive is silent, and then say so."""
    homed.drives["x"].silent = True
    with pytest.raises(DeviceError, match="no answer"):
        await homed.gantry.quick_stop()
    assert all(homed.drives[name].control == 0x02 for name in ("y", "z", "theta"))


async def test_an_axis_that_could_not_be_stopped_is_stopped_once_it_answers(homed: Machine, soon: Deadline) -> None:
    """It should leave alone those that stopped, halt the one that was silent, and ask nothing more of it then."""
    homed.slow(2000)
    task = asyncio.create_task(homed.gantry.move_to(PLACE, soon))
    await homed.under_way(task)
    homed.drives["x"].silent = True
    with pytest.raises(LinkError):
        await task
    await homed.gantry.stop_again()
    assert homed.gantry.unstopped == ("x",)
    homed.drives["x"].silent = False
    assert homed.drives["x"].state == 0x27, "nobody could stop it"
    await homed.gantry.stop_again()
    assert homed.drives["x"].state == 0x21
    asked = len(homed.line.requests)
    await homed.gantry.stop_again()
    assert len(homed.line.requests) == asked


async def test_a_second_move_is_refused_and_the_first_goes_on(homed: Machine, soon: Deadline) -> None:
    """It should not mix two moves."""
    homed.slow(1_000_000)
    task = asyncio.create_task(homed.gantry.move_to(PLACE, soon))
    await homed.under_way(task)
    with pytest.raises(MotionError, match="under way"):
        await homed.gantry.move_to(dataclasses.replace(PLACE, x_um=1.0), soon)
    await task
    assert homed.at("x") == pytest.approx(60000.0, abs=0.01)


async def test_a_failed_homing_of_one_axis_stops_the_other(machine: Machine, soon: Deadline) -> None:
    """It should raise the axis' own error, not a group of them, and leave the machine unhomed."""
    machine.drives["x"].homing_fails = True
    machine.drives["y"].homing_looks = 10**9
    with pytest.raises(MotionError, match="method 17 failed"):
        await machine.gantry.home(soon)
    assert all(drive.state != 0x27 for drive in machine.drives.values())
    assert not await machine.gantry.homed(soon)


async def test_what_a_silent_line_left_running_is_stopped_when_the_line_is_back(homed: Machine, soon: Deadline) -> None:
    """It should know the axes whose stop was not confirmed, stop them on the next try, and then know of none."""
    homed.drives["x"].step = 1000
    task = asyncio.create_task(homed.gantry.move_to(PLACE, soon))
    await homed.under_way(task)
    for drive in homed.drives.values():
        drive.silent = True
    with pytest.raises(LinkError):
        await task
    assert "x" in homed.gantry.unstopped
    for drive in homed.drives.values():
        drive.silent = False
    assert homed.drives["x"].state == 0x27
    await homed.gantry.stop_again()
    assert all(drive.state != 0x27 for drive in homed.drives.values())
    assert homed.gantry.unstopped == ()


async def test_a_new_move_begins_with_the_stop_that_is_missing(homed: Machine, soon: Deadline) -> None:
    """It should refuse to move while that cannot be had."""
    homed.slow(1000)
    task = asyncio.create_task(homed.gantry.move_to(PLACE, soon))
    await homed.under_way(task)
    homed.drives["x"].silent = True
    with pytest.raises(LinkError):
        await task
    for drive in homed.drives.values():
        drive.log.clear()
    with pytest.raises(LinkError, match="may still run, and could not be stopped: x"):
        await homed.gantry.move_to(PLACE, soon)
    assert all(drive.log == [] for drive in homed.drives.values())
    homed.drives["x"].silent = False
    homed.slow(20_000_000)
    await homed.gantry.move_to(PLACE, soon)
    assert homed.drives["x"].log[0] == "27->21"


async def test_a_silent_drive_does_not_keep_the_start_from_stopping_another(
    make_line: MakeLine, open_bus: OpenBus, homed: Machine, soon: Deadline
) -> None:
    """It should halt what a former owner left running, though a drive before it does not answer."""
    homed.slow(1000)
    task = asyncio.create_task(homed.gantry.move_to(PLACE, soon))
    await homed.under_way(task)
    line = make_line(several(*homed.drives.values()))
    bus = await open_bus(line, timeout_s=0.05, attempts=1)
    again = Gantry({name: Axis(bus, config) for name, config in AXES.items()}, GantryConfig())
    homed.drives["x"].silent = True
    homed.drives["theta"].state = 0x27
    with pytest.raises(LinkError):
        await again.start(soon)
    assert homed.drives["theta"].state == 0x40
    homed.drives["x"].silent = False
    with pytest.raises(DeviceError):
        await task


@pytest.mark.parametrize(
    ("failing", "moving"), [("z", ("x", "y")), ("theta", ("x", "y")), ("y", ("x",)), ("x", ("y",))]
)
async def test_what_moves_is_told_to_stop_before_the_drive_that_failed_is_asked_why(
    homed: Machine, failing: str, moving: tuple[str, ...]
) -> None:
    """It should cost the axes that travel two requests from the look that shows it, not eight."""
    homed.slow(100_000)
    target = dataclasses.replace(PLACE, theta_deg=0.0)
    task = asyncio.create_task(homed.gantry.move_to(target, Deadline.after(60.0)))
    await homed.under_way(task)
    homed.drives[failing].fail(0x3210, 0x01003210)
    homed.line.requests.clear()
    with pytest.raises(DriveFault, match="3210h"):
        await task
    # Slave, object and the upper byte of what is written: bit 8 of the controlword is the halt
    told = [(request[0], request[6:8].hex(), request[14] if request[3] & 1 else 0) for request in homed.line.requests]
    asked_why = told.index((AXES[failing].address, "603f", 0))
    assert all(told.index((AXES[name].address, "6040", 1)) < asked_why for name in moving)
    assert all(homed.drives[name].state != 0x27 for name in moving)


async def _until_homing(machine: Machine, names: Iterable[str], task: asyncio.Task[None]) -> None:
    """Wait until each of these axes looks for its switch."""
    while any(machine.drives[name].log[-1:] != ["homing"] for name in names):
        assert not task.done(), task
        await asyncio.sleep(0.001)


@pytest.mark.parametrize(
    ("failing", "homing"),
    [("x", ("z",)), ("theta", ("z",)), ("z", ("theta",)), ("z", ("x", "y")), ("y", ("x",)), ("x", ("y",))],
)
async def test_what_homes_is_told_to_stop_before_the_drive_that_failed_is_asked_why(
    homed: Machine, soon: Deadline, failing: str, homing: tuple[str, ...]
) -> None:
    """It should cost an axis that looks for its switch no more than one that travels."""
    both = set(homing) | {failing} == {"x", "y"}
    for name in (*homing, failing) if both else homing:
        homed.drives[name].homing_looks = 1_000_000
    task = asyncio.create_task(homed.gantry.home(soon))
    await _until_homing(homed, homing, task)
    homed.drives[failing].fail(0x3210, 0x01003210)
    homed.line.requests.clear()
    with pytest.raises(DriveFault, match="3210h"):
        await task
    told = [(request[0], request[6:8].hex(), request[14] if request[3] & 1 else 0) for request in homed.line.requests]
    asked_why = told.index((AXES[failing].address, "603f", 0))
    assert all(told.index((AXES[name].address, "6040", 1)) < asked_why for name in homing)
    assert all(drive.state != 0x27 for drive in homed.drives.values())


async def test_a_homing_run_that_fails_stops_the_other_as_it_stops_itself(homed: Machine, soon: Deadline) -> None:
    """It should not first wait until its own axis stands: a ramp takes long, and the other goes on for as long."""
    homed.drives["y"].homing_looks = 1_000_000
    homed.drives["x"].homing_looks = 1_000_000
    task = asyncio.create_task(homed.gantry.home(soon))
    await _until_homing(homed, ("x", "y"), task)
    homed.drives["x"].heeds_halt = False
    homed.drives["x"].homing_fails, homed.drives["x"].homing_left = True, 1
    homed.line.requests.clear()
    with pytest.raises(MotionError, match="method 17 failed"):
        await task
    told = [(one[0], one[6:8].hex(), one[13:15][::-1].hex()) for one in homed.line.requests if one[3] & 1]
    assert told.index((AXES["y"].address, "6040", "010f")) < told.index((AXES["x"].address, "6040", "0006"))
