"""A jog takes one small step of one axis; never sideways low, never down to where something may be, never in doubt."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from daemon.config.sections.touching import ReferenceSection
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.jog import lowest_jog_um
from daemon.procedures.registry import PROCEDURES
from daemon.station.free_pin import FreePin
from daemon.wire.operations.table import OPERATIONS
from drivers.errors import EnvelopeViolation, Stalled
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import Ran, World, a_board, begin, probe_model, run

SAFE_UM, FREE_UM = 12_000.0, 5_600.0
STEPS = [("x", "by_um", 250.0), ("x", "by_um", -1000.0), ("y", "by_um", 5.0), ("theta", "by_deg", 5.0),
         ("theta", "by_deg", -0.1), ("z", "by_um", 1000.0), ("z", "by_um", -1000.0)]  # fmt: skip
FIELD = {"x": "x_um", "y": "y_um", "z": "z_um", "theta": "theta_deg"}


@pytest.fixture
def world(tmp_path: Path) -> World:
    """A homed station with the needle at the safe height."""
    return _at(World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {}), z_um=SAFE_UM)


def _at(world: World, **place: float) -> World:
    at = replace(world.gantry.reported, **place)
    world.gantry.reported = world.gantry.actual = at
    world.station.needle.reported(at)
    return world


async def _jog(world: World, axis: str, ran: Ran | None = None, **step: float) -> Ran:
    asked = {"op": "jog", "axis": axis, **step}
    return await run(world, PROCEDURES["jog"], {}, ran or begin(asked))


async def _refused(world: World, axis: str, **step: float) -> Exception:
    ran = begin({"op": "jog", "axis": axis, **step})
    with pytest.raises((Fault, EnvelopeViolation)) as caught:
        await _jog(world, axis, ran)
    assert world.gantry.moves == [], "it moved"
    assert ran.events == [], "the job went on"
    return caught.value


@pytest.mark.parametrize(("axis", "unit", "by"), STEPS)
async def test_a_step_moves_its_axis_by_so_much_and_no_other(world: World, axis: str, unit: str, by: float) -> None:
    before = world.gantry.reported
    ran = await _jog(world, axis, **{unit: by})
    assert [move for move, _ in world.gantry.moves] == [
        replace(before, **{FIELD[axis]: getattr(before, FIELD[axis]) + by})
    ]
    assert ran.events == [Event.DEPARTED, Event.ARRIVED]
    assert (ran.got.outcome, ran.job.moves) == ("jogged", 1)
    assert ran.got.detail["position"][FIELD[axis]] == pytest.approx(getattr(before, FIELD[axis]) + by)
    assert [kind for kind, _ in ran.steps] == ["move"]


async def test_down_it_goes_slowly_all_the_way(world: World) -> None:
    await _jog(world, "z", by_um=-1000.0)
    assert world.gantry.slow_z_um == [float("inf")]


# --- how low ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("z_um", [FREE_UM, 11_000.0, SAFE_UM - 5.1])
@pytest.mark.parametrize(("axis", "step"), [("x", {"by_um": 5.0}), ("y", {"by_um": -5.0}), ("theta", {"by_deg": 0.1})])
async def test_nothing_goes_sideways_below_the_safe_height(
    world: World, axis: str, step: dict[str, float], z_um: float
) -> None:
    fault = await _refused(_at(world, z_um=z_um), axis, **step)
    assert isinstance(fault, Fault)
    assert (fault.kind, fault.detail["least_z_um"]) == (FaultCode.OUTSIDE_ENVELOPE, SAFE_UM)
    assert "lift" in fault.advice


async def test_z_goes_down_to_where_no_surface_can_be_and_no_lower(world: World) -> None:
    _at(world, z_um=FREE_UM + 100.0)
    fault = await _refused(world, "z", by_um=-100.1)
    assert isinstance(fault, Fault)
    assert fault.detail["least_z_um"] == FREE_UM
    await _jog(world, "z", by_um=-100.0)
    assert world.gantry.reported.z_um == pytest.approx(FREE_UM)


async def test_from_lower_than_that_it_goes_up_and_not_down(world: World) -> None:
    _at(world, z_um=5_300.0)
    await _refused(world, "z", by_um=-5.0)
    await _jog(world, "z", by_um=50.0)
    assert world.gantry.reported.z_um == pytest.approx(5_350.0)


async def test_over_a_reference_pad_that_stands_high_z_stays_above_it(tmp_path: Path) -> None:
    board = a_board(("A", 10_000.0, 5_000.0))
    tip_um = World(tmp_path / "before", board, {}).tip_um()
    block = ReferenceSection(x_um=tip_um[0], y_um=tip_um[1], z_um=8_000.0)
    world = World(tmp_path, board, {"reference": block})
    _at(world, z_um=9_000.0)
    assert lowest_jog_um(world.context, world.gantry.reported) == pytest.approx(8_200.0)
    await _refused(world, "z", by_um=-801.0)
    await _jog(world, "z", by_um=-800.0)


# --- in doubt ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("axis", "unit", "by"), STEPS)
async def test_axes_without_their_reference_are_not_jogged(world: World, axis: str, unit: str, by: float) -> None:
    world.gantry.is_homed = False
    fault = await _refused(world, axis, **{unit: by})
    assert isinstance(fault, Fault)
    assert fault.kind is FaultCode.NOT_HOMED


@pytest.mark.parametrize(("axis", "unit", "by"), STEPS)
async def test_with_the_needle_down_nothing_is_jogged_up_neither(world: World, axis: str, unit: str, by: float) -> None:
    _at(world, z_um=4_900.0)
    fault = await _refused(world, axis, **{unit: by})
    assert isinstance(fault, Fault)
    assert fault.kind is FaultCode.NEEDLE_DOWN


@pytest.mark.parametrize(("axis", "unit", "by"), STEPS)
async def test_a_needle_that_nobody_saw_free_since_its_press_is_not_jogged(
    world: World, axis: str, unit: str, by: float
) -> None:
    world.station.pressing(FreePin(probe_model(), (800.0, 620.0), 4.0, FREE_UM))
    fault = await _refused(world, axis, **{unit: by})
    assert isinstance(fault, Fault)
    assert fault.kind is FaultCode.LOOK_NEEDED


async def test_a_reference_in_doubt_is_no_place_to_jog_from(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(world.station.needle, "_in_doubt", lambda: True)
    fault = await _refused(world, "z", by_um=100.0)
    assert isinstance(fault, Fault)
    assert fault.kind is FaultCode.NEEDLE_DOWN


# --- how far ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("place", "axis", "step"),
    [
        ({"x_um": "maximum"}, "x", {"by_um": 5.0}), ({"x_um": "minimum"}, "x", {"by_um": -5.0}),
        ({"y_um": "maximum"}, "y", {"by_um": 100.0}), ({"y_um": "minimum"}, "y", {"by_um": -100.0}),
        ({"z_um": "maximum"}, "z", {"by_um": 5.0}),
        ({"theta_deg": "maximum"}, "theta", {"by_deg": 0.2}), ({"theta_deg": "minimum"}, "theta", {"by_deg": -0.2}),
    ],
)  # fmt: skip
async def test_a_step_over_the_end_of_an_axis_is_refused_before_it_begins(
    world: World, place: dict[str, str], axis: str, step: dict[str, float]
) -> None:
    ((name, end),) = place.items()
    await _refused(_at(world, **{name: getattr(getattr(world.config.axes, axis), end)}), axis, **step)


async def test_where_there_is_no_room_to_come_from_one_side_nothing_begins(world: World) -> None:
    least = world.config.axes.x.minimum
    _at(world, x_um=least + 500.0)
    room = world.config.gantry.approach_um
    await _refused(world, "x", by_um=-(500.0 - room / 2))
    await _jog(world, "x", by_um=-(500.0 - room))


@pytest.mark.parametrize(
    "step",
    [
        {"axis": "x"}, {"axis": "x", "by_deg": 1.0}, {"axis": "theta", "by_um": 10.0}, {"axis": "w", "by_um": 10.0},
        {"axis": "x", "by_um": 10.0, "by_deg": 1.0}, {"axis": "x", "by_um": 0.0}, {"axis": "z", "by_um": -4.9},
        {"axis": "x", "by_um": 1000.1}, {"axis": "z", "by_um": -1000.1}, {"axis": "theta", "by_deg": 5.01},
        {"axis": "theta", "by_deg": 0.05}, {"axis": "x", "by_um": float("nan")}, {"axis": "x", "by_um": "100"},
        {"axis": "x", "by_um": float("inf")},
    ],
    ids=str,
)  # fmt: skip
def test_what_is_no_small_step_of_one_axis_is_no_request(step: dict[str, Any]) -> None:
    with pytest.raises(Fault) as caught:
        OPERATIONS.parse({"op": "jog", "id": "j", **step})
    assert caught.value.kind is FaultCode.INVALID_REQUEST


def test_a_jog_is_for_maintenance() -> None:
    assert OPERATIONS.row("jog").least_role == "maintain"


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    x_um=st.floats(0.0, 1.0), y_um=st.floats(0.0, 1.0), z_um=st.floats(0.0, 1.0), theta_deg=st.floats(-220.0, 100.0),
    axis=st.sampled_from(["x", "y", "z", "theta"]), by=st.floats(-1.0, 1.0), data=st.data(),
)  # fmt: skip
async def test_wherever_it_stands_whatever_is_asked_the_limits_hold(
    world: World, x_um: float, y_um: float, z_um: float, theta_deg: float, axis: str, by: float, data: st.DataObject
) -> None:
    axes = world.config.axes
    spread = {
        name: (axis.minimum + share * (axis.maximum - axis.minimum))
        for name, axis, share in (("x_um", axes.x, x_um), ("y_um", axes.y, y_um), ("z_um", axes.z, z_um))
    }
    world.gantry.moves.clear()
    before = _at(world, **spread, theta_deg=theta_deg).gantry.reported
    step = {"by_deg": by * 5.0} if axis == "theta" else {"by_um": by * 1000.0}
    try:
        await _jog(world, axis, **step)
    except (Fault, EnvelopeViolation):
        assert world.gantry.moves == []
        return
    ((target, _),) = world.gantry.moves
    assert {name for name in FIELD.values() if getattr(target, name) != getattr(before, name)} <= {FIELD[axis]}
    if axis == "z":
        assert abs(target.z_um - before.z_um) <= 1000.0 + 1e-6
        assert target.z_um >= min(before.z_um, FREE_UM)
    else:
        assert before.z_um >= SAFE_UM - 5.0
        most = 5.0 if axis == "theta" else 1000.0
        assert abs(getattr(target, FIELD[axis]) - getattr(before, FIELD[axis])) <= most + 1e-6


# --- how it ends ------------------------------------------------------------------------------------------------


async def test_an_axis_that_fails_never_arrives(world: World) -> None:
    world.gantry.failures[1] = Stalled("blocked", device="x")
    ran = begin({"op": "jog", "axis": "x", "by_um": 100.0})
    with pytest.raises(Stalled):
        await _jog(world, "x", ran)
    assert ran.events == [Event.DEPARTED]


async def test_after_a_jog_the_head_stands_over_no_point(world: World) -> None:
    here = world.gantry.reported
    world.station.needle.stand.came("A", "", here, seen=True)
    await _jog(world, "x", by_um=5.0)
    with pytest.raises(Fault) as caught:
        world.station.needle.stand.require("A", "", Position(here.x_um, here.y_um, here.z_um, here.theta_deg), 60.0)
    assert caught.value.kind is FaultCode.NOT_AT_TEST_POINT
