"""Four drives on one line as one machine: homing, ways, ranges, heights."""

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from drivers.deadline import Deadline
from drivers.errors import (
    EmergencyStop,
    EnvelopeViolation,
    NotHomed,
    Stalled,
)
from drivers.gantry import Approach, Gantry, GantryConfig, Position
from drivers.l4118 import Axis, AxisConfig, HomingConfig
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.gantry.machine import AXES, PLACE, Machine, make_machine
from tests.drivers.peers.drive import DriveModel


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
    machine = await make_machine(make_line, open_bus, AXES | {"z": low})
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


@pytest.mark.parametrize(
    ("approach", "times"), [(None, 2), (Approach(60.0, 60.0, 0.5), 2), (Approach(0.0, 0.0, 0.0), 1)]
)
async def test_a_move_down_an_axis_turns_back_below_its_target_where_its_play_asks_for_it(
    homed: Machine, soon: Deadline, approach: Approach | None, times: int
) -> None:
    await homed.gantry.move_to(PLACE, soon)
    order: list[str] = []
    homed.drives["x"].log = _Recorder("x", order)
    await homed.gantry.move_to(dataclasses.replace(PLACE, x_um=50000.0), soon, approach=approach)
    assert [entry.split()[0] for _, entry in order].count("move") == times
    assert homed.at("x") == pytest.approx(50000.0, abs=0.01)


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
    homed.slow(500_000)
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
    machine = await make_machine(make_line, open_bus, AXES, SLOW)
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
    machine = await make_machine(make_line, open_bus, AXES, SLOW)
    await machine.gantry.home(soon)
    for drive in machine.drives.values():
        drive.log.clear()
    for z_um in (4199.9, 0.0):
        with pytest.raises(EnvelopeViolation, match="below the floor at 4200"):
            await machine.gantry.move_to(dataclasses.replace(PLACE, z_um=z_um), soon)
    assert all(drive.log == [] for drive in machine.drives.values())
    await machine.gantry.move_to(dataclasses.replace(PLACE, z_um=4200.0), soon)
