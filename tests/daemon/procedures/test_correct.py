"""A correction brings the tip onto the pad or says why not; it never goes farther than is calibrated."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.aiming import look_and_aim
from daemon.procedures.correct import SIDESTEP_MARGIN_PX, sidestep_um
from daemon.procedures.registry import PROCEDURES
from daemon.station.station import LookResult
from drivers.deadline import Deadline
from drivers.errors import CameraError, EnvelopeViolation, Stalled
from drivers.lights import Light
from tests.daemon.procedures.fake_station import (
    BELOW_PX,
    NEEDLE_RAD,
    SHAPE,
    TIP_PX,
    WORK_Z_UM,
    Ran,
    World,
    a_board,
    begin,
    missing,
    pose_map,
    run,
)
from vision import Reason, Seen
from vision.core.not_found import NotFound
from vision.geometry.frames import Rigid2, rotation

REQUEST = {"op": "correct", "test_point": "A"}
BOARD = a_board(("A", 10_000.0, 5_000.0), ("B", 12_600.0, 5_700.0), ("C", 8_200.0, 7_900.0))
ONE_MOVE = [Event.ACCEPTED, Event.SEEN, Event.ARRIVED]


def _world(folder: Path, **servo: Any) -> World:
    return World(folder, BOARD, {"servo": servo}).teach().with_map()


@pytest.fixture
def world(tmp_path: Path) -> World:
    return _world(tmp_path)


async def _correct(world: World, ran: Ran | None = None) -> Ran:
    return await run(world, PROCEDURES["correct"], REQUEST, ran)


async def _fault(world: World, ran: Ran | None = None) -> Fault:
    with pytest.raises(Fault) as caught:
        await _correct(world, ran)
    return caught.value


def _hide(look: LookResult) -> LookResult:
    """Let the red frame show nothing round."""
    return replace(look, seen=Seen(missing(), (), (), (), (0, 0, 10, 10)))


def _without_tip(look: LookResult) -> LookResult:
    return replace(look, tip=NotFound(Reason.NO_NEEDLE, "no needle"), seen=None)


# --- landing ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta_deg", [0.0, 45.0, 200.0, 359.0])
@pytest.mark.parametrize("miss_um", [(300.0, -200.0), (-450.0, 120.0), (0.0, 600.0)])
async def test_one_move_brings_the_tip_onto_the_pad(
    world: World, theta_deg: float, miss_um: tuple[float, float]
) -> None:
    world.put_beside("A", miss_um, theta_deg)
    ran = await _correct(world)
    assert math.hypot(*world.miss_um("A")) < 0.1
    assert ran.got.outcome == "corrected"
    assert ran.got.test_point == "A"
    assert ran.got.error_before_um == pytest.approx(math.hypot(*miss_um), abs=0.02)
    assert ran.got.error_after_um == pytest.approx(0.0, abs=0.1)
    assert ran.events == ONE_MOVE
    assert (ran.job.moves, ran.job.looks) == (1, 2)
    assert [kind for kind, _ in ran.steps] == ["look", "move", "look"]


async def test_a_board_that_lies_elsewhere_than_known_is_followed_by_sight(world: World) -> None:
    world.true_pose = Rigid2(0.4, 60_180.0, 39_900.0)
    world.put_beside("A", (200.0, 100.0))
    ran = await _correct(world)
    assert math.hypot(*world.miss_um("A")) < 0.1
    assert ran.job.moves == 1


async def test_a_surface_that_lies_higher_is_landed_on_all_the_same(world: World) -> None:
    world.with_surface(raised_um=30.0)
    surface = world.calibrations.surface
    assert surface is not None
    world.height_um = surface.height_um
    world.put_beside("A", (300.0, 100.0))
    await _correct(world)
    assert math.hypot(*world.miss_um("A")) < 1.0


async def test_the_answer_carries_what_was_seen_and_how_well(world: World) -> None:
    world.put_beside("A", (300.0, 0.0))
    detail = (await _correct(world)).got.detail
    assert (detail["kind"], detail["decided_by"]) == ("site", "site_filled")
    assert 0.5 < detail["sigma_um"] < 5.0


async def test_a_tip_on_its_pad_is_left_there(world: World) -> None:
    world.put_beside("A", (6.0, -8.0))
    ran = await _correct(world)
    assert ran.got.outcome == "already_on_target"
    assert (ran.got.error_before_um, ran.got.error_after_um) == pytest.approx((10.0, 10.0), abs=0.02)
    assert (ran.job.moves, ran.job.looks, ran.events) == (0, 1, [Event.ACCEPTED])
    assert world.gantry.moves == []


@pytest.mark.parametrize(("share", "moves"), [(0.99, 1), (1.0, 0), (1.01, 0)])
async def test_on_target_is_up_to_the_tolerance(tmp_path: Path, share: float, moves: int) -> None:
    measured = await _measured_um(_world(tmp_path), (9.0, 12.0))
    world = _world(tmp_path, tolerance_um=measured * share)
    world.put_beside("A", (9.0, 12.0))
    assert (await _correct(world)).job.moves == moves


@pytest.mark.parametrize(("share", "moves"), [(0.99, 3), (1.0, 1)])
async def test_the_same_tolerance_ends_a_correction_after_its_move(tmp_path: Path, share: float, moves: int) -> None:
    measured = await _measured_um(_world(tmp_path), (9.0, 12.0))
    world = _world(tmp_path, tolerance_um=measured * share)
    world.put_beside("A", (300.0, 0.0))
    world.gantry.scatter_um = lambda: _scatter(world, {1: (-9.0, -12.0)})
    ran = await _correct(world)
    assert ran.job.moves == moves


def _scatter(world: World, by_move: dict[int, tuple[float, float]]) -> tuple[float, float]:
    return by_move.get(len(world.gantry.moves), (0.0, 0.0))


async def _measured_um(world: World, miss_um: tuple[float, float]) -> float:
    """Return what a look says of a miss, to the last bit."""
    world.put_beside("A", miss_um)
    aim = await look_and_aim(
        begin(REQUEST).job, world.context, world.gantry.reported, BOARD.find("A"), world.context.require_map()
    )
    return aim.error_um


# --- before it begins ---------------------------------------------------------------------------------------------


async def test_the_needle_is_brought_to_working_height_before_the_first_look(world: World) -> None:
    world.put_beside("A", (200.0, 0.0))
    world.gantry.reported = world.gantry.actual = replace(world.gantry.actual, z_um=12_000.0)
    ran = await _correct(world)
    assert world.gantry.moves[0][0].z_um == world.config.gantry.free_z_um, "nobody knows how high the board lies"
    assert ran.job.moves == 1, "the way down is no correction"
    assert ran.got.error_before_um == pytest.approx(200.0, abs=0.2)


async def test_it_is_refused_where_homing_probe_or_map_is_missing(tmp_path: Path) -> None:
    bare = World(tmp_path / "bare", BOARD, {})
    bare.put_beside("A", (10.0, 0.0))
    ran = begin(REQUEST)
    assert (await _fault(bare, ran)).message == "the probe's tip has not been taught"
    assert (ran.job.partial.test_point, ran.events) == ("A", [])
    assert "has not been calibrated" in (await _fault(bare.teach())).message
    bare.with_map()
    bare.gantry.is_homed = False
    assert (await _fault(bare)).kind is FaultCode.NOT_HOMED
    assert bare.station.searches == []


async def test_an_unknown_test_point_is_refused(world: World) -> None:
    with pytest.raises(Fault) as caught:
        await run(world, PROCEDURES["correct"], {"op": "correct", "test_point": "nil"})
    assert caught.value.kind is FaultCode.UNKNOWN_TEST_POINT


@pytest.mark.parametrize("away_um", [(699.0, 0.0), (0.0, -699.0)])
async def test_a_head_within_the_largest_placement_error_is_at_the_test_point(
    world: World, away_um: tuple[float, float]
) -> None:
    world.put_beside("A", away_um)
    assert (await _correct(world)).got.outcome == "corrected"


async def test_a_head_farther_away_is_not_at_the_test_point_and_nothing_moves(world: World) -> None:
    world.put_beside("A", (560.0, 421.0))
    ran = begin(REQUEST)
    fault = await _fault(world, ran)
    assert fault.kind is FaultCode.NOT_AT_TEST_POINT
    assert fault.detail["away_um"] == pytest.approx(700.6, abs=0.05)
    assert fault.detail["limit_um"] == 700.0
    assert "0.7 mm from A" in fault.message
    assert (ran.events, world.gantry.moves, world.station.searches) == ([], [], [])


async def test_exactly_the_largest_placement_error_is_still_at_the_test_point(tmp_path: Path) -> None:
    world = _world(tmp_path)
    world.put_beside("A", (300.0, 0.0))
    away_um = math.hypot(*world.geometry.from_tip_um(BOARD.find("A").place_um, world.gantry.reported))
    exact = _world(tmp_path, max_placement_um=away_um)
    exact.put_beside("A", (300.0, 0.0))
    ran = await _correct(exact) if math.dist((0, 0), exact.miss_um("A")) <= away_um else None
    assert ran is not None
    assert ran.got.outcome == "corrected"


async def test_a_point_whose_place_is_out_of_reach_is_refused_before_the_first_look(world: World) -> None:
    edge = World(world.calibrations.folder, a_board(("A", -46_000.0, 5_000.0)), {}).teach().with_map()
    edge.put_beside("A", (0.0, 0.0))
    with pytest.raises(EnvelopeViolation):
        await _correct(edge)
    assert edge.station.searches == []


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"diameter_um": None, "shape": "rectangle"}, "is not round"),
        ({"centre_um": (10_000.0, 5_400.0), "shape": "ring"}, "is touched beside its middle"),
    ],
)
async def test_a_point_that_a_round_outline_does_not_lead_to_is_refused_before_the_first_look(
    tmp_path: Path, change: dict[str, Any], why: str
) -> None:
    points = tuple(p.model_copy(update=change) if p.name == "A" else p for p in BOARD.points)
    world = World(tmp_path, BOARD.model_copy(update={"points": points}), {}).teach().with_map()
    world.put_beside("A", (0.0, 0.0))
    fault = await _fault(world)
    assert fault.kind is FaultCode.UNKNOWN_TEST_POINT
    assert why in fault.message
    assert world.station.searches == []


# --- the limits of a move -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("share", "good"), [(1.0, True), (0.999, False)])
async def test_no_move_is_longer_than_the_map_is_calibrated_for(tmp_path: Path, share: float, good: bool) -> None:
    measured = await _measured_um(_world(tmp_path), (300.0, -100.0))
    world = _world(tmp_path)
    world.with_map(pose_map(radius_um=measured * share))
    world.put_beside("A", (300.0, -100.0))
    if good:
        assert (await _correct(world)).job.moves == 1
        return
    ran = begin(REQUEST)
    fault = await _fault(world, ran)
    assert fault.kind is FaultCode.CORRECTION_TOO_LARGE
    assert fault.detail["correction_um"] == pytest.approx(316.2, abs=0.05)
    assert "would be 316 um; calibrated are 316 um" in fault.message
    assert (world.gantry.moves, ran.job.moves) == ([], 0)
    assert ran.job.partial.error_before_um == pytest.approx(316.2, abs=0.05)


async def test_no_move_is_longer_than_the_largest_placement_error(tmp_path: Path) -> None:
    """The head is nominally within it, and the board lies off by as much again: together it is too far."""
    world = _world(tmp_path, max_placement_um=400.0, match_um=450.0)
    world.true_pose = Rigid2(0.0, 60_300.0, 40_000.0)
    world.put_tip(np.subtract(world.config.board.pose().apply(BOARD.find("A").place_um), (300.0, 0.0)))
    fault = await _fault(world)
    assert fault.kind is FaultCode.CORRECTION_TOO_LARGE
    assert fault.detail["correction_um"] == pytest.approx(600.0, abs=0.1)
    assert "would be 600 um; allowed are 400 um (servo.max_placement_um)" in fault.message
    assert world.gantry.moves == []


async def test_white_is_lit_behind_the_drives_first_question_and_only_of_the_first_look_a_move_is_expected(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line that is dead is told as one, and not as a lamp; it settles while the drives are asked. Then it is dark."""
    lit: list[list[Light]] = []

    def watched(name: str) -> None:
        ask = getattr(world.gantry, name)

        async def asked(deadline: Deadline) -> Any:
            lit.append(list(world.lights.log))
            return await ask(deadline)

        monkeypatch.setattr(world.gantry, name, asked)

    watched("homed")
    watched("position")
    world.put_beside("A", (300.0, 200.0), 30.0)
    ran = await _correct(world)
    assert lit[:2] == [[], [Light.WHITE]]
    assert ran.job.moves == 1
    assert world.station.moves_next == [True, False]
    assert world.station.is_last == [False, True]


async def test_every_move_is_checked_lit_in_white_and_at_working_height(world: World) -> None:
    world.put_beside("A", (300.0, 200.0), 30.0)
    start = world.gantry.reported
    ran = await _correct(world)
    ((target, above),) = world.gantry.moves
    assert target in world.gantry.checked
    assert (target.x_um - start.x_um, target.y_um - start.y_um) == pytest.approx((300.0, 200.0), abs=0.1)
    assert (target.z_um, target.theta_deg, above) == (WORK_Z_UM, start.theta_deg, frozenset())
    assert world.lights.log == [Light.WHITE] * 2, "before the first look, and before the move"
    (move,) = [body for kind, body in ran.steps if kind == "move"]
    assert move == {"x_um": round(target.x_um, 2), "y_um": round(target.y_um, 2), "theta_deg": 30.0}


async def test_a_move_out_of_reach_is_refused_before_it_begins(world: World) -> None:
    """Nominally the point is within reach by 100 um; the board lies 300 um farther out."""
    x_um = 14_938.26 * math.cos(math.radians(-3.054)) + 100.0 - 60_000.0
    edge = World(world.calibrations.folder, a_board(("A", x_um, 5_000.0)), {}).teach().with_map()
    edge.true_pose = Rigid2(0.0, 59_700.0, 40_000.0)
    edge.put_tip(np.array((x_um + 60_000.0, 45_000.0)))
    ran = begin(REQUEST)
    with pytest.raises(EnvelopeViolation):
        await _correct(edge, ran)
    assert (edge.gantry.moves, ran.job.moves) == ([], 0)


async def test_a_move_that_fails_ends_the_job_with_what_is_known(world: World) -> None:
    world.put_beside("A", (300.0, 0.0))
    world.gantry.failures[1] = Stalled("blocked", device="x")
    ran = begin(REQUEST)
    with pytest.raises(Stalled):
        await _correct(world, ran)
    assert ran.events == [Event.ACCEPTED, Event.SEEN]
    assert ran.job.moves == 1
    assert ran.job.partial.error_before_um == pytest.approx(300.0, abs=0.05)
    assert ran.job.partial.error_after_um is None


# --- converging, or not -------------------------------------------------------------------------------------------


async def test_an_error_within_the_stops_scatter_may_grow_and_is_corrected_by_the_moves_after_it(world: World) -> None:
    """The drives do not see their own scatter: the second move takes it out, and misses by as much itself."""
    world.put_beside("A", (0.0, 20.0))
    world.gantry.scatter_um = lambda: _scatter(world, {1: (30.0, 0.0)})
    ran = await _correct(world)
    assert ran.job.moves == 3
    assert ran.events == [*ONE_MOVE, *[Event.OFF_TARGET, Event.ARRIVED] * 2]
    assert math.hypot(*world.miss_um("A")) < 0.1
    assert ran.got.error_before_um == pytest.approx(20.0, abs=0.02)


@pytest.mark.parametrize(("share", "goes_on"), [(1.0, False), (1.001, True)])
async def test_beyond_the_scatter_an_error_must_shrink(tmp_path: Path, share: float, goes_on: bool) -> None:
    measured = await _measured_um(_world(tmp_path), (36.0, 0.0))
    world = _world(tmp_path, scatter_um=measured * share)
    world.put_beside("A", (0.0, 20.0))
    _land_off(world, {1: (36.0, 0.0)})
    if goes_on:
        assert (await _correct(world)).job.moves == 3
        return
    ran = begin(REQUEST)
    fault = await _fault(world, ran)
    assert fault.kind is FaultCode.NOT_CONVERGING
    assert (fault.detail["before_um"], fault.detail["after_um"]) == pytest.approx((20.0, 36.0), abs=0.1)
    assert "20 um into 36 um" in fault.message
    assert ran.job.moves == 1
    assert ran.job.partial.error_after_um == pytest.approx(36.0, abs=0.1)


def _land_off(world: World, by_move: dict[int, tuple[float, float]]) -> None:
    """Let moves end so far from the pad, whatever their target."""

    def scatter() -> tuple[float, float]:
        off = by_move.get(len(world.gantry.moves))
        if off is None:
            return 0.0, 0.0
        target = world.gantry.moves[-1][0]
        tip = np.array((target.x_um, target.y_um)) + world.true_head.tip_offset_um(target.theta_deg)
        x_um, y_um = world.pad_um("A") - off - tip
        return float(x_um), float(y_um)

    world.gantry.scatter_um = scatter


async def test_a_large_error_that_shrinks_a_little_is_followed(world: World) -> None:
    """The drives say where they stopped; the error they leave is corrected from there."""
    world.put_beside("A", (300.0, 0.0))
    world.gantry.off_um = (-25.0, 0.0, 0.0)
    with pytest.raises(Fault, match="still 25 um off after 8 moves"):
        await _correct(world)
    assert len(world.gantry.moves) == 8


async def test_tries_are_bounded_and_the_last_error_is_told(tmp_path: Path) -> None:
    world = _world(tmp_path, max_moves=3)
    world.put_beside("A", (300.0, 0.0))
    world.gantry.off_um = (0.0, 30.0, 0.0)
    ran = begin(REQUEST)
    fault = await _fault(world, ran)
    assert fault.kind is FaultCode.NOT_CONVERGING
    assert fault.detail["error_um"] == pytest.approx(30.0, abs=0.1)
    assert "still 30 um off after 3 moves (tolerance 15 um)" in fault.message
    assert (ran.job.moves, len(world.gantry.moves), ran.job.looks) == (3, 3, 4)
    assert ran.job.partial.error_after_um == pytest.approx(30.0, abs=0.1)


async def test_a_map_that_points_the_wrong_way_is_found_out_by_the_first_move(world: World) -> None:
    turned = np.diag((-1.0, -1.0, 1.0)) @ world.true_map.homography
    world.with_map(pose_map(homography=turned))
    world.with_alignment(world.config.board.pose())
    world.put_beside("A", (100.0, 0.0))
    fault = await _fault(world)
    assert fault.kind in {FaultCode.NOT_CONVERGING, FaultCode.AMBIGUOUS}
    assert len(world.gantry.moves) == 1


async def test_a_second_look_that_contradicts_the_first_is_a_fault(world: World) -> None:
    """Between two looks the pad seems to have gone 200 um: what is there now is not what was followed."""
    world.put_beside("A", (300.0, 0.0))
    world.station.always = lambda seen: seen
    shifted_pose = Rigid2(0.0, 60_000.0, 40_200.0)

    def moved(look: LookResult) -> LookResult:
        world.true_pose = shifted_pose
        assert look.tip
        search = world.station.searches[-1]
        return replace(look, seen=world.see_pads(look.tip, search))  # type: ignore[arg-type]

    world.station.script = dict.fromkeys((2, 3, 4), moved)
    fault = await _fault(world)
    assert fault.kind is FaultCode.AMBIGUOUS
    assert "not what was seen before" in fault.message


# --- what stands in the way ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta_deg", [0.0, 70.0, 200.0])
def test_a_sidestep_brings_a_pad_out_from_behind_the_taper(world: World, theta_deg: float) -> None:
    point, exact = BOARD.find("A"), world.true_map
    step = np.array(sidestep_um(world.context, point, exact, theta_deg))
    (px,) = exact.to_px(-step, TIP_PX, theta_deg)
    way = px - TIP_PX - BELOW_PX
    along, across = rotation(-math.degrees(NEEDLE_RAD)) @ way
    radius_px = 250.0 * exact.scale_px_per_um(TIP_PX)
    assert along == pytest.approx(0.0, abs=1e-6)
    assert across == pytest.approx(SHAPE.cylinder_half_px / 2 + radius_px + SIDESTEP_MARGIN_PX)


async def test_a_hidden_pad_is_looked_at_from_beside(world: World) -> None:
    world.put_beside("A", (40.0, -30.0), 20.0)
    start = world.gantry.reported
    world.station.script = dict.fromkeys((1, 2, 3), _hide)
    ran = await _correct(world)
    step = sidestep_um(world.context, BOARD.find("A"), world.true_map, 20.0)
    aside = world.gantry.moves[0][0]
    assert (aside.x_um - start.x_um, aside.y_um - start.y_um) == pytest.approx(step, abs=1e-6)
    assert ran.events == [*ONE_MOVE, Event.OFF_TARGET, Event.ARRIVED]
    assert (ran.got.outcome, ran.job.moves) == ("corrected", 2)
    assert ran.got.error_before_um == pytest.approx(50.0, abs=0.05), "told from where the touch was missed"
    assert math.hypot(*world.miss_um("A")) < 0.1


async def test_what_one_side_does_not_show_the_other_side_may(world: World) -> None:
    world.put_beside("A", (40.0, -30.0))
    start = world.gantry.reported
    world.station.script = dict.fromkeys(range(1, 7), _hide)
    ran = await _correct(world)
    (dx, dy), sides = sidestep_um(world.context, BOARD.find("A"), world.true_map, 0.0), world.gantry.moves[:2]
    went = [(to.x_um - start.x_um, to.y_um - start.y_um) for to, _ in sides]
    assert went == [pytest.approx((dx, dy)), pytest.approx((-dx, -dy))]
    assert (ran.got.outcome, ran.job.moves, ran.job.looks) == ("corrected", 3, 8)


async def test_a_pad_that_is_too_far_off_from_one_side_is_reached_from_the_other(world: World) -> None:
    """A needle that came down well beside its pad stands twice as far off where it steps aside to the wrong side."""
    step = np.array(sidestep_um(world.context, BOARD.find("A"), world.true_map, 0.0))
    world.with_map(pose_map(radius_um=1.3 * float(np.hypot(*step))))
    world.put_beside("A", tuple(-0.6 * step))
    world.station.script = dict.fromkeys((1, 2, 3), _hide)
    ran = await _correct(world)
    assert (ran.got.outcome, ran.job.moves) == ("corrected", 3)
    assert math.hypot(*world.miss_um("A")) < 0.1


async def test_what_no_side_shows_is_the_first_fault_and_the_head_goes_back(world: World) -> None:
    world.put_beside("A", (40.0, -30.0))
    start = world.gantry.reported

    def doubtful(look: LookResult) -> LookResult:
        assert look.seen is not None
        return replace(look, seen=Seen(missing(Reason.UNDECIDED), (), (), (), (0, 0, 10, 10)))

    world.station.always = doubtful
    ran = begin(REQUEST)
    fault = await _fault(world, ran)
    assert fault.kind is FaultCode.TEST_POINT_NOT_FOUND
    assert ran.job.moves == 3
    assert world.gantry.moves[-1][0] == start
    assert ran.job.looks == 9
    assert ran.job.partial.error_before_um is None


async def test_landing_on_the_pad_by_the_sidestep_is_a_correction(world: World) -> None:
    step = sidestep_um(world.context, BOARD.find("A"), world.true_map, 0.0)
    world.put_beside("A", step)
    world.station.script = dict.fromkeys((1, 2, 3), _hide)
    ran = await _correct(world)
    assert (ran.got.outcome, ran.job.moves) == ("corrected", 1)
    assert ran.got.error_before_um == pytest.approx(math.hypot(*step), abs=0.05)


async def test_without_a_tip_nothing_moves(world: World) -> None:
    world.put_beside("A", (40.0, -30.0))
    world.station.always = _without_tip
    ran = begin(REQUEST)
    assert (await _fault(world, ran)).kind is FaultCode.TIP_NOT_FOUND
    assert (world.gantry.moves, ran.job.looks) == ([], 3)


async def test_a_tip_lost_beside_the_pad_returns_the_head_and_keeps_the_first_cause(world: World) -> None:
    world.put_beside("A", (40.0, -30.0))
    start = world.gantry.reported
    world.station.script = dict.fromkeys((1, 2, 3), _hide) | dict.fromkeys((4, 5, 6), _without_tip)
    fault = await _fault(world)
    assert fault.kind is FaultCode.TEST_POINT_NOT_FOUND
    assert fault.detail["aside"]["name"] == "tip_not_found"
    assert len(world.gantry.moves) == 2
    assert world.gantry.moves[-1][0] == start


async def test_a_sidestep_beyond_the_calibrated_radius_is_not_taken(world: World) -> None:
    world.with_map(pose_map(radius_um=100.0))
    world.put_beside("A", (10.0, 0.0))
    world.station.always = _hide
    fault = await _fault(world)
    assert fault.kind is FaultCode.TEST_POINT_NOT_FOUND
    assert fault.detail["aside"]["name"] == "correction_too_large"
    assert world.gantry.moves == []


async def test_a_camera_that_fails_beside_the_pad_returns_the_head_and_is_latched_with_the_first_cause(
    world: World,
) -> None:
    world.put_beside("A", (40.0, -30.0))
    start = world.gantry.reported

    def blind(_seen: LookResult) -> LookResult:
        raise CameraError("gone", device="camera")

    world.station.script = dict.fromkeys((1, 2, 3), _hide) | {4: blind}
    fault = await _fault(world)
    assert fault.kind is FaultCode.CAMERA_FAILED
    assert fault.detail["first_cause"]["name"] == "test_point_not_found"
    assert world.gantry.moves[-1][0] == start


async def test_after_an_axis_that_stalled_beside_the_pad_nothing_moves(world: World) -> None:
    world.put_beside("A", (40.0, -30.0))
    world.station.always = _hide
    world.gantry.failures[1] = Stalled("stuck", device="x")
    with pytest.raises(Stalled):
        await _correct(world)
    assert len(world.gantry.moves) == 1


async def test_the_last_look_is_what_live_pictures_show(world: World) -> None:
    """The way from the place below the needle to the target, in the picture, is the error that is answered."""
    world.put_beside("A", (6.0, -8.0))
    await _correct(world)
    sight = world.station.needle.sight
    assert sight is not None
    assert sight.off_um == pytest.approx(10.0, abs=0.02)
    off_px = math.dist(sight.at_px, sight.target_px)
    assert off_px / sight.off_um == pytest.approx(sight.tolerance_px / world.context.servo.tolerance_um, rel=0.1)


async def test_a_look_that_shows_no_target_leaves_nothing_to_show(world: World) -> None:
    world.put_beside("A", (6.0, -8.0))
    await _correct(world)
    world.station.always = _hide
    await _fault(world)
    assert world.station.needle.sight is None
