"""The seat is verified by places that are found once on the board; what lies there instead is named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.domain.board import SeatPlace
from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.registry import PROCEDURES
from daemon.procedures.seat import SeatViews
from daemon.station.board_view import BoardSearch
from daemon.station.free_pin import FreePin
from daemon.station.station import LOOKS_FOR_FREE, LookResult
from daemon.storage.calibration_records import AlignmentRecord, SeatLook
from drivers.errors import EnvelopeViolation
from drivers.gantry import Position
from tests.daemon.procedures.cad_board import cad_board, cad_pad
from tests.daemon.procedures.fake_station import Ran, World, run
from vision import NotFound, Reason
from vision.geometry.frames import Rigid2
from vision.registration import Edges, LayerFit, LayerShifts, NotRegistered, Refusal

SEAT = tuple(
    SeatPlace(x_um=x, y_um=y, rival=0.5)
    for x, y in (
        (8_000.0, 8_000.0),
        (32_000.0, 8_000.0),
        (8_000.0, 22_000.0),
        (32_000.0, 22_000.0),
        (20_000.0, 15_000.0),
    )
)
BOARD = cad_board(cad_pad("R1.1", 15_000.0, 12_000.0), cad_pad("R1.2", 30_000.0, 20_000.0),
                  cad_pad("R2.1", 10_000.0, 22_000.0), seat=SEAT)  # fmt: skip


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path, BOARD, {}).teach().with_map()


async def _align(world: World, **request: Any) -> Ran:
    return await run(world, PROCEDURES["align"], {"op": "align", **request})


async def _fault(world: World, **request: Any) -> Fault:
    with pytest.raises(Fault) as caught:
        await _align(world, **request)
    return caught.value


def _record(world: World) -> AlignmentRecord:
    record = world.calibrations.alignment(world.board)
    assert record is not None
    return record


def _refused(reason: Refusal, message: str = "seen otherwise") -> Callable[[LookResult], LookResult]:
    def edit(look: LookResult) -> LookResult:
        assert look.board is not None
        return replace(look, board=replace(look.board, found=NotRegistered(reason, message)))

    return edit


def _places(world: World) -> list[tuple[float, float]]:
    return [s.reference.about_um for s in world.station.searches if isinstance(s, BoardSearch)]


async def test_unique_places_give_the_pose_and_verify_the_seat(world: World) -> None:
    nominal = world.config.board.pose()
    world.true_pose = Rigid2(nominal.theta_deg + 0.2, nominal.tx_um + 150.0, nominal.ty_um - 90.0)
    ran = await _align(world)
    assert ran.got.detail["seat"]["verified"] is True  # type: ignore[index]
    for place in (p.place_um for p in BOARD.points):
        assert world.geometry.board_to_robot_um(place) == pytest.approx(world.true_pose.apply(place), abs=0.5)
    record = _record(world)
    assert record.seat is not None
    assert {look.theta_deg for look in record.seat.looks} == {0.0, 180.0}
    assert record.seat.places == len(record.fiducials) == 4


async def test_no_round_target_and_no_fiducial_is_needed(world: World) -> None:
    assert not [p for p in BOARD.points if p.stands_round or p.kind == "fiducial"]
    assert (await _align(world)).got.outcome == "aligned"


async def test_a_dirty_place_is_replaced_by_the_next(world: World) -> None:
    world.station.script = {2: _refused(Refusal.NOT_THIS_BOARD)}
    await _align(world)
    assert len(set(_places(world))) == 5
    assert len(_record(world).fiducials) == 4


def _hidden(look: LookResult) -> LookResult:
    return replace(look, tip=NotFound(Reason.NO_NEEDLE, "busy ground"), board=None)


async def test_where_the_needle_is_not_seen_it_is_looked_at_from_beside(world: World) -> None:
    world.station.script = {1: _hidden}
    await _align(world)
    first, second = _places(world)[:2]
    assert first == second
    assert len(_record(world).fiducials) == 4


async def test_a_part_as_grey_as_the_needle_is_looked_past_from_farther_aside(world: World) -> None:
    """A body of some millimetres lies behind the needle from all of the first stops."""
    world.station.script = dict.fromkeys((1, 2, 3), _hidden)
    await _align(world)
    assert len(set(_places(world)[:4])) == 1
    stops = [target for target, _ in world.gantry.moves[:4]]
    assert abs(stops[3].x_um - stops[0].x_um) > 2_000.0
    assert len(_record(world).fiducials) == 4


async def test_the_needle_does_not_come_down_where_a_part_stands(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """It hovers lower than many parts are high; a place all over which parts stand comes last."""
    first, second = ((place.x_um, place.y_um) for place in SEAT[:2])

    def covers(low_um: Any, high_um: Any) -> list[object]:
        x, y = (low_um + high_um) / 2
        over_first = abs(x - first[0]) < 4_000.0 and abs(y - first[1]) < 4_000.0
        return [object()] if over_first or (x, y) == pytest.approx(second, abs=100.0) else []

    monkeypatch.setattr(world.context.references.sides.obstacles, "covers_near", covers)
    await _align(world)
    assert first not in _places(world)
    stops = [target for target, _ in world.gantry.moves]
    on_board = [world.config.board.pose().inverse().apply(world.geometry.tip_um(stop)) for stop in stops]
    assert not any(covers(at - 1.0, at + 1.0) for at in on_board)
    assert second in _places(world), "it is looked at from beside"


@pytest.mark.parametrize("poor", ["hidden", Refusal.NOT_THIS_BOARD, Refusal.BOARD_TURNED])
async def test_a_place_that_the_other_angle_hides_is_left_out_of_both(world: World, poor: str | Refusal) -> None:
    """It should not end an alignment that has enough places; half of one would pull the fit aside."""
    hides = SEAT[0].x_um, SEAT[0].y_um
    _turned_at(world, {hides}, _refused(poor) if isinstance(poor, Refusal) else _hidden)
    await _align(world)
    record = _record(world)
    assert len(record.fiducials) == 3
    assert record.seat is not None
    assert {look.board_um for look in record.seat.looks}.isdisjoint({hides})


async def test_too_few_places_from_the_other_angle_are_refused_with_the_reason(world: World) -> None:
    world.station.always = lambda look: _hidden(look) if abs(look.position.theta_deg) > 90.0 else look
    assert (await _fault(world)).kind is FaultCode.TIP_NOT_FOUND


def _turned_at(world: World, hides: set[tuple[float, float]], edit: Callable[[LookResult], LookResult]) -> None:
    """Have these places look otherwise from the other head angle."""

    def turned(look: LookResult) -> LookResult:
        search = world.station.searches[-1]
        here = isinstance(search, BoardSearch) and search.reference.about_um in hides
        return edit(look) if here and abs(look.position.theta_deg) > 90.0 else look

    world.station.always = turned


def _poor(agreement: float, **changes: Any) -> Callable[[LookResult], LookResult]:
    """A view in which the board is where it is, and too little of it agrees."""

    def edit(look: LookResult) -> LookResult:
        assert look.board is not None
        best = replace(look.board.found, agreement=agreement, **changes)  # type: ignore[type-var]
        refused = NotRegistered(Refusal.NOT_THIS_BOARD, "0.75 agrees (0.75 needed)", best)  # type: ignore[arg-type]
        return replace(look, board=replace(look.board, found=refused))

    return edit


async def test_poor_views_of_where_the_other_angle_has_a_place_count(world: World) -> None:
    """Each by itself does not say which board this is; a full one of the same place did."""
    _turned_at(world, {(place.x_um, place.y_um) for place in SEAT}, _poor(0.74))
    await _align(world)
    record = _record(world)
    assert len(record.fiducials) == 4
    assert record.seat is not None
    assert record.seat.agreement == 0.74


@pytest.mark.parametrize(
    "poor",
    [_poor(0.59), _poor(0.74, log_odds=5.0), _poor(0.74, target_px=(1_000.0, 500.0)),
     _poor(0.74, at_target=None, near=Edges(0.0, 0.0, 0, 0.0))],
    ids=["hardly anything agrees", "another place does as well", "elsewhere", "no metal edge near"],
)  # fmt: skip
async def test_poor_views_that_show_less_or_another_place_do_not(world: World, poor: Any) -> None:
    _turned_at(world, {(place.x_um, place.y_um) for place in SEAT}, poor)
    assert (await _fault(world)).kind is FaultCode.NOT_THIS_BOARD


async def test_a_named_target_that_a_poor_view_contradicts_is_refused(world: World) -> None:
    """A fuller view of the same would be refused as not confirmed."""
    point = world.board.find("R1.1")
    contradicted = _poor(0.74, at_target=Edges(0.05, 0.9, 100, 0.0))
    _turned_at(world, {(point.x_um, point.y_um)}, contradicted)
    assert (await _fault(world, fiducials=["R1.1", "R1.2", "R2.1"])).kind is FaultCode.NOT_THIS_BOARD


async def test_a_place_without_which_the_others_lie_in_a_row_is_not_left_out(tmp_path: Path) -> None:
    """It should say why that place was not seen, and not that fiducials nobody named lie on a line."""
    row = [SEAT[0].model_copy(update={"x_um": 6_000.0 + 9_000.0 * n, "y_um": 8_000.0 + 50.0 * n}) for n in range(3)]
    aside = SEAT[0].model_copy(update={"x_um": 20_000.0, "y_um": 24_000.0})
    world = World(tmp_path, BOARD.model_copy(update={"seat": (*row, aside)}), {}).teach().with_map()
    _turned_at(world, {(aside.x_um, aside.y_um)}, _hidden)
    assert (await _fault(world)).kind is FaultCode.TIP_NOT_FOUND


async def test_a_poor_view_from_the_first_angle_is_refused(world: World) -> None:
    world.station.always = _poor(0.74)
    assert (await _fault(world)).kind is FaultCode.NOT_THIS_BOARD


def test_a_place_that_is_left_out_takes_all_that_it_told_along() -> None:
    """What its looks said of ink and openings would still go into the board's."""
    shifts = LayerShifts((100.0, 0.0), (50.0, 0.0))
    seen = SeatViews()
    for n, name in enumerate(("seat 1", "seat 2")):
        seen.views[name] = [np.array([n * 1_000.0, 0.0])]
        seen.layers.append((name, LayerFit(shifts if n == 0 else LayerShifts(), 5.0, 5.0)))
        seen.looks.append(SeatLook(name=name, board_um=(0.0, 0.0), theta_deg=0.0, agreement=1.0 - 0.1 * n,
                                   log_odds=9.0, turn_deg=0.0, rival=0.1))  # fmt: skip
    seen.leave_out("seat 1")
    assert list(seen.views) == ["seat 2"]
    assert [look.name for look in seen.looks] == ["seat 2"]
    assert seen.seat().ink_um == (0.0, 0.0)


async def test_only_a_hidden_tip_is_looked_for_from_far_aside(world: World) -> None:
    """A target that does not show is looked at from three stops: another view from afar would not bring it back."""
    unsure = _refused(Refusal.TARGET_NOT_CONFIRMED)
    world.station.script = dict.fromkeys(range(1, 4), unsure)
    await _align(world)
    places = _places(world)
    assert places[:3] == [places[0]] * 3
    assert places[3] != places[0]


async def test_no_stop_aside_is_out_of_reach(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    check, over = world.station.check, world.geometry.position_over((SEAT[0].x_um, SEAT[0].y_um), 0.0)

    def beside(stop: Position) -> tuple[float, float]:
        return abs(stop.x_um - over.x_um), abs(stop.y_um - over.y_um)

    def narrow(target: Position) -> None:
        if 1_000.0 < max(beside(target)) < 3_000.0:
            raise EnvelopeViolation("out of reach", device="gantry")
        check(target)

    monkeypatch.setattr(world.station, "check", narrow)
    world.station.script = dict.fromkeys((1, 2, 3), _hidden)
    await _align(world)
    assert not any(1_000.0 < max(beside(target)) < 3_000.0 for target, _ in world.gantry.moves)


async def test_two_of_four_places_that_the_other_angle_hides_are_too_many(world: World) -> None:
    _turned_at(world, {(place.x_um, place.y_um) for place in SEAT[:4:3]}, _hidden)
    assert (await _fault(world)).kind is FaultCode.TIP_NOT_FOUND
    assert world.calibrations.alignment(world.board) is None


async def test_no_more_places_may_fail_in_all_than_at_one_angle(tmp_path: Path) -> None:
    """Two from the first angle and one from the other: half of what was looked at says that it is another board."""
    more = [SEAT[0].model_copy(update={"x_um": 20_000.0, "y_um": y_um}) for y_um in (8_000.0, 22_000.0)]
    world = World(tmp_path, BOARD.model_copy(update={"seat": (*SEAT, *more)}), {}).teach().with_map()
    other = _refused(Refusal.NOT_THIS_BOARD)
    world.station.script = {2: other, 3: _refused(Refusal.WRONG_SIDE)}
    once = [True]
    world.station.always = lambda look: (
        other(look) if abs(look.position.theta_deg) > 90.0 and once and once.pop() else look
    )
    assert (await _fault(world)).kind is FaultCode.NOT_THIS_BOARD


async def test_a_named_target_that_the_other_angle_hides_is_refused(world: World) -> None:
    names = ["R1.1", "R1.2", "R2.1"]
    place = world.board.point("R1.1")
    _turned_at(world, {(place.x_um, place.y_um)}, _hidden)
    assert (await _fault(world, fiducials=names)).kind is FaultCode.TIP_NOT_FOUND


async def test_a_place_off_by_a_placement_error_from_the_other_angle_ends_it(world: World) -> None:
    """It is no poor view: the board has moved."""

    def moves(look: LookResult) -> LookResult:
        if abs(look.position.theta_deg) > 90.0:
            pose = world.true_pose
            world.true_pose = Rigid2(pose.theta_deg, 2000.0, pose.ty_um)
        return look

    world.station.always = moves
    assert (await _fault(world)).kind is FaultCode.WRONG_PLACE


async def test_a_move_that_is_refused_is_not_tried_from_each_stop(world: World) -> None:
    """The needle is hidden, and nobody sees it free above either: asking again changes nothing."""
    world.station.needle.taught_free = lambda: FreePin.where_no_board_is(
        world.calibrations.require_probe(), world.context.require_map(), world.config.gantry.safe_z_um
    )
    world.station.always = _hidden
    assert (await _fault(world)).kind is FaultCode.TIP_NOT_FOUND
    assert len(world.station.searches) <= 1 + LOOKS_FOR_FREE


async def test_another_board_from_the_other_angle_is_named(world: World) -> None:
    other = _refused(Refusal.NOT_THIS_BOARD)
    world.station.always = lambda look: other(look) if abs(look.position.theta_deg) > 90.0 else look
    assert (await _fault(world)).kind is FaultCode.NOT_THIS_BOARD


@pytest.mark.parametrize("reason", [Refusal.BOARD_TURNED, Refusal.WRONG_SIDE, Refusal.NO_BOARD])
async def test_what_lies_there_instead_is_named_by_the_first_look(world: World, reason: Refusal) -> None:
    world.station.always = _refused(reason)
    assert (await _fault(world)).kind.wire_name == reason.value
    assert len(world.station.searches) == 1
    assert world.calibrations.alignment(world.board) is None
    assert "seen otherwise" in str(world.calibrations.in_force.void)


@pytest.mark.parametrize("reason", [Refusal.BOARD_TURNED, Refusal.WRONG_SIDE])
async def test_one_poor_view_after_a_place_that_was_found_is_not_believed(world: World, reason: Refusal) -> None:
    world.station.script = {2: _refused(reason)}
    await _align(world)
    assert len(set(_places(world))) == 5
    assert len(_record(world).fiducials) == 4


async def test_another_board_is_named_after_three_places(world: World) -> None:
    world.station.always = _refused(Refusal.NOT_THIS_BOARD)
    assert (await _fault(world)).kind is FaultCode.NOT_THIS_BOARD
    assert len(world.station.searches) == 3


async def test_a_board_displaced_beyond_a_placement_error_is_told_how_far(world: World) -> None:
    pose = world.true_pose
    world.true_pose = Rigid2(pose.theta_deg, pose.tx_um + 2000.0, pose.ty_um)
    fault = await _fault(world)
    assert fault.kind is FaultCode.WRONG_PLACE
    assert fault.detail["off_um"] == pytest.approx([2000.0, 0.0], abs=5.0)


async def test_named_targets_of_any_shape_align_too(world: World) -> None:
    ran = await _align(world, fiducials=["R1.1", "R1.2", "R2.1"])
    assert ran.got.detail["fiducials"] == 3
    assert ran.got.detail["seat"]["verified"] is True  # type: ignore[index]


async def test_a_board_without_unique_places_says_what_to_name(tmp_path: Path) -> None:
    alike = tuple(place.model_copy(update={"rival": 0.99}) for place in SEAT)
    world = World(tmp_path, BOARD.model_copy(update={"seat": alike}), {}).teach().with_map()
    fault = await _fault(world)
    assert fault.kind is FaultCode.INVALID_REQUEST
    assert "fiducials" in fault.advice
