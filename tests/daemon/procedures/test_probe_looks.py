"""What the eye says of a touch, from where it looks, and what a look vouches for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointTest, PointVerdict, Rung
from daemon.domain.states import Event
from daemon.procedures import rungs
from daemon.procedures.point_under_test import PointUnderTest
from daemon.procedures.probe_point import probe_point
from daemon.procedures.registry import PROCEDURES
from daemon.station.needle_health import NeedleHealth
from daemon.station.station import LookResult
from daemon.storage.calibration_records import Seat
from drivers.gantry import Position
from tests.daemon.procedures.fake_probing import (
    INF,
    RADIUS_UM,
    Line,
)
from tests.daemon.procedures.fake_station import BELOW_PX, HOVER_UM, registered, run
from vision import NotFound, Reason
from vision.registration import NotRegistered, Refusal, Registration

BODY_UM = 450.0


async def test_that_no_board_is_seen_is_one_points_verdict_and_at_two_in_a_row_the_end(line: Line) -> None:
    def unseen(look: LookResult) -> LookResult:
        board = look.board
        gone = NotRegistered(Refusal.NO_BOARD, "the red picture is one dark plane", None)
        return look if board is None else replace(look, board=replace(board, found=gone))

    line.world.station.always = unseen
    line.films["A"] = line.films["B"] = (99, INF)
    record = await line.probe("A", job_id="one")
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert "one dark plane" in record.reason
    with pytest.raises(Fault) as caught:
        await line.probe("B", job_id="two")
    assert caught.value.kind is FaultCode.NO_BOARD
    assert line.descents_onto("B") == 1


def _otherwise(look: LookResult) -> LookResult:
    over = NotRegistered(Refusal.WRONG_SIDE, "the board lies with its other side up, turned by 88 degrees", None)
    return look if look.board is None else replace(look, board=replace(look.board, found=over))


@pytest.mark.parametrize("others", [_otherwise, lambda look: replace(look, tip=NotFound(Reason.NO_MARKING, "hidden"))])
async def test_that_the_board_lies_otherwise_one_look_does_not_say(
    line: Line, others: Callable[[LookResult], LookResult]
) -> None:
    """A look from another side says it too, or the next point's; a single one may see little but parts."""
    agree, verified = others is _otherwise, Seat(verified=True, places=4, agreement=0.9)
    line.lay_in("SN-1", verified)

    def seen(look: LookResult) -> LookResult:
        if look.board is None:
            return look
        return _otherwise(look) if abs(look.position.theta_deg % 360.0) < 1.0 else others(look)

    line.world.station.always = seen
    line.films["A"] = line.films["B"] = (99, INF)
    if not agree:
        record = await line.probe("A", job_id="one", theta_deg=0.0)
        assert record.verdict is PointVerdict.CONTACT_NOT_MADE
        assert record.fault == "wrong_side"
        assert line.world.calibrations.alignment(line.world.context.board) is not None
        with pytest.raises(Fault) as caught:
            await line.probe("B", job_id="two", theta_deg=0.0)
    else:
        with pytest.raises(Fault) as caught:
            await line.probe("A", job_id="one")
    assert caught.value.kind is FaultCode.WRONG_SIDE
    assert line.world.calibrations.alignment(line.world.context.board) is None, "it is aligned before it goes on"


def _poorly(look: LookResult) -> LookResult:
    poor = NotRegistered(Refusal.NOT_THIS_BOARD, "0.41 of it agrees at best", None)
    return look if look.board is None else replace(look, board=replace(look.board, found=poor))


@pytest.mark.parametrize("at_0_deg", [_otherwise, _poorly])
async def test_two_sides_that_show_the_board_to_lie_otherwise_are_enough_whatever_other_sides_show(
    line: Line, at_0_deg: Callable[[LookResult], LookResult]
) -> None:
    line.lay_in("SN-1", Seat(verified=True, places=4, agreement=0.9))
    views: dict[int, Callable[[LookResult], LookResult]] = {
        0: at_0_deg, 180: _otherwise, 90: _otherwise, 270: lambda same: same
    }  # fmt: skip
    line.world.station.always = lambda look: views[round(look.position.theta_deg) % 360](look)
    line.films["A"] = (99, INF)
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.WRONG_SIDE
    assert line.descents_onto("A") == 1
    assert line.world.calibrations.alignment(line.world.context.board) is None


async def test_one_side_that_says_twice_what_another_has_contradicted_is_one(line: Line) -> None:
    line.lay_in("SN-1", Seat(verified=True, places=4, agreement=0.9))
    health = NeedleHealth()

    def seen(look: LookResult) -> LookResult:
        if abs(look.position.theta_deg % 360.0) < 1.0:
            return _otherwise(look)
        return _poorly(look) if health.checks else look  # after the reference pad the head begins at 0 degrees again

    line.world.station.always = seen
    line.films["A"] = (99, INF)
    ran = line.begin("A")
    ran.job.fire(Event.ACCEPTED)
    record = await probe_point(
        ran.job, line.world.context, PointTest(point="A"), None, run="run-1", health=health, at_deg=0.0
    )
    assert health.checks
    assert record.fault == "wrong_side"
    assert line.world.calibrations.alignment(line.world.context.board) is not None


async def test_what_cannot_be_seen_from_one_side_is_looked_at_from_another(line: Line) -> None:
    def poor(look: LookResult) -> LookResult:
        board = look.board
        poorly = NotRegistered(Refusal.NOT_THIS_BOARD, "0.41 of it agrees at best", None)
        from_here = abs(look.position.theta_deg) < 1.0
        return look if board is None or not from_here else replace(look, board=replace(board, found=poorly))

    line.world.station.always = poor
    line.films["A"] = (2, INF)
    record = await line.probe("A")
    assert record.verdict is PointVerdict.PASS_RECOVERED
    turned = line.world.gantry.reported.theta_deg % 360.0
    assert turned == pytest.approx(180.0)
    line.world.station.always = lambda look: look


async def test_a_picture_that_mostly_agrees_is_looked_at_from_a_step_aside(line: Line) -> None:
    refused: list[Position] = []

    def hidden(look: LookResult) -> LookResult:
        board = look.board
        if board is None or (refused and look.position != refused[0]):
            return look
        refused.append(look.position)
        best = registered((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), agreement=0.8)
        found = NotRegistered(Refusal.NOT_THIS_BOARD, "0.88 of its metal is seen (0.91 needed)", best)
        return replace(look, board=replace(board, found=found))

    line.world.station.always = hidden
    line.misses_um = [(RADIUS_UM + 100.0, 0.0)]
    record = await line.probe("A", theta_deg=0.0)
    assert record.verdict is PointVerdict.PASS_RECOVERED
    assert refused


@pytest.mark.parametrize(("agreement", "believed"), [(0.8, True), (0.7, False)])
async def test_a_poor_view_of_a_way_astray_counts_at_a_verified_seat_where_enough_of_the_board_is_seen(
    line: Line, agreement: float, believed: bool
) -> None:
    """Where not enough is seen, a look from a step aside says where the pad is."""

    def poor(look: LookResult) -> LookResult:
        board = look.board
        if board is None or not isinstance(board.found, Registration):
            return look
        best = replace(board.found, agreement=agreement, metal_seen=0.88)
        found = NotRegistered(Refusal.NOT_THIS_BOARD, "0.88 of its metal is seen (0.91 needed)", best)
        return replace(look, board=replace(board, found=found))

    line.world.with_head(line.world.true_head)
    line.lay_in("SN-1", Seat(verified=True, places=4, agreement=0.9))
    line.world.station.always = poor
    line.misses_um = [(RADIUS_UM + 100.0, 0.0)]
    record = await line.probe("A", theta_deg=0.0)
    assert record.verdict is PointVerdict.PASS_RECOVERED
    assert record.error_um == pytest.approx(RADIUS_UM + 100.0 if believed else 0.0, abs=20.0)


async def test_what_names_no_net_is_touched_only_after_a_look(line: Line) -> None:
    line.misses_um = [(RADIUS_UM + 100.0, 0.0)]
    record = await line.probe("A", method="contact")
    assert record.verdict is PointVerdict.PASS_FIRST
    assert record.looks
    assert record.error_um == pytest.approx(RADIUS_UM + 100.0, abs=20.0)


async def test_an_angle_that_the_test_wants_is_kept_whatever_is_seen_from_it(line: Line) -> None:
    def poor(look: LookResult) -> LookResult:
        poorly = NotRegistered(Refusal.NOT_THIS_BOARD, "0.41 of it agrees at best", None)
        return look if look.board is None else replace(look, board=replace(look.board, found=poorly))

    line.world.station.always = poor
    line.films["A"] = (2, INF)
    record = await line.probe("A", theta_deg=0.0)
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE
    assert all(target.theta_deg == 0.0 for target, _ in line.world.gantry.moves)


async def test_a_point_that_was_recovered_has_the_pictures_of_the_miss_and_of_the_end(line: Line) -> None:
    line.misses_um = [(RADIUS_UM + 100.0, 0.0)]
    await line.probe("B")
    ((first, last),) = line.looks
    assert first is not None
    assert last is not None
    assert first.board is not None, "it shows the board, and so where the tip was"
    assert first.position.x_um != last.position.x_um


async def test_a_correction_that_was_begun_again_vouches_for_no_press_before_it(line: Line) -> None:
    """It begins where the first one gave up, near the pad: that says nothing of where the needle was pressed."""
    line.open_nets.add("NB")
    line.misses_um = [(RADIUS_UM + 100.0, 0.0), (RADIUS_UM - 50.0, 0.0), (RADIUS_UM - 50.0, 0.0)]
    line.without(servo=line.world.context.servo.model_copy(update={"max_moves": 1}))
    seen: list[bool] = []

    async def watched(rung: Rung, at: PointUnderTest) -> None:
        await take(rung, at)
        seen.append(at.attempts[0].seen)

    take = rungs.take
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daemon.procedures.probe_point.take", watched)
        await run(line.world, PROCEDURES["probe"], {}, line.begin("B"))
    assert seen
    assert not any(seen)
    assert line.told[-1].error_um is None


def _put_part(line: Line, beside: str, *, from_um: float = RADIUS_UM + 20.0) -> None:
    """Have a part stand beside a pad, on its right, higher than the needle hovers."""
    board_um, (x_um, y_um) = line.world.height_um, line.world.pad_um(beside)

    def height_um(at_x_um: float, at_y_um: float) -> float:
        on_it = from_um < at_x_um - x_um < 1_500.0 and abs(at_y_um - y_um) < 500.0
        return board_um(at_x_um, at_y_um) + (BODY_UM if on_it else 0.0)

    line.world.height_um = height_um


def _raise_board(line: Line, by_um: float) -> None:
    board_um = line.world.height_um
    line.world.height_um = lambda x_um, y_um: board_um(x_um, y_um) + by_um


async def test_a_way_that_ended_on_a_part_is_seen_from_above_and_the_needle_brought_onto_the_pad(line: Line) -> None:
    _put_part(line, "A")
    line.misses_um = [(RADIUS_UM + 150.0, 0.0)]
    record = await line.probe("A")
    assert record.verdict is PointVerdict.PASS_FIRST
    assert record.presses == 1, "the part was not pressed"
    assert record.error_um == pytest.approx(RADIUS_UM + 150.0, abs=20.0)


async def test_a_step_that_ended_on_a_part_is_taken_again(line: Line) -> None:
    _put_part(line, "A")
    line.misses_um = [(-RADIUS_UM - 10.0, 0.0), (130.0, 0.0)]
    record = await line.probe("A")
    assert record.verdict is PointVerdict.PASS_RECOVERED
    assert record.presses == 2


async def test_a_board_that_lies_too_high_is_no_part_beside_the_pad(line: Line) -> None:
    _raise_board(line, BODY_UM)
    line.misses_um = [(60.0, 0.0)]
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.WRONG_HEIGHT
    assert line.descents_onto("A") == 0
    assert len({(move.x_um, move.y_um) for move, _ in line.world.gantry.moves}) == 1, "it went nowhere else"


async def test_a_board_that_lies_too_high_below_the_pad_too_is_told_once_the_needle_is_over_it(line: Line) -> None:
    _raise_board(line, BODY_UM)
    line.misses_um = [(RADIUS_UM + 150.0, 0.0)]
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.WRONG_HEIGHT
    assert line.descents_onto("A") == 0


async def test_where_nothing_tells_whether_a_part_stands_there_it_is_the_board(line: Line) -> None:
    def unseen(look: LookResult) -> LookResult:
        gone = NotRegistered(Refusal.NO_BOARD, "the red picture is one dark plane", None)
        return look if look.board is None else replace(look, board=replace(look.board, found=gone))

    _put_part(line, "A")
    line.world.station.always = unseen
    line.misses_um = [(RADIUS_UM + 150.0, 0.0)]
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert caught.value.kind is FaultCode.WRONG_HEIGHT


@pytest.mark.parametrize("theta_deg", [None, 0.0])
async def test_a_tip_that_no_picture_shows_from_one_side_is_looked_at_from_another(
    line: Line, theta_deg: float | None
) -> None:
    def hidden(look: LookResult) -> LookResult:
        if look.position.theta_deg % 360.0 > 1.0:
            return look
        return replace(look, tip=NotFound(Reason.NO_MARKING, "the taper shows on only 23 % of its length"))

    line.world.station.always = hidden
    record = await line.probe("A", **({} if theta_deg is None else {"theta_deg": theta_deg}))
    if theta_deg is None:
        assert record.verdict is PointVerdict.PASS_FIRST
        assert line.world.gantry.reported.theta_deg % 360.0 == pytest.approx(180.0)
    else:
        assert record.verdict is PointVerdict.NOT_TESTED
        assert "23 %" in record.reason
    line.world.station.always = lambda look: look


async def test_a_pad_that_has_to_be_seen_is_not_pressed_from_a_side_from_which_it_was_not(line: Line) -> None:
    world, looks = line.world, list[LookResult]()
    world.gantry.off_um = (1.0, 0.0, 0.0)  # so that the needle is looked at once more before it goes down
    flexed = (-70.0 / HOVER_UM * BELOW_PX[0], -70.0 / HOVER_UM * BELOW_PX[1])
    world.flex_px = lambda: flexed if len(looks) < 3 else (0.0, 0.0)

    def hidden(look: LookResult) -> LookResult:
        at, late = look.position, len(looks) >= 3
        looks.append(look)
        if late and abs(at.theta_deg % 360.0) < 1.0 and at.z_um < world.context.gantry.free_z_um - 5.0:
            return replace(look, tip=NotFound(Reason.NO_MARKING, "the taper shows on only 23 % of its length"))
        return look

    world.station.always = hidden
    record = await line.probe("A", method="contact")
    assert len(looks) > 3
    assert record.verdict is PointVerdict.NOT_TESTED
    assert line.descents_onto("A") == 0


async def test_lost_steps_that_are_found_above_what_the_needle_stood_on_are_told_as_such(line: Line) -> None:
    _put_part(line, "A")
    gantry, sunk = line.world.gantry, list[float]()

    def sinks(look: LookResult) -> LookResult:
        if not sunk and look.board is None and look.position.z_um >= line.world.context.gantry.free_z_um - 1.0:
            sunk.append(5_000.0 + BODY_UM - 70.0)
            gantry.actual = replace(gantry.actual, z_um=sunk[0])
        return look

    line.world.station.always = sinks
    line.misses_um = [(RADIUS_UM + 150.0, 0.0)]
    with pytest.raises(Fault) as caught:
        await line.probe("A")
    assert sunk
    assert caught.value.kind is FaultCode.AXIS_STALLED


async def test_a_way_back_after_which_nobody_looked_is_followed_by_one_straight_up(line: Line) -> None:
    board = line.world.station.needle.board

    def hidden(look: LookResult) -> LookResult:
        board.seen_free()
        board.recognised()
        unclear = NotRegistered(Refusal.TARGET_NOT_CONFIRMED, "something stands before it", None)
        side = round(look.position.theta_deg) % 360
        return look if look.board is None or side else replace(look, board=replace(look.board, found=unclear))

    line.world.station.always = hidden
    record = await line.probe("A", method="contact")
    assert record.verdict is PointVerdict.PASS_FIRST
    moves = line.world.gantry.moves
    turned = next(n for n, (target, _) in enumerate(moves) if round(target.theta_deg) % 360)
    assert turned > 2, "it had stepped aside, and back"
    assert line.trusted_at_move[turned] is False
