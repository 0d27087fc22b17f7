"""The board's pose is what its fiducials show; what speaks against it is refused, and no pose is in force then."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.board_in_nest import require_board
from daemon.procedures.correct import sidestep_um
from daemon.procedures.registry import PROCEDURES
from daemon.station.station import LookResult
from daemon.storage.calibration_records import AlignmentRecord
from daemon.storage.calibration_store import Calibrations
from drivers.errors import EnvelopeViolation
from tests.daemon.procedures.fake_station import Ran, World, a_board, begin, missing, run
from vision import NotFound, Reason, Seen
from vision.geometry.frames import Rigid2
from vision.geometry.similarity import Similarity2
from vision.head.model import CircleHead

FIDUCIALS = (("F1", 1_000.0, 1_000.0), ("F2", 17_000.0, 1_500.0), ("F3", 2_000.0, 15_000.0), ("F4", 16_500.0, 14_500.0))
BOARD = a_board(*FIDUCIALS, kind="fiducial")
POINTS = a_board(("A", 15_000.0, 20_000.0), ("B", 20_000.0, 2_000.0))
WHOLE = BOARD.model_copy(update={"points": (*BOARD.points, *POINTS.points)})
ALIGN = {"op": "align"}


@pytest.fixture
def world(tmp_path: Path) -> World:
    return _world(tmp_path)


def _world(folder: Path, points: Any = WHOLE, **changes: dict[str, Any]) -> World:
    return World(folder, points, changes).teach().with_map()


async def _align(world: World, request: dict[str, Any] | None = None, ran: Ran | None = None) -> Ran:
    return await run(world, PROCEDURES["align"], ALIGN | (request or {}), ran)


async def _fault(world: World, request: dict[str, Any] | None = None, ran: Ran | None = None) -> Fault:
    with pytest.raises(Fault) as caught:
        await _align(world, request, ran)
    return caught.value


def _record(world: World) -> AlignmentRecord:
    record = world.calibrations.alignment(world.board)
    assert record is not None
    return record


def _lying(world: World, turn_deg: float, dx_um: float, dy_um: float, scale: float = 1.0) -> None:
    """Let the board lie turned and scaled about the fiducials' centre, and shifted."""
    nominal = world.config.board.pose()
    centre = np.mean([(x, y) for _, x, y in FIDUCIALS], axis=0)
    c, s = scale * math.cos(math.radians(turn_deg)), scale * math.sin(math.radians(turn_deg))
    turned = Similarity2(c, s, 0.0, 0.0, 0.0).apply(centre)
    tx_um, ty_um = np.add(nominal.apply(centre), (dx_um, dy_um)) - turned
    world.true_pose = Similarity2(c, s, float(tx_um), float(ty_um), 0.0)  # type: ignore[assignment]


# --- what comes out -----------------------------------------------------------------------------------------------


async def test_the_pose_is_where_the_board_really_lies(world: World) -> None:
    _lying(world, 0.8, 210.0, -140.0)
    ran = await _align(world)
    for point in world.board.points:
        assert world.geometry.board_to_robot_um(point.place_um) == pytest.approx(world.pad_um(point.name), abs=0.05)
    assert ran.got.outcome == "aligned"
    told = ran.got.detail
    assert (told["board"], told["side"], told["fiducials"]) == ("b", "top", 4)
    assert told["turn_deg"] == pytest.approx(0.8, abs=1e-4)
    middle = np.array((20_000.0, 15_000.0))
    assert told["shift_um"] == pytest.approx(
        (world.true_pose.apply(middle) - world.config.board.pose().apply(middle)).tolist(), abs=0.11
    )
    assert told["scale_ppm"] == pytest.approx(0.0, abs=3)
    assert told["rms_um"] == pytest.approx(0.0, abs=0.05)
    assert Path(told["record"]).exists()


async def test_the_turn_is_told_against_the_configured_one(tmp_path: Path) -> None:
    world = _world(tmp_path, board={"rotation_deg": 10.0})
    world.true_pose = Rigid2(10.5, 60_030.0, 40_000.0)
    assert (await _align(world)).got.detail["turn_deg"] == pytest.approx(0.5, abs=1e-3)


async def test_the_record_keeps_where_each_fiducial_was_seen(world: World) -> None:
    _lying(world, 0.0, 100.0, 50.0, scale=1.0005)
    await _align(world)
    record = _record(world)
    assert [f.name for f in record.fiducials] == ["F1", "F2", "F3", "F4"]
    for seen in record.fiducials:
        assert seen.robot_um == pytest.approx(tuple(world.pad_um(seen.name)), abs=0.05)
        assert seen.board_um == world.board.find(seen.name).place_um
        assert seen.views == 2
        assert seen.residual_um == pytest.approx((0.0, 0.0), abs=0.05)
    assert record.scale == pytest.approx(1.0005, abs=1e-5)
    assert (record.looks, record.job, record.what) == (8, "job-1", "alignment")


async def test_every_fiducial_is_looked_at_from_every_angle_and_the_states_are_walked(world: World) -> None:
    ran = await _align(world, {"thetas_deg": [0.0, 90.0, 180.0], "fiducials": ["F1", "F2", "F3"]})
    assert [round(to.theta_deg) for to, _ in world.gantry.moves] == [0, 0, 0, 90, 90, 90, 180, 180, 180]
    assert ran.events[:3] == [Event.ACCEPTED, Event.SEEN, Event.ARRIVED]
    assert ran.events[3:] == [Event.OFF_TARGET, Event.ARRIVED] * 8
    assert ran.progress[0] == (0, 9, "looking at F1")
    assert ran.progress[-1] == (8, 9, "looking at F3")
    assert (ran.job.looks, ran.job.moves) == (9, 9)
    assert _record(world).fiducials[0].views == 3


async def test_what_the_head_is_off_at_opposite_angles_cancels(world: World) -> None:
    nominal = world.config.head
    world.true_head = CircleHead(nominal.radius_um, nominal.phase_deg + 0.2)
    await _align(world)
    for point in world.board.points[:4]:
        assert world.geometry.board_to_robot_um(point.place_um) == pytest.approx(world.pad_um(point.name), abs=1.0)


async def test_it_looks_where_the_configuration_has_the_board_though_another_lay_elsewhere(world: World) -> None:
    world.with_alignment(Rigid2(0.0, 60_300.0, 40_200.0))
    await _align(world)
    first = world.gantry.moves[0][0]
    assert (first.x_um, first.y_um) == pytest.approx(
        tuple(world.pad_um("F1") - world.config.head.model().tip_offset_um(0.0)), abs=0.01
    )
    assert _record(world).tx_um == pytest.approx(60_000.0, abs=0.1)


# --- what is asked for --------------------------------------------------------------------------------------------


async def test_round_targets_may_be_named_instead(world: World) -> None:
    ran = await _align(world, {"fiducials": ["A", "F1", "B"]})
    assert ran.got.detail["fiducials"] == 3
    assert [f.name for f in _record(world).fiducials] == ["A", "F1", "B"]


async def test_a_name_given_twice_or_unknown_is_refused(world: World) -> None:
    twice = await _fault(world, {"fiducials": ["F2", "F1", "F3", "F1"]})
    assert (twice.kind, twice.message) == (FaultCode.INVALID_REQUEST, "F1 is named twice")
    assert (await _fault(world, {"fiducials": ["F1", "F2", "nil"]})).kind is FaultCode.UNKNOWN_TEST_POINT
    assert world.gantry.moves == []


@pytest.mark.parametrize(("count", "good"), [(3, True), (2, False)])
async def test_a_board_needs_three_fiducials_of_its_own(tmp_path: Path, count: int, good: bool) -> None:
    world = _world(tmp_path, WHOLE.model_copy(update={"points": (*BOARD.points[:count], *POINTS.points)}))
    if good:
        assert (await _align(world)).got.detail["fiducials"] == 3
        return
    fault = await _fault(world)
    assert fault.kind is FaultCode.INVALID_REQUEST
    assert "has 2 fiducials on its top; 3 are needed" in fault.message


async def test_it_needs_probe_map_and_homing(tmp_path: Path) -> None:
    world = World(tmp_path, WHOLE, {})
    ran = begin(ALIGN)
    assert "tip has not been taught" in (await _fault(world, ran=ran)).message
    assert "map from image" in (await _fault(world.teach())).message
    world.with_map()
    world.gantry.is_homed = False
    assert (await _fault(world)).kind is FaultCode.NOT_HOMED
    assert (ran.events, world.gantry.moves) == ([], [])


@pytest.mark.parametrize(("room_um", "good"), [(690.0, False), (710.0, True)])
@pytest.mark.parametrize("end", ["low x", "high x", "low y", "high y"])
async def test_there_must_be_room_for_the_largest_placement_error_round_every_stop(
    tmp_path: Path, end: str, room_um: float, good: bool
) -> None:
    free = _world(tmp_path / "free")
    await _align(free, {"thetas_deg": [0.0]})
    at = [to for to, _ in free.gantry.moves]
    x, y = [p.x_um for p in at], [p.y_um for p in at]
    limits = {
        "low x": ("x", {"minimum": min(x) - room_um}),
        "high x": ("x", {"maximum": max(x) + room_um}),
        "low y": ("y", {"minimum": min(y) - room_um}),
        "high y": ("y", {"maximum": max(y) + room_um}),
    }
    axis, change = limits[end]
    world = _world(tmp_path / "tight", axes={axis: getattr(free.config.axes, axis).model_copy(update=change)})
    ran = begin(ALIGN | {"thetas_deg": [0.0]})
    if good:
        await _align(world, {"thetas_deg": [0.0]}, ran)
        return
    with pytest.raises(EnvelopeViolation):
        await _align(world, {"thetas_deg": [0.0]}, ran)
    assert (world.gantry.moves, ran.events) == ([], [])


# --- what speaks against it ---------------------------------------------------------------------------------------


def _moved(world: World, name: str, off_um: float) -> None:
    """Let one fiducial lie elsewhere than CAD says, across the board's diagonal, so that no scale explains it."""
    aside = {p.name: off_um / math.sqrt(2.0) if p.name == name else 0.0 for p in world.pads}
    world.pads = [
        p.model_copy(update={"x_um": p.x_um + aside[p.name], "y_um": p.y_um - aside[p.name]}) for p in world.pads
    ]


async def _residual_um(folder: Path, off_um: float) -> float:
    world = _world(folder)
    _moved(world, "F1", off_um)
    await _align(world)
    return max(math.hypot(*f.residual_um) for f in _record(world).fiducials)


async def test_a_fiducial_that_is_off_the_others_is_named_and_no_pose_is_in_force(world: World) -> None:
    world.with_alignment(Rigid2(0.0, 60_000.0, 40_000.0))
    _moved(world, "F1", 400.0)
    fault = await _fault(world)
    assert fault.kind is FaultCode.CALIBRATION_FAILED
    assert "the board cannot be aligned" in fault.message
    assert "F1" in fault.message
    assert "alignment" not in world.calibrations.records
    assert "did not pass" in world.calibrations.problems["alignment"]


async def test_after_a_refused_alignment_no_board_passes_until_one_is_aligned_whatever_restarts(world: World) -> None:
    await _align(world)
    world.calibrations.require_board(world.board, None)
    _moved(world, "F1", 400.0)
    await _fault(world)
    restarted = Calibrations(world.calibrations.folder, world.config.station.name)
    restarted.load()
    for calibrations in (world.calibrations, restarted):
        with pytest.raises(Fault) as refused:
            calibrations.require_board(world.board, None)
        assert refused.value.kind is FaultCode.NOT_ALIGNED
    world.pads = list(world.board.points)
    await _align(world)
    restarted.load()
    for calibrations in (world.calibrations, restarted):
        calibrations.require_board(world.board, None)


@pytest.mark.parametrize(("board_id", "refused_first"), [("SN-2", True), (None, False)])
async def test_no_correction_is_made_on_a_board_that_was_not_aligned(
    world: World, board_id: str | None, refused_first: bool
) -> None:
    await _align(world, {"board_id": "SN-1"})
    if not refused_first:
        _moved(world, "F1", 400.0)
        await _fault(world)
        world.pads = list(world.board.points)
    world.put_beside("A", (30.0, 0.0))
    moves = len(world.gantry.moves)
    request = {"op": "correct", "test_point": "A", "board_id": board_id}
    with pytest.raises(Fault) as caught:
        await run(world, PROCEDURES["correct"], request)
    assert caught.value.kind is FaultCode.NOT_ALIGNED
    assert len(world.gantry.moves) == moves
    await _align(world, {"board_id": "SN-2"})
    world.put_beside("A", (30.0, 0.0))
    assert (await run(world, PROCEDURES["correct"], request)).got.outcome == "corrected"


async def test_a_refusal_before_anything_moved_leaves_the_old_pose(world: World) -> None:
    await _align(world)
    before = _record(world)
    world.gantry.is_homed = False
    assert (await _fault(world)).kind is FaultCode.NOT_HOMED
    assert _record(world) == before


async def test_another_board_in_the_nest_is_refused_until_it_was_aligned(world: World) -> None:
    await _align(world, {"board_id": "SN-1"})
    await require_board(world.context, "SN-1")
    await require_board(world.context, None)
    with pytest.raises(Fault) as refused:
        await require_board(world.context, "SN-2")
    assert refused.value.kind is FaultCode.NOT_ALIGNED
    for board_id in (None, "SN-1", "SN-2"):
        with pytest.raises(Fault) as refused:
            await require_board(world.context, board_id)
        assert refused.value.kind is FaultCode.NOT_ALIGNED, "a board that was taken out lies elsewhere now"
    await _align(world, {"board_id": "SN-2"})
    await require_board(world.context, "SN-2")


async def test_a_board_that_was_exchanged_twice_is_known_by_its_last_name(world: World) -> None:
    await _align(world, {"board_id": "SN-1"})
    for board_id in ("SN-2", "SN-3"):
        with pytest.raises(Fault):
            await require_board(world.context, board_id)
    with pytest.raises(Fault, match="board SN-3 was put into the nest") as refused:
        await require_board(world.context, None)
    assert "--board-id SN-3" in refused.value.advice


async def test_residuals_are_allowed_up_to_60_um(tmp_path: Path) -> None:
    per_um = await _residual_um(tmp_path / "a", 40.0) / 40.0
    assert await _residual_um(tmp_path / "b", 59.5 / per_um) == pytest.approx(59.5, abs=0.3)
    world = _world(tmp_path / "c")
    _moved(world, "F1", 60.5 / per_um)
    assert (await _fault(world)).kind is FaultCode.CALIBRATION_FAILED


@pytest.mark.parametrize(("scale", "good"), [(1.0019, True), (1.0021, False), (0.9981, True), (0.9979, False)])
async def test_the_scale_is_one_to_two_thousandths(world: World, scale: float, good: bool) -> None:
    _lying(world, 0.0, 0.0, 0.0, scale)
    if good:
        assert (await _align(world)).got.detail["scale_ppm"] == pytest.approx((scale - 1) * 1e6, abs=20)
    else:
        assert "times as large" in (await _fault(world)).message


@pytest.mark.parametrize(("turn_deg", "good"), [(2.95, True), (3.05, False), (-2.95, True), (-3.05, False)])
async def test_a_board_may_be_turned_by_three_degrees(world: World, turn_deg: float, good: bool) -> None:
    _lying(world, turn_deg, 0.0, 0.0)
    if good:
        assert (await _align(world)).got.detail["turn_deg"] == pytest.approx(turn_deg, abs=1e-3)
    else:
        assert "is turned by" in (await _fault(world)).message


async def test_a_board_off_by_more_than_the_largest_placement_error_is_refused(tmp_path: Path) -> None:
    world = _world(tmp_path, servo={"max_placement_um": 200.0, "match_um": 400.0})
    _lying(world, 0.0, 180.0, 0.0)
    await _align(world)
    _lying(world, 0.0, 205.0, 0.0)
    assert (await _fault(world)).kind in {FaultCode.CALIBRATION_FAILED, FaultCode.TEST_POINT_NOT_FOUND}


# --- what stands in the way ---------------------------------------------------------------------------------------


def _hide(look: LookResult) -> LookResult:
    return replace(look, seen=Seen(missing(), (), (), (), (0, 0, 10, 10)))


async def test_a_hidden_fiducial_is_looked_at_from_beside(world: World) -> None:
    _lying(world, 0.0, 60.0, 20.0)
    world.station.script = dict.fromkeys((1, 2, 3), _hide)
    ran = await _align(world, {"thetas_deg": [30.0]})
    first, aside = (to for to, _ in world.gantry.moves[:2])
    step = sidestep_um(world.context, world.board.find("F1"), world.true_map, 30.0)
    assert (aside.x_um - first.x_um, aside.y_um - first.y_um) == pytest.approx(step)
    assert ran.job.moves == 5
    assert _record(world).fiducials[0].robot_um == pytest.approx(tuple(world.pad_um("F1")), abs=0.05)


async def test_the_step_aside_is_no_longer_than_the_largest_placement_error(tmp_path: Path) -> None:
    world = _world(tmp_path, servo={"max_placement_um": 150.0, "match_um": 400.0})
    world.station.script = dict.fromkeys((1, 2, 3), _hide)
    await _align(world, {"thetas_deg": [0.0]})
    first, aside = (to for to, _ in world.gantry.moves[:2])
    dx, dy = sidestep_um(world.context, world.board.find("F1"), world.true_map, 0.0)
    assert math.hypot(dx, dy) > 300.0
    share = 150.0 / math.hypot(dx, dy)
    assert (aside.x_um - first.x_um, aside.y_um - first.y_um) == pytest.approx((dx * share, dy * share))


async def test_a_fiducial_seen_from_nowhere_is_a_fault_with_its_name(world: World) -> None:
    world.hidden = {"F2"}
    fault = await _fault(world)
    assert fault.kind is FaultCode.TEST_POINT_NOT_FOUND
    assert fault.message.startswith("F2 was not seen at 0 deg: F2: no pad is seen")
    assert "this board lies in its nest" in fault.advice
    assert fault.detail["candidates_um"] == []
    assert len(world.gantry.moves) == 3, "F1, F2, and beside F2"
    assert world.calibrations.alignment(world.board) is None


async def test_without_a_tip_there_is_no_step_aside(world: World) -> None:
    world.station.always = lambda look: replace(look, tip=NotFound(Reason.NO_NEEDLE, "none"), seen=None)
    fault = await _fault(world)
    assert (fault.kind, len(world.gantry.moves)) == (FaultCode.TIP_NOT_FOUND, 1)
    assert fault.detail["reason"] == "no_needle"
