"""One look is turned into the way to the pad that is meant, or into a fault that says why not; nothing is guessed."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.aiming import (
    STILL_UM,
    Aim,
    Prior,
    known_beforehand,
    look_and_aim,
    lookalikes,
    refuse_unusable,
    require_tip,
)
from daemon.procedures.look_numbers import describe
from daemon.procedures.registry import PROCEDURES
from daemon.station.station import LookResult, Search
from tests.daemon.procedures.fake_station import (
    BELOW_PX,
    NEEDLE_RAD,
    SHAPE,
    TIP_PX,
    Ran,
    World,
    a_board,
    begin,
    doubtful_object,
    found_tip,
    missing,
    pose_map,
    run,
)
from vision import NotFound, Reason, Seen
from vision.geometry.frames import Rigid2
from vision.pads.rules import Verdict

REQUEST = {"op": "correct", "test_point": "A"}
BOARD = a_board(("A", 10_000.0, 5_000.0), ("B", 10_600.0, 5_100.0), ("C", 9_700.0, 5_500.0))
LONELY = a_board(("A", 10_000.0, 5_000.0), ("Z", 20_000.0, 9_000.0))


def _world(folder: Path, board: Board = BOARD, **servo: Any) -> World:
    return World(folder, board, {"servo": servo}).teach().with_map()


@pytest.fixture
def world(tmp_path: Path) -> World:
    return _world(tmp_path)


@pytest.fixture
def lonely(tmp_path: Path) -> World:
    return _world(tmp_path, LONELY)


async def _aim(world: World, prior: Prior | None = None, ran: Ran | None = None, name: str = "A") -> Aim:
    ran = ran or begin(REQUEST)
    try:
        return await look_and_aim(
            ran.job, world.context, world.gantry.reported, world.board.find(name), world.context.require_map(), prior
        )
    finally:
        await ran.job.settle()


async def _fault(world: World, prior: Prior | None = None, ran: Ran | None = None) -> Fault:
    with pytest.raises(Fault) as caught:
        await _aim(world, prior, ran)
    return caught.value


def _shifted(world: World, dx_um: float, dy_um: float) -> None:
    """Let the board lie so far off its nominal place, with the tip nominally over A."""
    nominal = world.config.board.pose()
    world.true_pose = Rigid2(0.0, nominal.tx_um + dx_um, nominal.ty_um + dy_um)
    world.put_tip(nominal.apply(world.board.find("A").place_um))


# --- the numbers of an aim ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta_deg", [0.0, 30.0, 250.0])
async def test_an_aim_is_the_true_way_from_tip_to_pad(world: World, theta_deg: float) -> None:
    world.put_beside("A", (150.0, -80.0), theta_deg)
    aim = await _aim(world)
    assert (aim.correction.dx_um, aim.correction.dy_um) == pytest.approx((150.0, -80.0), abs=0.01)
    assert aim.error_um == pytest.approx(170.0, abs=0.01)
    here = world.gantry.reported
    assert aim.place_um == pytest.approx((here.x_um + 150.0, here.y_um - 80.0), abs=0.01)
    assert aim.shift_um == pytest.approx((0.0, 0.0), abs=0.01)


async def test_the_shift_is_how_far_the_pad_lies_from_its_nominal_place(world: World) -> None:
    _shifted(world, 200.0, -120.0)
    aim = await _aim(world)
    assert aim.shift_um == pytest.approx((200.0, -120.0), abs=0.01)
    assert aim.error_um == pytest.approx(math.hypot(200.0, 120.0), abs=0.01)


async def test_the_search_is_as_wide_as_placement_and_tolerance_and_of_cads_size(world: World) -> None:
    world.put_beside("A", (0.0, 0.0))
    await _aim(world)
    (search,) = world.station.searches
    scale = world.true_map.scale_px_per_um(TIP_PX)
    assert isinstance(search, Search)
    assert search.offset_px == pytest.approx(BELOW_PX)
    assert search.reach_px == pytest.approx((700.0 + 120.0) * scale)
    assert search.expected_radius_px == pytest.approx(250.0 * scale)


async def test_on_a_higher_surface_the_place_below_the_tip_is_nearer_to_it(world: World) -> None:
    world.with_surface(raised_um=30.0)
    surface = world.calibrations.surface
    assert surface is not None
    world.height_um = surface.height_um
    world.put_beside("A", (100.0, 50.0))
    aim = await _aim(world)
    (search,) = world.station.searches
    height_um = surface.height_um(*world.tip_um())
    assert abs(height_um) > 5.0
    assert isinstance(search, Search)
    assert search.offset_px == pytest.approx([v * (1 - height_um / 200.0) for v in BELOW_PX])
    assert (aim.correction.dx_um, aim.correction.dy_um) == pytest.approx((100.0, 50.0), abs=0.6)


async def test_how_well_it_is_known_grows_with_the_tips_and_the_pads_uncertainty(world: World) -> None:
    world.put_beside("A", (100.0, 0.0))
    sharp = (await _aim(world)).correction.sigma_um

    def blurred(look: LookResult) -> LookResult:
        assert look.tip
        return replace(look, tip=replace(look.tip, sigma_px=0.8))

    world.station.always = blurred
    wide = (await _aim(world)).correction.sigma_um
    assert wide / sharp == pytest.approx(math.hypot(0.8, 0.1) / math.hypot(0.1, 0.1), rel=0.01)


async def test_every_look_is_journalled_with_what_it_found(world: World) -> None:
    world.put_beside("A", (100.0, 0.0))
    ran = begin(REQUEST)
    aim = await _aim(world, ran=ran)
    assert ran.steps == [("look", describe(aim.look, aim.target, aim.correction))]
    assert (ran.job.looks, ran.job.last_look) == (1, aim.look)


# --- what is known before -----------------------------------------------------------------------------------------


def test_only_a_station_whose_head_and_board_are_calibrated_knows_something_beforehand(world: World) -> None:
    assert known_beforehand(world.context) is None
    world.with_alignment(world.config.board.pose())
    assert known_beforehand(world.context) is None
    world.with_head(world.config.head.model())
    assert known_beforehand(world.context) == Prior((0.0, 0.0), 120.0, firm=False)


def test_a_calibrated_head_alone_is_not_enough(world: World) -> None:
    world.with_head(world.config.head.model())
    assert known_beforehand(world.context) is None


# --- looking again ------------------------------------------------------------------------------------------------


def _hidden(look: LookResult) -> LookResult:
    return replace(look, seen=Seen(missing(), (), (), (), (0, 0, 10, 10)))


def _no_tip(reason: Reason = Reason.NO_NEEDLE) -> Any:
    return lambda look: replace(look, tip=NotFound(reason, "as scripted"), seen=None)


@pytest.mark.parametrize("bad", [_hidden, _no_tip()])
@pytest.mark.parametrize("count", [1, 2])
async def test_what_is_unclear_is_looked_at_again_twice(world: World, bad: Any, count: int) -> None:
    world.put_beside("A", (100.0, 0.0))
    world.station.script = dict.fromkeys(range(1, count + 1), bad)
    ran = begin(REQUEST)
    assert (await _aim(world, ran=ran)).error_um == pytest.approx(100.0, abs=0.01)
    assert ran.job.looks == count + 1
    assert len(ran.steps) == count + 1
    assert "dx_um" not in ran.steps[0][1]


@pytest.mark.parametrize(("bad", "kind"), [(_hidden, "TEST_POINT_NOT_FOUND"), (_no_tip(), "TIP_NOT_FOUND")])
async def test_three_unclear_looks_are_a_fault(world: World, bad: Any, kind: str) -> None:
    world.put_beside("A", (100.0, 0.0))
    world.station.always = bad
    ran = begin(REQUEST)
    assert (await _fault(world, ran=ran)).kind is FaultCode[kind]
    assert (ran.job.looks, world.gantry.moves) == (3, [])


@pytest.mark.parametrize("reason", [Reason.TOO_DARK, Reason.SATURATED, Reason.BLURRED, Reason.OUT_OF_FRAME])
async def test_a_frame_that_is_no_good_is_not_looked_at_again(world: World, reason: Reason) -> None:
    world.put_beside("A", (100.0, 0.0))
    ran = begin(REQUEST)
    world.station.always = _no_tip(reason)
    fault = await _fault(world, ran=ran)
    assert (fault.kind, fault.detail["reason"]) == (FaultCode.FRAME_UNUSABLE, reason.value)
    assert (fault.detail["lamp"], "white light" in fault.message) == ("white", True)
    assert ("white ring" in fault.advice) == (reason is Reason.TOO_DARK)
    assert ran.job.looks == 1

    def bad_red(look: LookResult) -> LookResult:
        return replace(look, seen=Seen(missing(reason), (), (), (), (0, 0, 10, 10)))

    world.station.always = bad_red
    red = await _fault(world)
    assert (red.kind, red.detail["lamp"], "red light" in red.message) == (FaultCode.FRAME_UNUSABLE, "red", True)
    assert ("red ring" in red.advice) == (reason is Reason.TOO_DARK)


@pytest.mark.parametrize(
    "reason", [r for r in Reason if r not in {Reason.TOO_DARK, Reason.SATURATED, Reason.BLURRED, Reason.OUT_OF_FRAME}]
)
def test_any_other_reason_leaves_the_frame_usable(reason: Reason) -> None:
    refuse_unusable(missing(reason), "white")


async def test_a_red_frame_that_was_not_searched_is_said(world: World) -> None:
    world.put_beside("A", (0.0, 0.0))
    world.station.always = lambda look: replace(look, seen=None)
    fault = await _fault(world)
    assert (fault.kind, fault.message) == (
        FaultCode.TEST_POINT_NOT_FOUND,
        "the pad was not looked for in the red picture",
    )


async def test_a_tip_is_required(world: World) -> None:
    look = await world.station.look(world.gantry.reported, None, Search((0.0, 0.0), 50.0, None), begin(REQUEST).job)
    with pytest.raises(Fault) as untaught:
        require_tip(look)
    assert untaught.value.kind is FaultCode.NOT_CALIBRATED
    tip = found_tip(*TIP_PX)
    assert require_tip(replace(look, tip=tip)) is tip
    with pytest.raises(Fault) as lost:
        require_tip(replace(look, tip=missing(Reason.BENT)))
    assert (lost.value.kind, lost.value.detail["reason"]) == (FaultCode.TIP_NOT_FOUND, "bent")


# --- which pad is meant: by its neighbours ------------------------------------------------------------------------


async def test_the_neighbours_tell_which_pad_is_meant_where_another_is_nearer(world: World) -> None:
    """Shifted by 600 um, B lies where A was expected; all three together are explained by one shift only."""
    _shifted(world, -520.0, -90.0)
    assert math.hypot(*world.miss_um("B")) < math.hypot(*world.miss_um("A"))
    aim = await _aim(world)
    assert aim.shift_um == pytest.approx((-520.0, -90.0), abs=0.05)


@pytest.mark.parametrize(("shift_um", "good"), [(695.0, True), (705.0, False)])
async def test_a_pad_farther_than_the_largest_placement_error_is_not_meant(
    lonely: World, shift_um: float, good: bool
) -> None:
    _shifted(lonely, shift_um, 0.0)
    if good:
        assert (await _aim(lonely)).shift_um == pytest.approx((shift_um, 0.0), abs=0.1)
        return
    fault = await _fault(lonely)
    assert fault.kind is FaultCode.TEST_POINT_NOT_FOUND
    assert "in view are 1 pad of its size and no doubtful objects" in fault.message
    assert fault.detail["candidates_um"] == [[pytest.approx(705.0, abs=0.1), pytest.approx(0.0, abs=0.1)]]


@pytest.mark.parametrize(("off_um", "good"), [(115.0, True), (125.0, False)])
async def test_neighbours_agree_within_the_tolerance(world: World, off_um: float, good: bool) -> None:
    """A with one neighbour `off_um` from where CAD has it: within the tolerance it speaks for A, else against it."""
    world.put_beside("A", (0.0, 0.0))
    b = world.board.find("B")
    world.hidden = {"B", "C"}
    world.strays_um = [(b.x_um + off_um, b.y_um, 500.0)]
    if good:
        assert (await _aim(world)).error_um < 0.1
    else:
        assert (await _fault(world)).kind is FaultCode.AMBIGUOUS


async def test_a_pad_that_should_be_in_view_and_is_not_speaks_against(world: World) -> None:
    world.put_beside("A", (0.0, 0.0))
    world.hidden = {"B"}
    fault = await _fault(world)
    assert fault.kind is FaultCode.AMBIGUOUS
    assert fault.detail["match"] == "contradicted"
    assert "may be another one, or turned; in view are 2 pads" in fault.message
    assert len(fault.detail["candidates_um"]) == 2


async def test_a_pad_behind_the_needle_need_not_be_seen(tmp_path: Path) -> None:
    """The needle comes from the upper left in the image: what lies along it is hidden, what lies across is not."""
    along = _world(tmp_path / "a", a_board(("A", 10_000.0, 5_000.0), ("N", *_beside_px(-50.0, 0.0)), diameter_um=100.0))
    across = _world(tmp_path / "b", a_board(("A", 10_000.0, 5_000.0), ("N", *_beside_px(0.0, 45.0)), diameter_um=100.0))
    for world in (along, across):
        world.put_beside("A", (0.0, 0.0))
        world.hidden = {"N"}
    assert (await _aim(along)).error_um < 0.1
    assert (await _fault(across)).kind is FaultCode.AMBIGUOUS


def _beside_px(along_px: float, across_px: float) -> tuple[float, float]:
    """Return the board place that appears so far from the place below the tip, when the tip is on A."""
    c, s = math.cos(NEEDLE_RAD), math.sin(NEEDLE_RAD)
    px = TIP_PX[0] + along_px * c - across_px * s, TIP_PX[1] + along_px * s + across_px * c
    x_um, y_um = pose_map().from_tip_um(px, TIP_PX, 0.0)
    return 10_000.0 + float(x_um), 5_000.0 + float(y_um)


async def test_a_doubtful_object_where_a_neighbour_is_expected_may_be_that_neighbour(world: World) -> None:
    world.put_beside("A", (0.0, 0.0))
    c = world.board.find("C")
    world.hidden = {"C"}
    world.doubtful_um = [(c.x_um, c.y_um, 500.0)]
    assert (await _aim(world)).error_um < 0.1


async def test_a_doubtful_target_is_undecided(world: World) -> None:
    world.put_beside("A", (50.0, 0.0))
    a = world.board.find("A")
    world.hidden = {"A"}
    world.doubtful_um = [(a.x_um, a.y_um, 500.0)]
    fault = await _fault(world)
    assert fault.kind is FaultCode.UNDECIDED
    assert "2 pads of its size and 1 doubtful object" in fault.message
    assert fault.detail["candidates_um"] == [[pytest.approx(50.0, abs=0.1), pytest.approx(0.0, abs=0.1)]]


async def test_two_pads_that_could_both_be_it_are_ambiguous(lonely: World) -> None:
    lonely.put_beside("A", (0.0, 0.0))
    lonely.strays_um = [(10_300.0, 5_000.0, 500.0)]
    fault = await _fault(lonely)
    assert fault.kind is FaultCode.AMBIGUOUS
    assert fault.detail["match"] in ("contradicted", "ambiguous")


async def test_what_was_thrown_is_named_by_its_rule_but_not_without_end(lonely: World) -> None:
    lonely.put_beside("A", (0.0, 0.0))
    thrown = tuple(replace(doubtful_object(0.0, 0.0, 5.0, "oval"), verdict=Verdict.THROW) for _ in range(25))
    lonely.station.always = lambda look: replace(look, seen=Seen(missing(), (), thrown, (), (0, 0, 10, 10)))
    assert (await _fault(lonely)).detail["thrown"] == ["oval"] * 20


# --- which pad is meant: by its known place -----------------------------------------------------------------------


NEAR = Prior((0.0, 0.0), 120.0)


async def test_a_pad_at_its_known_place_is_taken_where_the_neighbours_speak_against_it(lonely: World) -> None:
    lonely.put_beside("A", (30.0, 0.0))
    lonely.strays_um = [(10_300.0, 5_000.0, 500.0)]
    assert (await _fault(lonely)).kind is FaultCode.AMBIGUOUS
    assert (await _aim(lonely, NEAR)).error_um == pytest.approx(30.0, abs=0.1)


@pytest.mark.parametrize(("off_um", "found"), [(118.0, True), (122.0, False)])
async def test_the_known_place_is_as_wide_as_it_is_trusted(lonely: World, off_um: float, found: bool) -> None:
    """Two pads, neither explained by CAD: the one within the trusted distance of the known place is taken."""
    _shifted(lonely, off_um, 0.0)
    lonely.strays_um = [(10_400.0, 5_000.0, 500.0)]
    if found:
        assert (await _aim(lonely, NEAR)).shift_um == pytest.approx((off_um, 0.0), abs=0.1)
    else:
        assert (await _fault(lonely, NEAR)).kind is FaultCode.AMBIGUOUS


async def test_a_known_shift_moves_the_place_where_the_pad_is_expected(lonely: World) -> None:
    _shifted(lonely, 300.0, 200.0)
    lonely.strays_um = [(9_700.0, 4_800.0, 500.0)]
    assert (await _aim(lonely, Prior((300.0, 200.0), 45.0, firm=True))).shift_um == pytest.approx(
        (300.0, 200.0), abs=0.1
    )
    assert (await _aim(lonely, NEAR)).shift_um == pytest.approx((0.0, 0.0), abs=0.1), "the stray lies there"


async def test_neighbours_that_call_for_a_far_pad_are_overruled_by_one_thing_at_the_known_place(lonely: World) -> None:
    """A pad 400 um off is all that was taken; a doubtful one lies where the target is known to be."""
    _shifted(lonely, 400.0, 0.0)
    lonely.doubtful_um = [(9_600.0, 5_000.0, 500.0)]
    far = await _aim(lonely)
    assert far.shift_um == pytest.approx((400.0, 0.0), abs=0.1)
    near = await _aim(lonely, NEAR)
    assert near.shift_um == pytest.approx((0.0, 0.0), abs=0.1)
    assert near.target.rule == "at_known_place"


@pytest.mark.parametrize(("off_um", "rule"), [(119.0, "site_filled"), (121.0, "at_known_place")])
async def test_neighbours_are_believed_as_far_as_the_place_is_trusted(lonely: World, off_um: float, rule: str) -> None:
    """The pad that CAD calls for is `off_um` from the known place, a doubtful thing lies nearer to it."""
    _shifted(lonely, off_um, 0.0)
    lonely.doubtful_um = [(10_000.0 - off_um - 30.0, 5_000.0, 500.0)]
    assert (await _aim(lonely, NEAR)).target.rule == rule


async def test_a_pad_its_neighbour_confirms_is_taken_though_something_doubtful_lies_beside_it(tmp_path: Path) -> None:
    """B lies 110 um to the right: within the tolerance seen from the pad, not from the thing 30 um left of it."""
    world = _world(tmp_path, a_board(("A", 10_000.0, 5_000.0), ("B", 10_500.0, 5_100.0)))
    world.put_beside("A", (10.0, 0.0))
    world.hidden = {"B"}
    world.strays_um = [(10_610.0, 5_100.0, 500.0)]
    world.doubtful_um = [(9_970.0, 5_000.0, 500.0)]
    assert (await _aim(world, Prior((0.0, 0.0), STILL_UM, firm=True))).error_um == pytest.approx(10.0, abs=0.05)


async def test_a_far_pad_is_taken_where_nothing_lies_at_the_known_place_and_that_is_not_firm(lonely: World) -> None:
    _shifted(lonely, 400.0, 0.0)
    assert (await _aim(lonely, NEAR)).shift_um == pytest.approx((400.0, 0.0), abs=0.1)
    fault = await _fault(lonely, Prior((0.0, 0.0), STILL_UM, firm=True))
    assert fault.kind is FaultCode.AMBIGUOUS
    assert fault.message == "A: what is seen now is not what was seen before"


async def test_a_firm_place_takes_what_goes_on_like_a_stroke_too(lonely: World) -> None:
    lonely.put_beside("A", (0.0, 0.0))

    def thrown(look: LookResult) -> LookResult:
        x_px, y_px = TIP_PX[0] + BELOW_PX[0], TIP_PX[1] + BELOW_PX[1]
        radius_px = 250.0 * lonely.true_map.scale_px_per_um(TIP_PX)
        stroke = replace(doubtful_object(x_px, y_px, radius_px, "stroke_end"), verdict=Verdict.THROW)
        return replace(look, seen=Seen(missing(), (), (stroke,), (), (0, 0, 10, 10)))

    lonely.station.always = thrown
    assert (await _aim(lonely, Prior((0.0, 0.0), STILL_UM, firm=True))).error_um < 0.1
    assert (await _fault(lonely, NEAR)).kind is FaultCode.TEST_POINT_NOT_FOUND


async def test_a_doubtful_thing_of_another_size_is_not_the_pad(lonely: World) -> None:
    lonely.put_beside("A", (0.0, 0.0))
    lonely.hidden = {"A"}
    lonely.doubtful_um = [(10_000.0, 5_000.0, 500.0)]
    assert (await _aim(lonely, NEAR)).error_um < 0.1
    lonely.doubtful_um = [(10_000.0, 5_000.0, 620.0)]
    assert (await _fault(lonely, NEAR)).kind is FaultCode.UNDECIDED


# --- what CAD expects ---------------------------------------------------------------------------------------------


def test_lookalikes_are_cads_pads_of_that_size_from_the_tip_the_target_first(tmp_path: Path) -> None:
    board = a_board(("B", 10_600.0, 5_100.0), ("A", 10_000.0, 5_000.0), ("far", 12_500.0, 5_000.0))
    big = board.points[0].model_copy(update={"name": "big", "diameter_um": 900.0, "y_um": 6_000.0})
    world = _world(tmp_path, board.model_copy(update={"points": (*board.points, big)}))
    world.put_beside("A", (40.0, -30.0))
    found = lookalikes(world.board.find("A"), world.gantry.reported, world.context)
    assert found.tolist() == [
        [pytest.approx(40.0), pytest.approx(-30.0)],
        [pytest.approx(640.0), pytest.approx(70.0)],
    ]


@pytest.mark.parametrize(("away_um", "count"), [(3 * 820.0 - 1.0, 2), (3 * 820.0 + 1.0, 1)])
def test_lookalikes_reach_three_times_as_far_as_a_search(tmp_path: Path, away_um: float, count: int) -> None:
    world = _world(tmp_path, a_board(("A", 10_000.0, 5_000.0), ("B", 10_000.0 + away_um, 5_000.0)))
    world.put_beside("A", (0.0, 0.0))
    assert len(lookalikes(world.board.find("A"), world.gantry.reported, world.context)) == count


# --- the journal --------------------------------------------------------------------------------------------------


async def test_a_look_is_described_by_its_numbers(world: World) -> None:
    world.put_beside("A", (100.0, 0.0))
    aim = await _aim(world)
    told = describe(aim.look, aim.target, aim.correction)
    here = world.gantry.reported
    assert told["x_um"] == round(here.x_um, 2)
    assert told["theta_deg"] == 0.0
    assert (told["white_sequence"], told["red_sequence"]) == (1, 2)
    assert told["tip_px"] == [800.0, 620.0]
    assert told["tip_sigma_px"] == 0.1
    assert (told["dx_um"], told["kind"]) == (pytest.approx(100.0, abs=0.02), "site")
    assert told["sigma_um"] == round(aim.correction.sigma_um, 2)
    assert told["needle"] == {
        "width_px": 32.0,
        "marking_px": SHAPE.marking_px,
        "contrast": 0.6,
        "bend_px": 0.2,
        "sharpness": 0.3,
        "score": 0.97,
        "support": 0.9,
    }


async def test_what_was_not_found_is_not_described(world: World) -> None:
    look = await world.station.look(world.gantry.reported, None, Search((0.0, 0.0), 50.0, None), begin(REQUEST).job)
    told = describe(replace(look, red=None), None, None)
    assert set(told) == {"x_um", "y_um", "z_um", "theta_deg", "white_sequence"}


async def test_a_calibrated_stations_correction_uses_what_it_knows(lonely: World) -> None:
    lonely.with_head(lonely.config.head.model()).with_alignment(lonely.config.board.pose())
    lonely.put_beside("A", (30.0, 0.0))
    lonely.strays_um = [(10_300.0, 5_000.0, 500.0)]
    await run(lonely, PROCEDURES["correct"], REQUEST)
    assert math.hypot(*lonely.miss_um("A")) < 0.1
