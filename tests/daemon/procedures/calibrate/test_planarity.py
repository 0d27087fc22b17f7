"""The surface's plane is what touches at places all over the board say; a board that lies in no plane is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.calibrate import planarity
from daemon.procedures.registry import PROCEDURES
from daemon.storage.calibration_records import SurfaceRecord
from drivers.errors import EnvelopeViolation
from tests.daemon.procedures.fake_station import Ran, World, a_board, begin, run

GRID = [(f"P{i}{k}", 5_000.0 + 7_000.0 * i, 4_000.0 + 6_500.0 * k) for i in range(4) for k in range(3)]
REQUEST = {"op": "calibrate", "what": "surface", "places": 12}


def _world(folder: Path, points: Any = None, **changes: dict[str, Any]) -> World:
    return World(folder, points or a_board(*GRID), changes).teach().with_map()


@pytest.fixture
def world(tmp_path: Path) -> World:
    return _world(tmp_path)


async def _measure(world: World, request: dict[str, Any] | None = None, ran: Ran | None = None) -> Ran:
    return await run(world, PROCEDURES["calibrate"], REQUEST | (request or {}), ran)


async def _fault(world: World, request: dict[str, Any] | None = None, ran: Ran | None = None) -> Fault:
    with pytest.raises(Fault) as caught:
        await _measure(world, request, ran)
    return caught.value


def _record(world: World) -> SurfaceRecord:
    record = world.calibrations.records["surface"]
    assert isinstance(record, SurfaceRecord)
    return record


def _tilted(x_um: float, y_um: float) -> float:
    """A plane that rises by 1 um per mm along x, falls by 0.5 along y, and is 10 um high over the board's origin."""
    return 10.0 + (x_um - 60_000.0) / 1e3 - 0.5 * (y_um - 40_000.0) / 1e3


@pytest.mark.parametrize("theta_deg", [0.0, 90.0])
async def test_the_plane_is_the_surfaces_own(world: World, theta_deg: float) -> None:
    world.height_um = _tilted
    ran = await _measure(world, {"theta_deg": theta_deg})
    surface = world.calibrations.surface
    assert surface is not None
    for _, x, y in GRID:
        robot = 60_000.0 + x, 40_000.0 + y
        assert world.geometry.height_um(robot) == pytest.approx(_tilted(*robot), abs=0.2)
    record = _record(world)
    for touch in record.touches:
        assert touch.height_um == pytest.approx(_tilted(touch.x_um, touch.y_um), abs=0.2)
    heights = [_tilted(60_000.0 + x, 40_000.0 + y) for _, x, y in GRID]
    told = ran.got.detail
    assert (told["what"], told["places"], told["limit_um"]) == ("surface", 12, 50.0)
    assert told["height_um"] == pytest.approx(sum(heights) / 12, abs=0.2)
    assert told["spread_um"] == pytest.approx(max(heights) - min(heights), abs=0.3)
    assert told["planar"] is True
    assert told["rms_um"] == pytest.approx(0.0, abs=0.1)
    assert len(record.residuals_um) == 12
    assert record.flatness_um == pytest.approx(0.0, abs=0.3)


async def test_every_place_is_touched_in_the_middle_of_its_pad(world: World) -> None:
    ran = await _measure(world)
    touched = {(round(t.x_um), round(t.y_um)) for t in _record(world).touches}
    assert touched == {(round(60_000 + x), round(40_000 + y)) for _, x, y in GRID}
    # The first place is searched from 600 um above, the others from just above the last.
    assert ran.job.moves < 7 * 12
    assert ran.job.looks == 2 * (ran.job.moves - 12), "two at each depth"
    assert ran.progress == [(n, 12, f"touching {name}") for n, (name, _, _) in enumerate(GRID)]
    assert ran.events[:3] == [Event.ACCEPTED, Event.SEEN, Event.ARRIVED]


async def test_fewer_places_are_chosen_by_chance_and_repeatably(world: World) -> None:
    chosen = []
    for job_id in ("a", "a", "b"):
        await _measure(world, {"places": 6, "id": job_id})
        chosen.append([(t.x_um, t.y_um) for t in _record(world).touches])
    assert len(chosen[0]) == 6
    assert chosen[0] == chosen[1] != chosen[2]


@pytest.mark.parametrize(("count", "good"), [(4, True), (3, False)])
async def test_a_plane_needs_four_test_points(tmp_path: Path, count: int, good: bool) -> None:
    corners = [GRID[0], GRID[2], GRID[9], GRID[11]]
    world = _world(tmp_path, a_board(*corners[:count]))
    if good:
        assert (await _measure(world)).got.detail["places"] == 4
        return
    fault = await _fault(world)
    assert fault.kind is FaultCode.CALIBRATION_FAILED
    assert "has 3 test points; a plane needs 4" in fault.message
    assert world.gantry.moves == []


async def test_points_that_must_not_be_touched_are_not(tmp_path: Path) -> None:
    board = a_board(*GRID)
    listed = tuple(p.model_copy(update={"why_not": "a fiducial"}) if p.name == "P11" else p for p in board.points)
    world = _world(tmp_path, board.model_copy(update={"points": listed}))
    ran = await _measure(world)
    assert ran.got.detail["places"] == 11
    assert not any("P11" in what for _, _, what in ran.progress)


async def test_places_on_a_line_span_no_plane(tmp_path: Path) -> None:
    world = _world(tmp_path, a_board(*((f"L{n}", 5_000.0 + 3_000.0 * n, 9_000.0) for n in range(6))))
    fault = await _fault(world)
    assert fault.kind is FaultCode.CALIBRATION_FAILED
    assert "the surface is no plane: the places lie on a line" in fault.message


async def test_spread_heights_are_not_planar_but_kept(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    world.height_um = lambda x, y: 2.2 * _tilted(x, y) - 30.0
    ran = await _measure(world)
    assert ran.got.detail["planar"] is False
    heights = [t.height_um for t in _record(world).touches]
    spread_um = max(heights) - min(heights)
    assert spread_um > 50.0
    for limit_um, planar in ((spread_um, True), (spread_um - 0.001, False)):
        monkeypatch.setattr(planarity, "PLANAR_WITHIN_UM", limit_um)
        detail = (await _measure(world)).got.detail
        assert (detail["planar"], detail["limit_um"]) == (planar, limit_um)


async def test_heights_off_any_plane_are_refused_and_the_old_one_stays(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    world.height_um = lambda x, y: 12.0 if (round(x / 7_000.0) + round(y / 6_500.0)) % 2 else -12.0
    await _measure(world)
    before = _record(world)
    assert before.rms_um > 5.0
    for limit_um in (before.rms_um, before.rms_um - 0.001):
        monkeypatch.setattr(planarity, "MAX_RMS_UM", limit_um)
        if limit_um == before.rms_um:
            await _measure(world)
            continue
        fault = await _fault(world)
        assert fault.kind is FaultCode.CALIBRATION_FAILED
        assert "um off any plane" in fault.message
        assert len(fault.detail["heights_um"]) == 12
    assert _record(world).touches == before.touches


async def test_the_limit_is_25_um(world: World) -> None:
    world.height_um = lambda x, y: 45.0 if (round(x / 7_000.0) + round(y / 6_500.0)) % 2 else -45.0
    assert "25 um are allowed" in (await _fault(world)).message


@pytest.mark.parametrize("press_um", [0.0, -1.0])
async def test_where_nothing_may_be_pressed_nothing_is_measured(tmp_path: Path, press_um: float) -> None:
    world = _world(tmp_path, gantry={"press_um": press_um})
    fault = await _fault(world)
    assert (fault.kind, fault.message) == (FaultCode.NOT_CALIBRATED, "the configuration allows no pressing")
    assert "set gantry.press_um" in fault.advice


@pytest.mark.parametrize("press_um", [0.5, 150.0])
async def test_any_pressing_that_is_allowed_is_enough_to_begin(tmp_path: Path, press_um: float) -> None:
    world = _world(tmp_path, gantry={"press_um": press_um})
    if press_um > 1.0:
        assert (await _measure(world)).got.detail["height_um"] == pytest.approx(0.0, abs=0.1)
    else:
        assert "no push can be measured" in (await _fault(world)).message


async def test_it_needs_probe_map_and_homing(tmp_path: Path) -> None:
    world = World(tmp_path, a_board(*GRID), {})
    ran = begin(REQUEST)
    assert "tip has not been taught" in (await _fault(world, ran=ran)).message
    assert "map from image" in (await _fault(world.teach())).message
    world.with_map().gantry.is_homed = False
    assert (await _fault(world)).kind is FaultCode.NOT_HOMED
    assert (ran.events, world.gantry.moves) == ([], [])


@pytest.mark.parametrize(("lowest_um", "good"), [(4_801.0, False), (4_800.0, True)])
async def test_the_deepest_press_must_be_within_reach_before_anything_is_touched(
    tmp_path: Path, lowest_um: float, good: bool
) -> None:
    free = _world(tmp_path / "free")
    z = free.config.axes.z.model_copy(update={"minimum": lowest_um})
    world = _world(tmp_path / "tight", axes={"z": z})
    if good:
        await _measure(world)
        assert 4_800.0 <= min(to.z_um for to, _ in world.gantry.moves) < 4_900.0
        return
    with pytest.raises(EnvelopeViolation):
        await _measure(world)
    assert world.gantry.moves == []


async def test_a_place_out_of_reach_is_refused_before_anything_is_touched(tmp_path: Path) -> None:
    world = _world(tmp_path, a_board(*GRID[:6], ("far", 160_000.0, 5_000.0)))
    with pytest.raises(EnvelopeViolation):
        await _measure(world)
    assert world.gantry.moves == []
