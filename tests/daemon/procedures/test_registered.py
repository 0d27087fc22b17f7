"""Looks at a board with CAD layers: the pad's name comes with its place, and what cannot be believed is named."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.board_layers import Painting
from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.registry import PROCEDURES
from daemon.station.board_view import BoardSeen
from daemon.station.station import LookResult
from daemon.storage.calibration_records import Seat
from tests.daemon.procedures.cad_board import cad_board, cad_pad, rectangle
from tests.daemon.procedures.fake_station import Ran, World, pad_seen, registered, run
from vision import TestPoint
from vision.geometry.frames import Rigid2
from vision.registration import NotRegistered, Refusal, Registration, Rival

PAD, OTHER = cad_pad("R1.1", 15_000.0, 12_000.0), cad_pad("R1.2", 17_000.0, 12_000.0)
BOARD = cad_board(PAD, OTHER)
CORRECT = {"op": "correct", "test_point": "R1.1"}
PLACE = {"op": "place", "test_point": "R1.1"}
VERIFIED = Seat(verified=True, places=4, agreement=0.9)


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path, BOARD, {}).teach().with_map()


@pytest.fixture
def settled(world: World) -> World:
    """A station whose head is calibrated and whose board's seat was verified."""
    return world.with_head(world.true_head).with_alignment(world.config.board.pose(), seat=VERIFIED)


async def _run(world: World, request: dict[str, Any] = CORRECT) -> Ran:
    return await run(world, PROCEDURES[request["op"]], request)


async def _fault(world: World, request: dict[str, Any] = CORRECT) -> Fault:
    with pytest.raises(Fault) as caught:
        await _run(world, request)
    return caught.value


def _found(change: Callable[[Registration], Registration | NotRegistered]) -> Callable[[LookResult], LookResult]:
    """Return an edit of what a look registered."""

    def edit(look: LookResult) -> LookResult:
        seen = look.board
        assert isinstance(seen, BoardSeen)
        assert isinstance(seen.found, Registration)
        return replace(look, board=replace(seen, found=change(seen.found)))

    return edit


def _lie(world: World, dx_um: float, dy_um: float) -> None:
    """Let the board lie elsewhere, robot frame."""
    pose = world.true_pose
    world.true_pose = Rigid2(pose.theta_deg, pose.tx_um + dx_um, pose.ty_um + dy_um)


# --- landing ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("miss_um", [(300.0, -200.0), (-450.0, 120.0)])
async def test_a_pad_that_is_not_round_is_landed_on(world: World, miss_um: tuple[float, float]) -> None:
    world.put_beside("R1.1", miss_um, 45.0)
    ran = await _run(world)
    assert ran.got.outcome == "corrected"
    assert math.hypot(*world.miss_um("R1.1")) < 1.0
    assert ran.got.detail["decided_by"] == "registered"
    assert ran.got.detail["target_um"] == list(PAD.place_um)


async def test_the_second_look_follows_the_first(world: World) -> None:
    world.put_beside("R1.1", (200.0, 0.0))
    await _run(world)
    first, second = world.station.searches
    assert first.last is None  # type: ignore[union-attr]
    assert second.last is not None  # type: ignore[union-attr]


# --- refusals -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reason", list(Refusal))
async def test_a_refusal_is_a_fault_of_its_name(world: World, reason: Refusal) -> None:
    world.put_beside("R1.1", (200.0, 0.0))
    world.station.always = _found(lambda found: NotRegistered(reason, "what was seen", found))
    fault = await _fault(world)
    assert fault.kind.wire_name == reason.value
    if reason is not Refusal.FRAME_UNUSABLE:
        assert "R1.1" in fault.message
    assert "what was seen" in fault.message


async def test_of_two_places_that_fit_alike_both_are_named(world: World) -> None:
    world.put_beside("R1.1", (100.0, 0.0))
    rival = Rival((-2000.0, 0.0), (13_000.0, 12_000.0), 2.0)
    world.station.always = _found(
        lambda found: NotRegistered(Refusal.AMBIGUOUS, "two fit", replace(found, rivals=(rival,), shift_um=(0.0, 0.0)))
    )
    fault = await _fault(world)
    assert fault.kind is FaultCode.AMBIGUOUS
    assert "R1.1 may be R1.2" in fault.message
    assert not world.gantry.moves


async def test_a_target_that_is_hidden_is_looked_at_from_both_sides(world: World) -> None:
    world.put_beside("R1.1", (100.0, 0.0))
    hidden = _found(lambda found: NotRegistered(Refusal.TARGET_NOT_CONFIRMED, "hidden", found))
    world.station.script = {1: hidden, 2: hidden}
    ran = await _run(world)
    assert ran.got.outcome == "corrected"
    assert math.hypot(*world.miss_um("R1.1")) < 1.0


async def test_a_round_pad_whose_outline_lies_elsewhere_is_a_disagreement(tmp_path: Path) -> None:
    tp = cad_pad("TP1", 15_000.0, 12_000.0, shape="round", diameter_um=700.0, part=None, kind="site")
    world = World(tmp_path, cad_board(tp), {}).teach().with_map()
    world.put_beside("TP1", (100.0, 0.0))
    px_per_um = world.true_map.scale_px_per_um((800.0, 620.0))

    def beside(look: LookResult, um: float) -> LookResult:
        assert look.board is not None
        assert isinstance(look.board.found, Registration)
        x_px, y_px = look.board.found.target_px
        witness = pad_seen(x_px + um * px_per_um, y_px, 350.0 * px_per_um)
        return replace(look, board=replace(look.board, witness=witness))

    request = CORRECT | {"test_point": "TP1"}
    world.station.always = lambda look: beside(look, 60.0)
    fault = await _fault(world, request)
    assert fault.kind is FaultCode.DISAGREE
    assert fault.detail["apart_um"] == pytest.approx(60.0, abs=3.0)
    world.station.always = lambda look: beside(look, 20.0)
    world.put_beside("TP1", (100.0, 0.0))
    assert (await _run(world, request)).got.outcome == "corrected"


# --- where the board lies -----------------------------------------------------------------------------------------


async def test_a_board_beyond_a_placement_error_is_in_the_wrong_place(world: World) -> None:
    world.put_beside("R1.1", (0.0, 0.0))
    _lie(world, 1500.0, -900.0)
    fault = await _fault(world)
    assert fault.kind is FaultCode.WRONG_PLACE
    assert fault.detail["off_um"] == pytest.approx([1500.0, -900.0], abs=5.0)
    assert not world.gantry.moves


async def test_a_board_that_moved_off_its_verified_seat_voids_the_seat(settled: World) -> None:
    settled.put_beside("R1.1", (50.0, 0.0))
    assert (await _run(settled)).got.outcome == "corrected"
    _lie(settled, -450.0, 0.0)
    moves = len(settled.gantry.moves)
    fault = await _fault(settled)
    assert fault.kind is FaultCode.WRONG_PLACE
    assert "450 um" in fault.message
    assert len(settled.gantry.moves) == moves
    again = await _fault(settled)
    assert again.kind is FaultCode.NOT_ALIGNED
    assert "off its seat" in again.message


async def test_a_head_that_is_not_where_it_counts_itself_is_noticed_at_its_place(settled: World) -> None:
    settled.gantry.scatter_um = lambda: (-450.0, 0.0)
    fault = await _fault(settled, PLACE)
    assert fault.kind is FaultCode.WRONG_PLACE
    assert "lost steps" in fault.message


async def test_a_board_that_moves_between_two_looks_is_no_success(world: World) -> None:
    world.put_beside("R1.1", (300.0, 0.0))

    def move(look: LookResult) -> LookResult:
        _lie(world, 0.0, 500.0)
        return look

    world.station.script = {1: move}
    fault = await _fault(world)
    assert fault.kind is FaultCode.WRONG_PLACE
    assert "a look ago" in fault.message


# --- the seat -----------------------------------------------------------------------------------------------------


async def test_without_a_verified_seat_a_place_that_is_there_twice_is_not_believed(tmp_path: Path) -> None:
    left, right = cad_pad("R1.1", 9_000.0, 15_000.0), cad_pad("R2.1", 29_000.0, 15_000.0)
    world = World(tmp_path, cad_board(left, right, twice=True), {}).teach().with_map()
    world.put_beside("R1.1", (100.0, 0.0))
    fault = await _fault(world)
    assert fault.kind is FaultCode.NOT_ALIGNED
    assert "align" in fault.advice
    assert not world.gantry.moves
    world.with_alignment(world.config.board.pose(), seat=VERIFIED)
    assert (await _run(world)).got.outcome == "corrected"


async def test_an_alignment_without_unique_places_verifies_nothing(tmp_path: Path) -> None:
    left, right = cad_pad("R1.1", 9_000.0, 15_000.0), cad_pad("R2.1", 29_000.0, 15_000.0)
    world = World(tmp_path, cad_board(left, right, twice=True), {}).teach().with_map()
    world.with_alignment(world.config.board.pose(), seat=Seat(verified=False, places=3, agreement=0.9))
    world.put_beside("R1.1", (100.0, 0.0))
    assert (await _fault(world)).kind is FaultCode.NOT_ALIGNED


async def test_a_tie_stays_one_while_the_seat_is_not_verified(world: World) -> None:
    world.put_beside("R1.1", (50.0, 0.0))
    rival = Rival((-2000.0, 0.0), (13_000.0, 12_000.0), 1.0)
    world.station.always = _found(
        lambda found: NotRegistered(Refusal.AMBIGUOUS, "two fit", replace(found, rivals=(rival,)))
    )
    assert (await _fault(world)).kind is FaultCode.AMBIGUOUS


async def test_a_poor_view_is_believed_only_where_a_verified_seat_has_the_target(settled: World) -> None:
    settled.put_beside("R1.1", (50.0, 0.0))
    settled.station.always = _found(lambda found: NotRegistered(Refusal.NOT_THIS_BOARD, "little metal", found))
    assert (await _run(settled)).got.detail["decided_by"] == "registered_at_seat"
    settled.station.always = _found(
        lambda found: NotRegistered(Refusal.NOT_THIS_BOARD, "little metal", replace(found, shift_um=(200.0, 0.0)))
    )
    assert (await _fault(settled)).kind is FaultCode.NOT_THIS_BOARD


def _tie(found: Registration) -> NotRegistered:
    """A tie of the place that was found and of the next pad's."""
    rival = Rival((-2000.0, 0.0), (13_000.0, 12_000.0), 1.0)
    return NotRegistered(Refusal.AMBIGUOUS, "two fit", replace(found, rivals=(rival,)))


def _poor(found: Registration) -> NotRegistered:
    return NotRegistered(Refusal.NOT_THIS_BOARD, "little metal", found)


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a place of a tie be measured anew as it was: the pictures of these looks are empty."""

    def follow(_reference: Any, _red: Any, _to_px: Any, _target: Any, last: Registration, _hidden: Any) -> Registration:
        return last

    monkeypatch.setattr("vision.registration.follow", follow)


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("refused", [_tie, _poor])
async def test_what_the_seat_decides_is_told_kept_and_drawn_as_registered(
    settled: World, refused: Callable[[Registration], NotRegistered]
) -> None:
    settled.put_beside("R1.1", (50.0, 0.0))
    settled.station.always = _found(refused)
    ran = await _run(settled)
    assert ran.got.detail["decided_by"] == "registered_at_seat"
    looks = [body for kind, body in ran.steps if kind == "look"]
    reason = str(refused(registered((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))).reason)
    assert [body["board"].get("refused") for body in looks] == [None] * len(looks)
    assert [body["board"]["seat_decided"] for body in looks] == [reason] * len(looks)
    for kept in (ran.job.first_look, ran.job.last_look):
        assert kept is not None
        assert kept.board is not None
        assert isinstance(kept.board.found, Registration)


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("refused", [_tie, _poor])
async def test_a_board_that_moved_since_the_last_look_is_not_excused_by_the_seat(
    settled: World, refused: Callable[[Registration], NotRegistered]
) -> None:
    _lie(settled, 0.0, -70.0)
    settled.put_beside("R1.1", (100.0, 0.0))
    settled.station.always = _found(refused)

    def move(look: LookResult) -> LookResult:
        _lie(settled, 0.0, 140.0)
        return look

    settled.station.script = {1: move}
    fault = await _fault(settled)
    assert fault.kind is FaultCode.WRONG_PLACE
    assert "a look ago" in fault.message


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("refused", [_tie, _poor])
async def test_a_round_pad_that_the_seat_decided_is_held_to_its_own_outline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[[Registration], NotRegistered]
) -> None:
    tp = cad_pad("TP1", 15_000.0, 12_000.0, shape="round", diameter_um=700.0, part=None, kind="site")
    world = World(tmp_path, cad_board(tp), {}).teach().with_map()
    world.with_head(world.true_head).with_alignment(world.config.board.pose(), seat=VERIFIED)
    world.put_beside("TP1", (100.0, 0.0))
    world.station.always = _found(refused)
    px_per_um = world.true_map.scale_px_per_um((800.0, 620.0))

    def outline(_red: Any, at_px: tuple[float, float], radius_px: float, *_more: Any, **_named: Any) -> TestPoint:
        return pad_seen(at_px[0] + 60.0 * px_per_um, at_px[1], radius_px)

    monkeypatch.setattr("daemon.station.board_view.confirm_pad", outline)
    fault = await _fault(world, CORRECT | {"test_point": "TP1"})
    assert fault.kind is FaultCode.DISAGREE
    assert fault.detail["apart_um"] == pytest.approx(60.0, abs=3.0)


async def test_a_tie_of_two_places_at_the_seat_stays_one(settled: World) -> None:
    settled.put_beside("R1.1", (50.0, 0.0))
    near = Rival((60.0, 0.0), (15_060.0, 12_000.0), 1.0)
    settled.station.always = _found(
        lambda found: NotRegistered(Refusal.AMBIGUOUS, "two fit", replace(found, rivals=(near,)))
    )
    assert (await _fault(settled)).kind is FaultCode.AMBIGUOUS


@pytest.mark.usefixtures("measured")
async def test_a_place_that_the_seat_decided_is_vouched_for_by_the_drives_alone(settled: World) -> None:
    settled.station.always = _found(_tie)
    detail = (await _run(settled, PLACE)).got.detail
    assert detail["confirmed_by"] == "drives"
    assert detail["unconfirmed"]["name"] == "ambiguous"  # type: ignore[index]
    assert "two fit" in detail["unconfirmed"]["message"]  # type: ignore[index]


async def test_a_target_under_solder_is_found_by_its_surroundings(tmp_path: Path) -> None:
    board = cad_board(PAD, OTHER)
    assert board.layers is not None
    top = board.layers.top.model_copy(update={"soldered": Painting(outlines=(rectangle(*PAD.place_um, 2000, 2000),))})
    soldered = board.model_copy(update={"layers": board.layers.model_copy(update={"top": top})})
    world = World(tmp_path, soldered, {}).teach().with_map()
    world.put_beside("R1.1", (200.0, 0.0))
    assert (await _run(world)).got.detail["decided_by"] == "registered_by_surroundings"
    assert all(search.target is None for search in world.station.searches)  # type: ignore[union-attr]
    assert math.hypot(*world.miss_um("R1.1")) < 1.0


@pytest.mark.parametrize("reason", [Refusal.BOARD_TURNED, Refusal.WRONG_SIDE, Refusal.NO_BOARD, Refusal.WRONG_PLACE])
async def test_another_board_in_the_nest_voids_the_seat_and_the_reason_is_kept(settled: World, reason: Refusal) -> None:
    settled.put_beside("R1.1", (50.0, 0.0))
    settled.station.always = _found(lambda _: NotRegistered(reason, "it lies otherwise"))
    assert (await _fault(settled)).kind.wire_name == reason.value
    again = await _fault(settled)
    assert again.kind is FaultCode.NOT_ALIGNED
    assert "it lies otherwise" in again.message


# --- places -------------------------------------------------------------------------------------------------------


async def test_a_place_is_confirmed_by_the_picture(world: World) -> None:
    world.gantry.scatter_um = lambda: (30.0, -40.0)
    ran = await _run(world, PLACE)
    assert ran.got.detail["confirmed_by"] == "picture"
    assert ran.got.detail["away_um"] == pytest.approx(50.0, abs=1.0)


async def test_a_place_that_is_seen_too_far_off_to_touch_from_is_not_confirmed(world: World) -> None:
    limit_um = world.config.servo.first_landing_um
    world.gantry.scatter_um = lambda: (0.0, limit_um + 20.0)
    got = (await _run(world, PLACE)).got
    assert got.detail["confirmed_by"] == "drives"
    assert got.detail["unconfirmed"]["name"] == "not_at_test_point"  # type: ignore[index]
    assert got.detail["away_um"] == pytest.approx(limit_um + 20.0, abs=1.0)
    assert got.beside_um == got.detail["away_um"]
    world.gantry.scatter_um = lambda: (0.0, limit_um - 20.0)
    near = (await _run(world, PLACE)).got
    assert (near.detail["confirmed_by"], near.beside_um) == ("picture", None)


async def test_a_look_says_that_the_point_is_too_far_off_to_touch_it_from_there(world: World) -> None:
    look = {"op": "look", "test_point": "R1.1"}
    limit_um = world.config.servo.first_landing_um
    world.put_beside("R1.1", (limit_um - 20.0, 0.0))
    assert (await _run(world, look)).got.beside_um is None
    world.put_beside("R1.1", (limit_um + 20.0, 0.0))
    assert (await _run(world, look)).got.beside_um == pytest.approx(limit_um + 20.0, abs=1.0)


async def test_a_place_where_the_tip_is_not_seen_is_vouched_for_by_the_drives_and_says_why(world: World) -> None:
    world.station.always = _found(lambda found: NotRegistered(Refusal.AMBIGUOUS, "two fit", found))
    ran = await _run(world, PLACE)
    assert ran.got.detail["confirmed_by"] == "drives"
    assert ran.got.detail["unconfirmed"]["name"] == "ambiguous"  # type: ignore[index]


async def test_a_place_over_a_turned_board_is_a_fault(world: World) -> None:
    world.station.always = _found(lambda found: NotRegistered(Refusal.BOARD_TURNED, "turned by 180 degrees", found))
    assert (await _fault(world, PLACE)).kind is FaultCode.BOARD_TURNED


async def test_before_the_map_is_calibrated_a_place_is_what_the_drives_say(tmp_path: Path) -> None:
    world = World(tmp_path, BOARD, {}).teach()
    ran = await _run(world, PLACE)
    assert ran.got.detail["confirmed_by"] == "drives"
    assert not world.station.searches


async def test_by_a_map_past_its_age_a_place_is_not_confirmed_and_says_why(tmp_path: Path) -> None:
    world = World(tmp_path, BOARD, {}).teach().with_map(made_at=datetime(2020, 1, 1, tzinfo=UTC).isoformat())
    detail = (await _run(world, PLACE)).got.detail
    assert detail["confirmed_by"] == "drives"
    assert detail["unconfirmed"]["name"] == "not_calibrated"  # type: ignore[index]
    assert "days old" in detail["unconfirmed"]["message"]  # type: ignore[index]


async def test_too_little_metal_for_this_station_is_refused_with_both_numbers(tmp_path: Path) -> None:
    small = cad_pad("R1.1", 15_000.0, 12_000.0, 400.0, 200.0)
    world = World(tmp_path, cad_board(small), {"servo": {"landing_um": 90.0}}).teach().with_map()
    fault = await _fault(world, PLACE)
    assert fault.kind is FaultCode.UNKNOWN_TEST_POINT
    assert fault.detail["needed_um"] == 115.0
    assert fault.detail["room_um"] == pytest.approx(100.0, abs=4.0)
