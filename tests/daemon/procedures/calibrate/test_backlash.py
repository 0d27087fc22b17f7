"""Backlash is how much farther the tip stands when it came from above; sign and size come out for each axis."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.calibrate.backlash import AWAY_UM, REACH_PX, REPEATS
from daemon.procedures.registry import PROCEDURES
from daemon.station.station import CrossSearch, LookResult
from daemon.storage.calibration_records import BacklashRecord
from drivers.errors import EnvelopeViolation
from tests.daemon.procedures.fake_station import BELOW_PX, Ran, World, a_board, begin, run
from vision import NotFound, Reason

REQUEST = {"op": "calibrate", "what": "backlash", "theta_deg": 0.0}


FREE_AT_WORK = {"surface_range_um": 100.0}
"""Working height is free of any surface that is possible: heights are no matter here."""


def _world(folder: Path, **changes: dict[str, Any]) -> World:
    free = changes | {"gantry": FREE_AT_WORK | changes.get("gantry", {})}
    return World(folder, a_board(("A", 10_000.0, 5_000.0)), free).teach().with_map()


@pytest.fixture
def world(tmp_path: Path) -> World:
    return _world(tmp_path)


async def _measure(world: World, request: dict[str, Any] | None = None, ran: Ran | None = None) -> Ran:
    return await run(world, PROCEDURES["calibrate"], REQUEST | (request or {}), ran)


def _record(world: World) -> BacklashRecord:
    record = world.calibrations.records["backlash"]
    assert isinstance(record, BacklashRecord)
    return record


@pytest.mark.parametrize("theta_deg", [0.0, 60.0])
@pytest.mark.parametrize("what", [{}, {"test_point": "A"}])
async def test_sign_and_size_of_each_axis_come_out(world: World, what: dict[str, Any], theta_deg: float) -> None:
    world.gantry.backlash_um = {"x": 34.0, "y": -12.0}
    ran = await _measure(world, what | {"theta_deg": theta_deg})
    record = _record(world)
    assert (record.x.backlash_um, record.y.backlash_um) == pytest.approx((34.0, -12.0), abs=0.02)
    assert record.x.from_below_um == pytest.approx([0.0] * REPEATS, abs=0.02)
    assert record.x.from_above_um == pytest.approx([34.0] * REPEATS, abs=0.02)
    assert record.y.from_above_um == pytest.approx([-12.0] * REPEATS, abs=0.02)
    assert (ran.got.outcome, ran.got.detail["what"]) == ("calibrated", "backlash")
    assert (ran.got.detail["x_um"], ran.got.detail["y_um"]) == (34.0, -12.0)
    assert ran.got.detail["sigma_um"] == [0.0, 0.0]


async def test_where_the_target_lies_off_its_place_does_not_matter(world: World) -> None:
    world.cross_um = (world.cross_um[0] + 150.0, world.cross_um[1] - 90.0)
    world.gantry.backlash_um = {"x": 20.0}
    await _measure(world)
    record = _record(world)
    assert record.x.backlash_um == pytest.approx(20.0, abs=0.02)
    assert record.x.from_below_um[0] == pytest.approx(-150.0, abs=0.02), "the tip from the target"
    assert record.y.from_below_um[0] == pytest.approx(90.0, abs=0.02)


async def test_the_uncertainty_follows_from_the_scatter_of_both_sides(world: World) -> None:
    rng = np.random.default_rng(5)
    world.gantry.scatter_um = lambda: (float(rng.normal(0.0, 6.0)), float(rng.normal(0.0, 2.0)))
    await _measure(world)
    for axis in (_record(world).x, _record(world).y):
        both = np.var(axis.from_above_um, ddof=1) + np.var(axis.from_below_um, ddof=1)
        assert axis.sigma_um == pytest.approx(math.sqrt(both / REPEATS))
        assert axis.backlash_um == pytest.approx(np.mean(axis.from_above_um) - np.mean(axis.from_below_um))
    assert _record(world).x.sigma_um > 1.0


async def test_both_sides_are_visited_in_turn_and_only_the_measured_axis_comes_from_above(world: World) -> None:
    ran = await _measure(world)
    over = world.geometry.position_at(world.cross_um, 0.0)
    moves = world.gantry.moves
    assert len(moves) == 8 * REPEATS == ran.job.moves
    for n, axis in enumerate(["x", "y"]):
        for visit in range(2 * REPEATS):
            (away, away_above), (there, there_above) = moves[4 * REPEATS * n + 2 * visit :][:2]
            above = visit % 2 == 1
            side = AWAY_UM if above else -AWAY_UM
            assert (away.x_um - over.x_um, away.y_um - over.y_um) == (
                pytest.approx((side, 0.0) if axis == "x" else (0.0, side))
            )
            assert there == over
            assert away_above == there_above == (frozenset({axis}) if above else frozenset())
    assert ran.progress[0] == (0, 16, "play of X")
    assert ran.progress[REPEATS] == (8, 16, "play of Y")
    assert ran.progress[-1] == (15, 16, "play of Y")
    assert ran.events[:3] == [Event.ACCEPTED, Event.SEEN, Event.ARRIVED]


async def test_the_target_is_looked_for_below_the_tip(world: World) -> None:
    await _measure(world)
    assert world.station.searches == [CrossSearch(BELOW_PX, REACH_PX, 720.0 / 12.0)] * (4 * REPEATS)


@pytest.mark.parametrize(("share", "enough"), [(0.999, False), (1.0, False), (1.001, True)])
@pytest.mark.parametrize("axis", ["x", "y"])
async def test_the_approach_is_enough_if_it_is_longer_than_any_backlash(
    tmp_path: Path, axis: str, share: float, enough: bool
) -> None:
    first = _world(tmp_path / "first")
    first.gantry.backlash_um = {axis: -40.0}
    await _measure(first)
    measured = getattr(_record(first), axis)
    worst = abs(measured.backlash_um) + 3 * measured.sigma_um
    assert worst == pytest.approx(40.0, abs=0.1)
    world = _world(tmp_path / "then", gantry={"approach_um": worst * share})
    world.gantry.backlash_um = {axis: -40.0}
    detail = (await _measure(world)).got.detail
    assert detail["approach_um"] == worst * share
    assert detail["approach_enough"] is enough


async def test_scatter_counts_three_times_against_the_approach(tmp_path: Path) -> None:
    world = _world(tmp_path, gantry={"approach_um": 44.0})
    rng = np.random.default_rng(3)
    world.gantry.scatter_um = lambda: (float(rng.normal(0.0, 6.0)), 0.0)
    world.gantry.backlash_um = {"x": 38.0}
    detail = (await _measure(world)).got.detail
    record = _record(world)
    assert record.x.backlash_um < 44.0 < record.x.backlash_um + 3 * record.x.sigma_um
    assert detail["approach_enough"] is False


async def test_a_target_that_is_not_seen_is_a_fault_and_the_old_record_stays(world: World) -> None:
    await _measure(world)
    before = _record(world)
    world.station.script[5 + len(world.station.searches)] = lambda look: replace(
        look, cross=NotFound(Reason.NO_CONTROL_POINT, "no cross there")
    )
    with pytest.raises(Fault) as caught:
        await _measure(world)
    assert caught.value.kind is FaultCode.CALIBRATION_FAILED
    assert caught.value.message == "control point was not seen: no cross there"
    assert _record(world) == before


async def test_it_needs_probe_map_and_homing(tmp_path: Path) -> None:
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {})
    for kind, prepare in (
        (FaultCode.NOT_CALIBRATED, world.teach),
        (FaultCode.NOT_CALIBRATED, world.with_map),
        (FaultCode.NOT_HOMED, lambda: None),
    ):
        world.gantry.is_homed = False
        ran = begin(REQUEST)
        with pytest.raises(Fault) as caught:
            await _measure(world, ran=ran)
        assert (caught.value.kind, ran.events) == (kind, [])
        prepare()
    assert world.gantry.moves == []


@pytest.mark.parametrize(("room_um", "good"), [(1_090.0, False), (1_110.0, True)])
@pytest.mark.parametrize("end", ["minimum", "maximum"])
@pytest.mark.parametrize("axis", ["x", "y"])
async def test_there_must_be_room_for_placement_error_and_approach_on_every_side(
    tmp_path: Path, axis: str, end: str, room_um: float, good: bool
) -> None:
    free = _world(tmp_path / "free")
    over = free.geometry.position_at(free.cross_um, 0.0)
    limit = getattr(over, f"{axis}_um") + (room_um if end == "maximum" else -room_um)
    section = getattr(free.config.axes, axis).model_copy(update={end: limit})
    world = _world(tmp_path / "tight", axes={axis: section})
    if good:
        await _measure(world)
        return
    with pytest.raises(EnvelopeViolation):
        await _measure(world)
    assert world.gantry.moves == []


async def test_a_blurred_frame_is_a_fault_of_its_own(world: World) -> None:
    def blurred(look: LookResult) -> LookResult:
        return replace(look, tip=NotFound(Reason.BLURRED, "blurred"), cross=None)

    world.station.always = blurred
    with pytest.raises(Fault) as caught:
        await _measure(world)
    assert caught.value.kind is FaultCode.FRAME_UNUSABLE
