"""Four drives on one line as one machine."""

import asyncio
import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import pytest

from drivers.deadline import Deadline
from drivers.errors import (
    DeviceError,
    DriveFault,
    EmergencyStop,
    EnvelopeViolation,
    LinkError,
    MotionError,
    MotionTimeout,
    NotHomed,
    Stalled,
)
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


async def _machine(
    make_line: MakeLine,
    open_bus: OpenBus,
    axes: Mapping[str, AxisConfig],
    config: GantryConfig = GantryConfig(),  # noqa: B008 - frozen
) -> Machine:
    drives = {name: DriveModel(config.address, step=20_000_000) for name, config in axes.items()}
    line = make_line(several(*drives.values()))
    bus = await open_bus(line, timeout_s=0.4, late_reply_s=0.4, attempts=2)
    return Machine(Gantry({name: Axis(bus, c) for name, c in axes.items()}, config), drives, line)


@pytest.fixture
async def machine(make_line: MakeLine, open_bus: OpenBus) -> Machine:
    return await _machine(make_line, open_bus, AXES)


@pytest.fixture
async def homed(machine: Machine, soon: Deadline) -> Machine:
    await machine.gantry.home(soon)
    for drive in machine.drives.values():
        drive.log.clear()
    return machine


async def test_start_moves_nothing_and_homing_is_wanted(machine: Machine, soon: Deadline) -> None:
    """It should identify all drives, enable none, and refuse a move."""
    found = await machine.gantry.start(soon)
    assert list(found) == ["x", "y", "z", "theta"]
    assert all(drive.log == [] for drive in machine.drives.values())
    assert not await machine.gantry.homed()
    with pytest.raises(NotHomed, match="x, y, z, theta"):
        await machine.gantry.move_to(PLACE, soon)
    assert all(drive.log == [] for drive in machine.drives.values())


async def test_homing_takes_z_first_and_leaves_it_high(machine: Machine, soon: Deadline) -> None:
    """It should home Z before anything moves sideways."""
    order: list[str] = []
    for name, drive in machine.drives.items():
        drive.log = _Recorder(name, order)
    await machine.gantry.home(soon)
    homings = [name for name, entry in order if entry == "homing"]
    assert homings[:2] == ["z", "theta"]
    assert sorted(homings[2:]) == ["x", "y"]
    assert await machine.gantry.homed(soon)
    assert await machine.gantry.position(soon) == Position(0.0, 0.0, 30000.0, 0.0)


class _Recorder(list):
    def __init__(self, name: str, shared: list) -> None:
        super().__init__()
        self.name, self.shared = name, shared

    def append(self, entry: str) -> None:
        self.shared.append((self.name, entry))


async def test_homing_lifts_a_z_that_homes_below(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> None:
    """It should go up to the safe height before the head turns or goes aside."""
    low = dataclasses.replace(AXES["z"], homing=HomingConfig(method=17))
    machine = await _machine(make_line, open_bus, AXES | {"z": low})
    await machine.gantry.home(soon)
    assert (await machine.gantry.position(soon)).z_um == 12000.0


async def test_a_move_ends_on_its_target_on_a_safe_way(homed: Machine, soon: Deadline) -> None:
    """It should pass only through safe places and report where it is, theta as axis coordinate."""
    order: list[str] = []
    for name, drive in homed.drives.items():
        drive.log = _Recorder(name, order)
    reached = await homed.gantry.move_to(PLACE, soon)
    assert reached.x_um == pytest.approx(60000.0, abs=0.01)
    assert reached.theta_deg == pytest.approx(-10.0, abs=0.001)
    assert homed.at("z") == pytest.approx(5200.0, abs=0.001)
    order.clear()
    await homed.gantry.move_to(dataclasses.replace(PLACE, x_um=60010.0), soon)
    moves = [name for name, entry in order if entry.startswith("move")]
    assert moves[0] == "z"
    assert moves[-1] == "z"
    assert moves.count("x") == 2


async def test_a_pure_z_move_leaves_the_others_alone(homed: Machine, soon: Deadline) -> None:
    """It should not touch X, Y and theta, nor retract."""
    await homed.gantry.move_to(PLACE, soon)
    for drive in homed.drives.values():
        drive.log.clear()
    await homed.gantry.move_to(dataclasses.replace(PLACE, z_um=5000.0), soon)
    assert [name for name, drive in homed.drives.items() if drive.log] == ["z"]
    assert len(homed.drives["z"].log) == 1


@pytest.mark.parametrize(
    "change",
    [{"x_um": -1.0}, {"x_um": 200001.0}, {"y_um": 150001.0}, {"z_um": 30001.0}, {"theta_deg": 120.0}],
)
async def test_targets_outside_are_refused_before_anything_moves(
    homed: Machine, soon: Deadline, change: dict[str, Any]
) -> None:
    """It should check all axes first."""
    with pytest.raises(EnvelopeViolation):
        await homed.gantry.move_to(dataclasses.replace(PLACE, **change), soon)
    assert all(drive.log == [] for drive in homed.drives.values())


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


async def test_standing_axes_are_asked_once_a_round_and_those_under_way_too(homed: Machine, soon: Deadline) -> None:
    """It should cost the line one short question for each axis that stands."""
    asked: dict[str, int] = dict.fromkeys(AXES, 0)

    def counting(name: str, drive: DriveModel) -> Callable[[], None]:
        look = drive.look

        def count() -> None:
            asked[name] += 1
            look()

        return count

    await homed.gantry.move_to(dataclasses.replace(PLACE, z_um=12_000.0), soon)
    for name, drive in homed.drives.items():
        drive.look = counting(name, drive)  # type: ignore[method-assign]
    homed.slow(1_000_000)
    await homed.gantry.move_to(dataclasses.replace(PLACE, z_um=9_000.0), soon)
    assert asked["z"] > 5, "it travelled for some rounds"
    assert all(0 < asked[name] <= asked["z"] for name in ("x", "y", "theta")), asked


async def test_the_axes_of_a_leg_are_started_back_to_back(homed: Machine, soon: Deadline) -> None:
    """It should write both targets, and then both commands: nothing is asked in between."""
    await homed.gantry.move_to(dataclasses.replace(PLACE, z_um=12_000.0), soon)
    homed.line.requests.clear()
    await homed.gantry.move_to(dataclasses.replace(PLACE, x_um=61_000.0, y_um=41_000.0, z_um=12_000.0), soon)
    told = [
        (request[0], request[6:8].hex()) for request in homed.line.requests if request[1] == 0x2B and request[3] & 1
    ]
    assert told[:4] == [(1, "607a"), (2, "607a"), (1, "6040"), (2, "6040")]


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
    """It should be named however late it comes, end the move with all drives off, and leave that one where it is."""
    away = dataclasses.replace(PLACE, x_um=61_000.0, y_um=41_000.0)
    await homed.gantry.move_to(PLACE, soon)
    dip = _Dip(homed, axis)
    homed.line.answer = dip
    await homed.gantry.move_to(away, soon)
    total = dip.asked
    for before in range(1, total, 5):
        await homed.gantry.home(Deadline.after(30.0))
        await homed.gantry.move_to(PLACE, Deadline.after(30.0))
        dip.left = before
        with pytest.raises(DeviceError):
            await homed.gantry.move_to(away, Deadline.after(30.0))
        assert homed.drives[axis].position == 0, before
        assert all(drive.state != 0x27 for drive in homed.drives.values()), before
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


async def test_an_axis_that_slipped_is_found_at_the_end(homed: Machine, soon: Deadline) -> None:
    """It should compare all four axes with the target, not only the one that moved last."""

    class SlipsWhenZComesDown(list):
        def append(self, entry: str) -> None:
            if entry == f"move {(5200 - 30000) * 1638.4:.0f}":
                homed.drives["y"].position += 10_000
                homed.drives["y"].goal += 10_000

    homed.drives["z"].log = SlipsWhenZComesDown()
    with pytest.raises(Stalled, match=r"Y: y is at 40015.2588, \+15.2588 off its target"):
        await homed.gantry.move_to(PLACE, soon)


async def test_a_reference_lost_at_rest_is_named_by_its_axis(homed: Machine, soon: Deadline) -> None:
    """It should say which drive lost its power, and ask for homing once that is dealt with."""
    homed.drives["z"].power_cycle()
    with pytest.raises(EmergencyStop, match="lost power") as caught:
        await homed.gantry.homed(soon)
    assert caught.value.device == "Z"
    await homed.gantry.forget_homing(soon)
    assert not await homed.gantry.homed(soon)


async def test_health_and_reset_go_over_all_axes(homed: Machine, soon: Deadline) -> None:
    """It should tell the faulty one, and clear it."""
    homed.drives["theta"].fail(0x3210, 0x01003210)
    health = await homed.gantry.health(soon)
    assert [entry.name for entry in health] == ["X", "Y", "Z", "theta"]
    assert "over-voltage" in health[3].error_meaning
    await homed.gantry.reset(soon)
    assert (await homed.gantry.health(soon))[3].error_code == 0


@pytest.mark.parametrize(
    ("axes", "config", "text"),
    [
        ({"x": AXES["x"]}, GantryConfig(), "needs the axes"),
        (AXES, GantryConfig(safe_z_um=40000.0), "safe_z_um"),
        ({**AXES, "theta": dataclasses.replace(AXES["theta"], max_units=110.0)}, GantryConfig(), "theta range"),
    ],
)
async def test_an_impossible_machine_is_refused(
    make_line: MakeLine, open_bus: OpenBus, axes: dict[str, AxisConfig], config: GantryConfig, text: str
) -> None:
    """It should not be built: the head's range above all must not reach the band."""
    bus = await open_bus(make_line(lambda _: []))
    with pytest.raises(ValueError, match=text):
        Gantry({name: Axis(bus, c) for name, c in axes.items()}, config)


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
    ("name", "read_back", "end"),
    [("theta_deg", -220.0001, -220.0), ("theta_deg", 100.0001, 100.0), ("x_um", -0.0008, 0.0)],
)
async def test_what_an_end_of_the_range_reads_back_is_in_the_range(
    homed: Machine, soon: Deadline, name: str, read_back: float, end: float
) -> None:
    """It should take a place that a drive said it is at, a rounded increment outside, for the end itself."""
    target = dataclasses.replace(PLACE, **{name: read_back})
    assert getattr(homed.gantry.check(target), name) == pytest.approx(end, abs=1e-9)
    if end > 0:
        reached = await homed.gantry.move_to(target, soon)
        assert getattr(await homed.gantry.move_to(reached, soon), name) == pytest.approx(end, abs=0.002)


@pytest.mark.parametrize(("name", "at", "end"), [("x", 20.0, 0), ("y", 0.0, 0), ("theta", 140.3, -220)])
async def test_a_target_without_room_to_come_from_below_is_refused_by_name(
    homed: Machine, soon: Deadline, name: str, at: float, end: float
) -> None:
    """It should not come to it from the wrong flank; an axis that is there already is left alone."""
    await homed.gantry.move_to(PLACE, soon)
    for drive in homed.drives.values():
        drive.log.clear()
    field = f"{name}_{'deg' if name == 'theta' else 'um'}"
    with pytest.raises(EnvelopeViolation, match=f"{name} .* is too near to the end {end}"):
        await homed.gantry.move_to(dataclasses.replace(PLACE, **{field: at}), soon)
    assert not any(entry.startswith("move") for drive in homed.drives.values() for entry in drive.log)


async def test_an_axis_that_stands_at_its_end_stays_there_while_the_others_move(homed: Machine, soon: Deadline) -> None:
    """It should allow what asks for no move of that axis, such as raising the needle after homing."""
    await homed.gantry.move_to(Position(0.0, 0.0, 12000.0, 0.0), soon)
    assert homed.at("x") == 0.0


# ---------------------------------------------------------------- down to a surface
SLOW = GantryConfig(slow_z_um=5500.0, slow_um_s=2000.0, floor_z_um=4200.0)


async def test_z_meets_a_surface_slowly(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> None:
    """It should lower Z slowly where a surface may be, and lift it at full speed."""
    machine = await _machine(make_line, open_bus, AXES, SLOW)
    await machine.gantry.home(soon)
    z = machine.drives["z"]
    await machine.gantry.move_to(dataclasses.replace(PLACE, z_um=5000.0), soon)
    # 2 mm/s of a 2 mm screw; the axis' own speed is 10 mm/s
    assert (z.od[0x6081, 0][1], z.log[-2:]) == (60, [f"move {-24500 * 1638.4:.0f}", f"move {-25000 * 1638.4:.0f}"])
    await machine.gantry.move_to(dataclasses.replace(PLACE, z_um=5600.0), soon)
    assert z.od[0x6081, 0][1] == 300
    await machine.gantry.move_to(dataclasses.replace(PLACE, z_um=5200.0), soon, slow_z_um=5100.0)
    assert z.od[0x6081, 0][1] == 300, "a caller that knows the surface says so"


async def test_nothing_is_sent_below_the_floor(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> None:
    """It should refuse the target before anything moves, though the axis could go there."""
    machine = await _machine(make_line, open_bus, AXES, SLOW)
    await machine.gantry.home(soon)
    for drive in machine.drives.values():
        drive.log.clear()
    for z_um in (4199.9, 0.0):
        with pytest.raises(EnvelopeViolation, match="below the floor at 4200"):
            await machine.gantry.move_to(dataclasses.replace(PLACE, z_um=z_um), soon)
    assert all(drive.log == [] for drive in machine.drives.values())
    await machine.gantry.move_to(dataclasses.replace(PLACE, z_um=4200.0), soon)


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
