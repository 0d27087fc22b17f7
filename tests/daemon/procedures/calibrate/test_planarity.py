"""The surface's plane is what touches at places all over the board say; a board that lies in no plane is refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from math import dist
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.domain.board import Board, BoardPoint
from daemon.domain.board_layers import BoardLayers, SideShapes
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_mark import Mark, PointMark
from daemon.domain.states import Event
from daemon.domain.surface_points import LEAST_PINS, SurfacePoints, surface_points
from daemon.procedures.calibrate import planarity
from daemon.procedures.calibrate.planarity import choose_places
from daemon.procedures.calibrate.spread import SURE_WITHIN_UM, TOUCH_SIGMA_UM, plane_sigma_um, require_spread
from daemon.procedures.registry import PROCEDURES
from daemon.station.kinematics import EXTRAPOLATED_UM, beyond_um
from daemon.station.station import LookResult
from daemon.storage.alignment_void import Void
from daemon.storage.calibration_records import SurfaceRecord
from drivers.errors import EnvelopeViolation
from tests.daemon.procedures.fake_station import SENSE_INPUT, Ran, World, a_board, begin, run
from vision import NotFound, Reason

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


@pytest.mark.parametrize("forbidden", [{"P00"}, {"P11", "P32"}])
async def test_no_point_is_touched_that_a_person_forbade(world: World, forbidden: set[str]) -> None:
    async def mark_of(board: str, side: str, point: str) -> PointMark | None:
        assert (board, side) == (world.context.board.name, world.context.board.side)
        if point not in forbidden | {"P20"}:
            return None
        mark: Mark = "forbidden" if point in forbidden else "approved"
        return PointMark(point=point, mark=mark, reason="its trace lifts", by="M. Weber", at="2026-11-26T07:00:00")

    await _measure(world, ran=begin(REQUEST, mark_of=mark_of))
    touched = {(round(touch.x_um), round(touch.y_um)) for touch in _record(world).touches}
    assert touched == {(60_000 + x, 40_000 + y) for name, x, y in GRID if name not in forbidden}


async def test_where_too_few_points_are_allowed_nothing_moves(world: World) -> None:
    async def mark_of(_board: str, _side: str, point: str) -> PointMark:
        return PointMark(point=point, mark="forbidden", reason="no", by="M. Weber", at="2026-11-26T07:00:00")

    fault = await _fault(world, ran=begin(REQUEST, mark_of=mark_of))
    assert fault.kind is FaultCode.CALIBRATION_FAILED
    assert world.gantry.moves == []


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


@pytest.mark.parametrize("seen_at_deg", [180.0, 90.0, None])
async def test_a_place_before_whose_ground_the_needle_is_not_seen_is_touched_with_the_head_turned(
    world: World, seen_at_deg: float | None
) -> None:
    world.height_um = _tilted
    aside = [world.geometry.position_over((5_000.0, 4_000.0), deg) for deg in (0.0, 90.0, 180.0, 270.0)]

    def busy_ground(look: LookResult) -> LookResult:
        at = look.position
        here = any(dist((at.x_um, at.y_um), (one.x_um, one.y_um)) < 1.0 for one in aside)
        if not here or at.theta_deg % 360.0 == seen_at_deg:
            return look
        return replace(look, tip=NotFound(Reason.NO_NEEDLE, "a busy ground"))

    world.station.always = busy_ground
    if seen_at_deg is None:
        assert (await _fault(world)).kind is FaultCode.TIP_NOT_FOUND
        assert "surface" not in world.calibrations.records
        return
    await _measure(world)
    robot = 65_000.0, 44_000.0
    assert world.geometry.height_um(robot) == pytest.approx(_tilted(*robot), abs=0.2)
    assert any(dist((touch.x_um, touch.y_um), robot) < 1.0 for touch in _record(world).touches)


@pytest.mark.parametrize("seed", [f"job-{n}" for n in range(20)])
def test_no_point_is_left_farther_out_than_the_surface_is_believed(seed: str) -> None:
    """A crowd in the middle of the board is drawn easily, and the few points at its corners are not."""
    crowd = [(f"P{i}", 20_000.0 + 1_500.0 * (i % 8), 20_000.0 + 1_500.0 * (i // 8)) for i in range(64)]
    corners = [
        ("C0", 2_000.0, 2_000.0),
        ("C1", 48_000.0, 2_000.0),
        ("C2", 2_000.0, 48_000.0),
        ("C3", 48_000.0, 48_000.0),
    ]
    mid = [(f"M{i}", x, y) for i, (x, y) in enumerate([(10e3, 10e3), (40e3, 10e3), (10e3, 40e3), (40e3, 40e3)])]
    flat = tuple(a_board(*crowd, *mid, *corners).points)
    chosen = choose_places(SurfacePoints(flat), BOARD, 12, seed)
    far_um = beyond_um([p.place_um for p in flat], np.array([p.place_um for p in chosen])).max()
    assert far_um <= EXTRAPOLATED_UM


async def test_after_the_last_touch_the_needle_rests_at_the_safe_height(world: World) -> None:
    """What a few lost steps leave of a push just above the board may be less than any look tells."""
    await _measure(world)
    assert world.gantry.reported.z_um == world.context.gantry.safe_z_um


async def test_after_a_touch_that_failed_it_rests_there_too(world: World) -> None:
    world.pin_travel_um = 20.0  # it sticks
    assert (await _fault(world)).kind is FaultCode.CALIBRATION_FAILED
    assert world.gantry.reported.z_um == world.context.gantry.safe_z_um


async def test_every_place_is_touched_in_the_middle_of_its_pad(world: World) -> None:
    ran = await _measure(world)
    touched = {(round(t.x_um), round(t.y_um)) for t in _record(world).touches}
    assert touched == {(round(60_000 + x), round(40_000 + y)) for _, x, y in GRID}
    # The first place is searched from 600 um above, the others from just above the last.
    assert ran.job.moves < 7 * 12
    assert ran.job.looks == 2 * (ran.job.moves - 12 - 1), "two at each depth, none of a lift, nor of the last way up"
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


async def test_a_surface_is_not_measured_on_soldered_pads_nor_beside_holes(tmp_path: Path) -> None:
    board = a_board(*GRID)
    changes = {"P01": {"kind": "pad"}, "P10": {"diameter_um": None}, "P11": {"centre_um": (0.0, 0.0)}}
    listed = tuple(p.model_copy(update=changes.get(p.name, {})) for p in board.points)
    ran = await _measure(_world(tmp_path, board.model_copy(update={"points": listed})))
    assert ran.got.detail["places"] == len(GRID) - 3
    assert not any(name in what.split() for _, _, what in ran.progress for name in changes)


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


async def test_a_board_whose_alignment_is_void_is_not_touched(world: World) -> None:
    """What lies below a place of the board that was there before, nobody knows."""
    world.calibrations.void_alignment(Void("board 18 was put into the nest and has not been aligned", "18"))
    fault = await _fault(world)
    assert fault.kind is FaultCode.NOT_ALIGNED
    assert "--board-id 18" in fault.advice
    assert world.gantry.moves == []


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


async def test_a_place_out_of_reach_is_left_out(tmp_path: Path) -> None:
    """A board may be larger than what the machine reaches."""
    far = [(f"far{k}", 160_000.0 + 100.0 * k, 5_000.0) for k in range(20)]
    world = _world(tmp_path, a_board(*far, *GRID))
    await _measure(world)
    at_um = [world.geometry.tip_um(to) for to, _ in world.gantry.moves]
    assert max(float(x_um) for x_um, _ in at_um) < 100_000.0


async def test_where_too_few_are_in_reach_that_is_refused_before_anything_is_touched(tmp_path: Path) -> None:
    world = _world(tmp_path, a_board(*GRID[:3], ("far", 160_000.0, 5_000.0)))
    with pytest.raises(EnvelopeViolation):
        await _measure(world)
    assert world.gantry.moves == []


def _points(kind: str, *places: tuple[float, float]) -> tuple[BoardPoint, ...]:
    named = ((f"{kind}{k}", x_um, y_um) for k, (x_um, y_um) in enumerate(places))
    return a_board(*named, kind=kind).points


BOARD = a_board().model_copy(update={"width_um": 80_000.0, "height_um": 50_000.0})
ALL_OVER = _points("pad", *((x * 1_000.0, y * 1_000.0) for x in range(0, 80, 2) for y in range(0, 50, 2)))


def test_pads_of_parts_stand_in_where_flat_points_are_far_away() -> None:
    """Seven test points in a corner of a board of 80 mm, as some boards have them."""
    flat = _points("site", *((14_000.0 + 4_000.0 * k, 12_000.0) for k in range(7)))
    chosen = choose_places(SurfacePoints(flat, ALL_OVER), BOARD, 12, "job")
    assert len(chosen) == 12
    assert sum(point.kind == "site" for point in chosen) == 6
    corners = [(0.0, 0.0), (0.0, 48_000.0), (78_000.0, 0.0), (78_000.0, 48_000.0)]
    away_um = [min(dist(corner, point.place_um) for point in chosen) for corner in corners]
    assert max(away_um) < 20_000.0


@pytest.mark.parametrize("seed", [f"job-{n}" for n in range(10)])
def test_six_places_leave_no_corner_of_a_large_board_out(seed: str) -> None:
    """Three pads beside three flat points in the middle cover three corners: a ninth of the points was not tested."""
    flat = _points("site", *((30_000.0 + 3_000.0 * k, 22_000.0 + 2_000.0 * (k % 3)) for k in range(7)))
    chosen = choose_places(SurfacePoints(flat, ALL_OVER), BOARD, 6, seed)
    assert len(chosen) == 6
    everything = np.array([point.place_um for point in (*flat, *ALL_OVER)])
    assert beyond_um(everything, np.array([point.place_um for point in chosen])).max() <= EXTRAPOLATED_UM


@pytest.mark.parametrize("seed", [f"job-{n}" for n in range(10)])
def test_rows_of_pins_that_are_probed_are_not_left_out_where_pads_are_near(seed: str) -> None:
    """A header at the board's edge is probed by the same plane, though nobody touches it to measure the surface."""
    flat = _points("site", *((x, y) for x in (4_000.0, 20_000.0, 36_000.0) for y in (4_000.0, 20_000.0)))
    pads = _points("pad", *((x * 1_000.0, y * 1_000.0) for x in range(0, 56, 4) for y in range(0, 24, 4)))
    pins = _points("pin", *((60_000.0, 2_540.0 * k) for k in range(8)))
    small = BOARD.model_copy(update={"height_um": 25_000.0})
    chosen = choose_places(SurfacePoints(flat, pads, pins), small, 6, seed)
    assert not any(point.kind == "pin" for point in chosen)
    places = np.array([point.place_um for point in pins])
    assert beyond_um(places, np.array([point.place_um for point in chosen])).max() <= EXTRAPOLATED_UM


def test_pads_of_parts_are_left_alone_where_flat_points_are_near() -> None:
    flat = _points("site", *((x, y) for x in (2_000.0, 6_000.0) for y in (2_000.0, 6_000.0)))
    near = _points("pad", *((x * 1_000.0, y * 1_000.0) for x in range(8) for y in range(8)))
    small = BOARD.model_copy(update={"width_um": 8_000.0, "height_um": 8_000.0})
    chosen = choose_places(SurfacePoints(flat, near), small, 12, "job")
    assert [point.kind for point in chosen] == ["site"] * 4


def test_a_board_without_any_flat_point_is_measured_on_its_pads() -> None:
    chosen = choose_places(SurfacePoints((), ALL_OVER), BOARD, 12, "job")
    assert len({point.name for point in chosen}) == 12
    assert min(dist(a.place_um, b.place_um) for a, b in combinations(chosen, 2)) > 10_000.0


def _by_cad(*points: BoardPoint) -> Board:
    layers = BoardLayers(top=SideShapes(), bottom=SideShapes())
    return a_board().model_copy(update={"points": points, "layers": layers})


PINS = _points("pin", *((x * 1_000.0, y * 1_000.0) for x in range(0, 80, 8) for y in range(0, 50, 8)))


def test_a_board_with_pins_alone_is_measured_on_their_rings() -> None:
    roomy = tuple(p.model_copy(update={"room_um": 100.0 + 10.0 * (k % 5)}) for k, p in enumerate(PINS))
    offered = surface_points(_by_cad(*roomy))
    assert (offered.flat, offered.pads) == ((), ())
    assert len(offered.pins) == max(LEAST_PINS, len(PINS) // 2)
    left = {p.name for p in roomy} - {p.name for p in offered.pins}
    assert min(p.room_um or 0.0 for p in offered.pins) >= max(p.room_um or 0.0 for p in roomy if p.name in left)
    assert len(choose_places(offered, BOARD, 12, "job")) == 12


def test_pins_are_left_alone_where_pads_do() -> None:
    pads = _points("pad", *((x * 1_000.0, y * 1_000.0) for x in (0, 70) for y in (0, 40)))
    chosen = choose_places(surface_points(_by_cad(*pads, *PINS)), BOARD, 12, "job")
    assert [point.kind for point in chosen] == ["pad"] * 4


def test_without_cad_neither_pads_nor_pins_stand_in() -> None:
    pads = _points("pad", *((x * 1_000.0, y * 1_000.0) for x in (0, 70) for y in (0, 40)))
    assert surface_points(a_board().model_copy(update={"points": (*pads, *PINS)})) == SurfacePoints()


# --- spread of the places ---------------------------------------------------------------------------------------------

ROW = tuple((5_000.0 + 1_500.0 * k, 10_000.0 + 5.0 * (k % 3)) for k in range(40))
"""A connector's worth of test points, with the scatter that no two of them are spared."""
BESIDE = ((6_000.0, 26_000.0), (34_000.0, 27_000.0), (20_000.0, 2_000.0))


@pytest.mark.parametrize("count", [4, 6, 12])
def test_places_that_happen_to_lie_in_a_row_are_drawn_anew(count: int) -> None:
    flat = _points("site", *ROW, *BESIDE)
    for seed in range(40):
        chosen = choose_places(SurfacePoints(flat), a_board(), count, f"job-{seed}")
        assert len({point.name for point in chosen}) == count
        ys = sorted(point.y_um for point in chosen)
        assert ys[-1] - ys[0] > 5_000.0, f"all in one row with seed {seed}"


async def test_places_that_lie_nearly_in_a_row_are_refused_before_anything_is_touched(tmp_path: Path) -> None:
    world = _world(tmp_path, a_board(*((f"L{k}", *place) for k, place in enumerate(ROW[:20]))))
    fault = await _fault(world, {"places": 4})
    assert fault.kind is FaultCode.CALIBRATION_FAILED
    assert "the places lie on a line, or nearly" in fault.message
    assert world.gantry.moves == []


IN_A_ROW = _points("site", *((x, 9_000.0) for x in (6_000.0, 13_000.0, 20_000.0)))
LONG_ROW = _points("site", *((4_000.0 + 4_000.0 * k, 9_000.0) for k in range(6)))
IN_A_CORNER = _points("site", *((x, y) for x in (2_000.0, 4_000.0) for y in (2_000.0, 4_000.0)))
ONLY_TWO = IN_A_ROW[:2]
PLACES = tuple((x, y) for x in (3_000.0, 10_000.0, 17_000.0, 24_000.0) for y in (3_000.0, 8_000.0, 15_000.0))
"""Parts all over a small board: none is far from a test point, however these lie."""
SMALL = {"width_um": 27_000.0, "height_um": 18_000.0}


@pytest.mark.parametrize("flat", [IN_A_ROW, LONG_ROW, IN_A_CORNER, ONLY_TWO], ids=["three", "row", "corner", "two"])
@pytest.mark.parametrize("kind", ["pad", "pin"])
async def test_where_flat_points_span_no_plane_parts_do_though_they_are_near(
    tmp_path: Path, flat: tuple[BoardPoint, ...], kind: str
) -> None:
    board = _by_cad(*flat, *_points(kind, *PLACES)).model_copy(update=SMALL)
    world = _world(tmp_path, board)
    world.height_um = _tilted
    ran = await _measure(world)
    assert ran.got.detail["sigma_um"] <= SURE_WITHIN_UM
    for x, y in ((0.0, 0.0), (27_000.0, 0.0), (0.0, 18_000.0), (27_000.0, 18_000.0)):
        robot = 60_000.0 + x, 40_000.0 + y
        assert world.geometry.measured_um(robot) == pytest.approx(_tilted(*robot), abs=0.5)


@pytest.mark.parametrize("count", [4, 6, 12])
def test_pins_stand_in_where_flat_points_and_pads_lie_in_one_row(count: int) -> None:
    pads, pins = _points("pad", *((x + 500.0, 9_000.0) for x, _ in PLACES)), _points("pin", *PLACES)
    board = _by_cad(*LONG_ROW, *pads, *pins).model_copy(update=SMALL)
    for seed in range(10):
        chosen = choose_places(surface_points(board), board, count, f"job-{seed}")
        assert any(point.kind == "pin" for point in chosen)
        assert require_spread(chosen, board, 500.0) <= SURE_WITHIN_UM


def test_pins_are_left_alone_where_flat_points_or_pads_span_the_board() -> None:
    """Of all bare metal a lead's solder stands highest, and varies most."""
    pins = _points("pin", *((x + 700.0, y + 700.0) for x, y in PLACES))
    for kind in ("site", "pad"):
        board = _by_cad(*_points(kind, *PLACES), *pins).model_copy(update=SMALL)
        assert not any(p.kind == "pin" for p in choose_places(surface_points(board), board, 12, "job"))


async def test_metal_that_is_too_narrow_for_this_stations_needle_stands_in_for_nothing(tmp_path: Path) -> None:
    wide = _points("pin", *PLACES)
    narrow = tuple(
        p.model_copy(update={"name": f"narrow{p.name}", "room_um": 64.0, "x_um": p.x_um + 1_000.0}) for p in wide
    )
    world = _world(tmp_path, _by_cad(*IN_A_ROW, *wide, *narrow).model_copy(update=SMALL))
    assert world.config.servo.landing_um + world.config.servo.tip_radius_um == 65.0
    touched = {what.split()[-1] for _, _, what in (await _measure(world, {"places": 200})).progress}
    assert touched == {p.name for p in (*IN_A_ROW, *wide)}


ALONE = [
    pytest.param(IN_A_ROW, "has 3 test points; a plane needs 4", id="three"),
    pytest.param(ONLY_TWO, "has 2 test points; a plane needs 4", id="two"),
    pytest.param(LONG_ROW, "the places lie on a line, or nearly", id="row"),
]


@pytest.mark.parametrize(("flat", "why"), ALONE)
async def test_where_nothing_spans_a_plane_what_that_costs_is_said(
    tmp_path: Path, flat: tuple[BoardPoint, ...], why: str
) -> None:
    """Nothing is known of the height then but what the configuration promises."""
    world = _world(tmp_path, _by_cad(*flat).model_copy(update=SMALL), gantry={"surface_range_um": 430.0})
    fault = await _fault(world)
    assert fault.kind is FaultCode.CALIBRATION_FAILED
    assert why in fault.message
    assert "known to 430 um only" in fault.message
    assert world.gantry.moves == []


async def test_of_points_in_one_corner_it_is_said_how_badly_the_rest_would_be_known(tmp_path: Path) -> None:
    world = _world(tmp_path, _by_cad(*IN_A_CORNER))
    fault = await _fault(world)
    assert "the places lie close together: heights beside them would be known to 39 um only" in fault.message
    assert world.gantry.moves == []


async def test_a_plane_known_worse_than_the_configuration_promises_costs_no_more_than_that(tmp_path: Path) -> None:
    world = _world(tmp_path, _by_cad(*IN_A_CORNER), gantry={"surface_range_um": 20.0})
    assert "known to 20 um only" in (await _fault(world)).message


async def test_how_surely_the_plane_is_known_is_told(world: World) -> None:
    few = (await _measure(world, {"places": 4})).got.detail["sigma_um"]
    all_of_them = (await _measure(world, {"id": "b"})).got.detail["sigma_um"]
    assert all_of_them < few <= 15.0


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (2.0, -1.0)])
def test_a_planes_error_is_as_large_as_noise_makes_it(tilt: tuple[float, float]) -> None:
    chance = np.random.default_rng(1)
    places = np.array([(0.0, 0.0), (20e3, 1e3), (18e3, 9e3), (2e3, 12e3), (9e3, 5e3)])
    at = np.array([(30e3, 20e3)])
    terms = np.column_stack((np.ones(5), places))
    heights = places @ np.array(tilt) / 1e3
    found = []
    for _ in range(4000):
        plane, *_ = np.linalg.lstsq(terms, heights + chance.normal(0.0, TOUCH_SIGMA_UM, 5), rcond=None)
        found.append(plane @ (1.0, *at[0]))
    assert np.std(found) == pytest.approx(plane_sigma_um(places, at), rel=0.05)


async def test_no_place_is_touched_while_the_sense_is_closed_high_above_every_board(tmp_path: Path) -> None:
    world = _world(tmp_path, sense={"kind": "drive_input"})
    world.gantry.inputs = {SENSE_INPUT}
    assert (await _fault(world)).kind is FaultCode.CONTACT_BEFORE_DESCENT
    assert min(to.z_um for to, _ in world.gantry.moves) >= world.config.gantry.free_z_um


async def test_a_pad_that_is_told_to_stand_up_says_nothing_of_the_surface(tmp_path: Path) -> None:
    board = a_board(*GRID)
    listed = tuple(p.model_copy(update={"stands_um": 300.0}) if p.name == "P11" else p for p in board.points)
    ran = await _measure(_world(tmp_path, board.model_copy(update={"points": listed})))
    assert ran.got.detail["places"] == len(GRID) - 1
    assert not any("P11" in what for _, _, what in ran.progress)
