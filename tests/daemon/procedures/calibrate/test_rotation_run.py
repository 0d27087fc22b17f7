"""One run over the head angles: each stop is walked to, missed ones are counted, an interrupted run goes on."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.calibrate import rotation_run
from daemon.procedures.calibrate.rotation_run import ASIDE_UM, MAX_LOOKS, REACH_PX, RotationRun
from daemon.procedures.calibrate.targets import choose_target
from daemon.procedures.move_sequence import MoveSequence
from daemon.station.station import CrossSearch, LookResult
from daemon.storage.calibration_resume import Partial
from tests.daemon.procedures.fake_station import BELOW_PX, WORK_Z_UM, Ran, World, a_board, begin
from vision import NotFound, Reason
from vision.head.model import CircleHead

ANGLES = [140.0, 200.0, 260.0, 320.0, 20.0, 80.0]


def _world(folder: Path, **changes: dict[str, Any]) -> World:
    free_at_work = {"gantry": {"press_um": 0.0, "surface_range_um": 100.0}}
    return World(folder, a_board(("A", 0.0, 0.0)), free_at_work | changes).teach().with_map()


@pytest.fixture
def world(tmp_path: Path) -> World:
    return _world(tmp_path)


def _run(world: World, angles: list[float] | None = None, spare: int = 0) -> tuple[RotationRun, Ran]:
    ran = begin({"op": "calibrate", "what": "rotation"})
    ran.job.fire(Event.ACCEPTED)
    target = choose_target(world.context, None)
    sequence = MoveSequence(ran.job, world.context)
    return RotationRun(sequence, target, world.context.require_map(), angles or ANGLES, spare_steps=spare), ran


async def _measure(run: RotationRun, ran: Ran, *, resume: bool = False) -> bool:
    try:
        return await run.measure(resume=resume)
    finally:
        await ran.job.settle()


async def _fault(run: RotationRun, ran: Ran, *, resume: bool = False) -> Fault:
    with pytest.raises(Fault) as caught:
        await _measure(run, ran, resume=resume)
    return caught.value


def _unseen(look: LookResult) -> LookResult:
    return replace(look, cross=NotFound(Reason.NO_CONTROL_POINT, "hidden by the needle"))


def _at(world: World, angle: float) -> bool:
    return abs(world.gantry.actual.theta_deg % 360.0 - angle) < 1e-6


# --- a run --------------------------------------------------------------------------------------------------------


async def test_every_angle_is_visited_and_the_first_one_again(world: World) -> None:
    run, ran = _run(world, spare=3)
    assert not await _measure(run, ran)
    assert [s.theta_deg for s in run.measured.stops] == ANGLES
    assert [round(to.theta_deg) for to, _ in world.gantry.moves] == [140, *(round(a) for a in ANGLES), 140]
    assert run.closure_um == pytest.approx(0.0, abs=0.05)
    total = len(ANGLES) + 3 + 1
    assert ran.progress == [
        *((n, total, f"head angle {a:.1f} deg") for n, a in enumerate(ANGLES)),
        (len(ANGLES), total, "again 140.0 deg"),
    ]
    for stop in run.measured.stops:
        tip = np.array((stop.x_um, stop.y_um)) + world.true_head.tip_offset_um(stop.theta_deg)
        assert tip == pytest.approx(world.cross_um, abs=0.05)


async def test_the_first_look_is_wide_and_the_others_are_near(world: World) -> None:
    run, ran = _run(world)
    await _measure(run, ran)
    first, *others = world.station.searches
    assert first == CrossSearch(BELOW_PX, 2 * 700.0 / 12.0, 720.0 / 12.0)
    assert others == [CrossSearch(BELOW_PX, REACH_PX, 720.0 / 12.0)] * (len(ANGLES) + 1)


@pytest.mark.parametrize(("off_um", "looks"), [(59.5, 1), (60.5, 2), (400.0, 2)])
async def test_from_afar_the_tip_is_walked_nearer_before_it_counts(world: World, off_um: float, looks: int) -> None:
    world.cross_um = (world.cross_um[0] + off_um, world.cross_um[1])
    run, ran = _run(world, [140.0])
    await _measure(run, ran)
    # The search for the print has walked there already; the first visit stands on it.
    assert len(world.gantry.moves) == looks + 2
    (stop,) = run.measured.stops
    assert (stop.looks, stop.off_um) == (1, pytest.approx(0.0, abs=0.05))


async def test_a_stop_tells_how_far_off_the_tip_was_first_and_how_many_looks_it_took(world: World) -> None:
    head = world.config.head
    world.true_head = CircleHead(head.radius_um + 150.0, head.phase_deg)
    run, ran = _run(world, [0.0, 180.0])
    await _measure(run, ran)
    _, second = run.measured.stops
    assert (second.looks, second.off_um) == (2, pytest.approx(300.0, abs=0.5))
    assert second.off_um == round(second.off_um, 2)


async def test_where_the_tip_never_gets_near_the_last_look_counts(world: World) -> None:
    """The stops scatter by more than what is near: no visit takes more than three looks."""
    signs = iter([1.0, -1.0] * 50)
    world.gantry.scatter_um = lambda: (150.0 * next(signs), 0.0)
    run, ran = _run(world, [20.0])
    with pytest.raises(Fault):
        await run.measure(resume=False)
    await ran.job.settle()
    (stop,) = run.measured.stops
    assert stop.looks == MAX_LOOKS


async def test_the_exact_distance_still_is_near(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    head = world.config.head
    world.true_head = CircleHead(head.radius_um + 20.0, head.phase_deg)
    looks = []
    offs: list[float] = []
    for limit_um in (1_000.0, None, -1e-9):
        monkeypatch.setattr(rotation_run, "NEAR_UM", limit_um if limit_um == 1_000.0 else offs[0] + (limit_um or 0.0))
        run, ran = _run(world, [0.0, 180.0])
        await _measure(run, ran)
        looks.append(run.measured.stops[1].looks)
        if not offs:
            offs.append(_exact_off_um(world, run))
    assert looks[0] == 1
    assert looks[2] == 2


def _exact_off_um(world: World, run: RotationRun) -> float:
    """Return the second stop's way as the run itself measured it."""
    sighting = run.measured.sightings[1]
    stop = run.measured.stops[1]
    return math.hypot(stop.x_um - sighting.x_um, stop.y_um - sighting.y_um)


async def test_the_runout_is_followed_from_stop_to_stop(world: World) -> None:
    """Each jump starts from where the last stop put the print: what is off is only what the head adds in between."""
    head = world.config.head
    world.true_head = CircleHead(head.radius_um + 150.0, head.phase_deg)
    angles = [0.0, 30.0, 60.0, 90.0]
    run, ran = _run(world, angles)
    await _measure(run, ran)
    between = 150.0 * 2 * math.sin(math.radians(15.0))
    assert [s.off_um for s in run.measured.stops[1:]] == pytest.approx([between] * 3, abs=0.5)


# --- what is not seen ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("blind", [1, 4])
async def test_a_hidden_print_is_looked_at_from_beside(world: World, blind: int) -> None:
    world.station.script = dict.fromkeys(range(1, blind + 1), _unseen)
    run, ran = _run(world, [140.0])
    await _measure(run, ran)
    over = world.geometry.position_at(world.config.control_point.place_um, 140.0)  # type: ignore[union-attr]
    went = [(to.x_um - over.x_um, to.y_um - over.y_um) for to, _ in world.gantry.moves[: blind + 1]]
    assert went == [pytest.approx(step) for step in ASIDE_UM[: blind + 1]]
    assert run.measured.stops[0].off_um == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("blind", [1, 4])
async def test_a_print_seen_from_beside_at_the_end_has_not_moved(world: World, blind: int) -> None:
    """It is looked at from all four sides in turn, until one shows it."""
    assert ASIDE_UM == ((0.0, 0.0), (250.0, 0.0), (-250.0, 0.0), (0.0, 250.0), (0.0, -250.0))
    first = 1 + len(ANGLES)
    world.station.script = dict.fromkeys(range(first + 1, first + 1 + blind), _unseen)
    run, ran = _run(world)
    await _measure(run, ran)
    assert len(world.gantry.moves) == first + 1 + blind
    assert run.closure_um == pytest.approx(0.0, abs=0.05)


async def test_a_print_that_is_nowhere_at_the_first_angle_ends_the_run(world: World) -> None:
    world.hidden = {"control point"}
    run, ran = _run(world)
    fault = await _fault(run, ran)
    assert fault.kind is FaultCode.CALIBRATION_FAILED
    assert fault.message == "the control point was not seen at 140.0 deg: it is no_control_point"
    assert "lies flat, clean" in fault.advice
    assert len(world.gantry.moves) == len(ASIDE_UM)


@pytest.mark.parametrize(
    ("count", "missed", "good"),
    [(6, 1, True), (6, 2, False), (13, 1, True), (13, 2, False), (14, 2, True), (14, 3, False), (20, 3, True)],
)
async def test_an_angle_may_be_missed_many_may_not(world: World, count: int, missed: int, good: bool) -> None:
    angles = [140.0 + 10.0 * n for n in range(count)]
    bad = angles[2 : 2 + missed]
    world.station.always = lambda look: _unseen(look) if any(_at(world, a) for a in bad) else look
    run, ran = _run(world, angles)
    if good:
        await _measure(run, ran)
        assert [s.theta_deg for s in run.measured.stops] == [a for a in angles if a not in bad]
        return
    where = ", ".join(f"{a:.1f}" for a in bad)
    fault = await _fault(run, ran)
    assert fault.message == f"the control point was not seen at {where} deg: hidden by the needle"


async def test_the_first_reason_is_told_not_the_last(world: World) -> None:
    world.hidden = {"control point"}
    world.station.script[1] = _unseen
    run, ran = _run(world)
    assert (await _fault(run, ran)).message.endswith("hidden by the needle")


async def test_a_print_lost_at_the_end_ends_the_run(world: World) -> None:
    world.station.always = lambda look: _unseen(look) if len(world.gantry.moves) > 1 + len(ANGLES) else look
    run, ran = _run(world)
    assert (await _fault(run, ran)).message == "the control point was lost at the end: hidden by the needle"


@pytest.mark.parametrize(("moved_um", "good"), [((0.0, 39.5), True), ((30.0, 28.0), False), ((-40.5, 0.0), False)])
async def test_a_print_that_moved_meanwhile_is_found_out_at_the_end(
    world: World, moved_um: tuple[float, float], good: bool
) -> None:
    x_um, y_um = world.cross_um

    def move(look: LookResult) -> LookResult:
        if len(world.gantry.moves) == 1 + len(ANGLES):
            world.cross_um = (x_um + moved_um[0], y_um + moved_um[1])
        return look

    world.station.always = move
    run, ran = _run(world)
    if good:
        await _measure(run, ran)
        assert run.closure_um == pytest.approx(39.5, abs=0.05)
        return
    fault = await _fault(run, ran)
    assert fault.kind is FaultCode.CALIBRATION_FAILED
    assert fault.detail["closure_um"] == pytest.approx(math.hypot(*moved_um), abs=0.11)
    assert "at 140.0 deg the control point is 41 um from where it was" in fault.message or "40 um" in fault.message


async def test_the_exact_closure_is_allowed(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    world.gantry.scatter_um = lambda: (0.0, 25.0) if len(world.gantry.moves) > 1 + len(ANGLES) else (0.0, 0.0)
    run, ran = _run(world)
    await _measure(run, ran)
    assert run.closure_um == pytest.approx(25.0, abs=0.05)
    monkeypatch.setattr(rotation_run, "MAX_CLOSURE_UM", run.closure_um)
    world.gantry.moves.clear()
    again, ran = _run(world)
    await _measure(again, ran)


# --- landings by another head -------------------------------------------------------------------------------------


async def test_a_landing_is_where_the_tip_came_to_be_from_the_print(world: World) -> None:
    run, ran = _run(world, spare=2)
    await _measure(run, ran)
    moves = len(world.gantry.moves)
    true = world.config.head
    other = CircleHead(true.radius_um + 30.0, true.phase_deg)
    landings = await run.land(other, world.cross_um, [30.0, 230.0])
    await ran.job.settle()
    assert [one.theta_deg for one in landings] == [30.0, 230.0]
    for one in landings:
        off = world.true_head.tip_offset_um(one.theta_deg) - other.tip_offset_um(one.theta_deg)
        assert (one.dx_um, one.dy_um) == pytest.approx(tuple(off), abs=0.05)
    assert len(world.gantry.moves) == moves + 2
    assert [(done, total) for done, total, _ in ran.progress[-2:]] == [(7, 9), (8, 9)]
    assert ran.progress[-1][2] == "landing at 230.0 deg"


async def test_a_landing_that_is_seen_from_beside_is_where_it_would_have_been(world: World) -> None:
    """The needle hid the print: the step aside is no error of the head."""
    run, ran = _run(world, spare=2)
    await _measure(run, ran)
    before = len(world.gantry.moves)
    world.station.always = lambda look: _unseen(look) if len(world.gantry.moves) == before + 1 else look
    true = world.config.head
    other = CircleHead(true.radius_um + 30.0, true.phase_deg)
    (one,) = await run.land(other, world.cross_um, [30.0])
    await ran.job.settle()
    off = world.true_head.tip_offset_um(30.0) - other.tip_offset_um(30.0)
    assert len(world.gantry.moves) == before + 2
    assert (one.dx_um, one.dy_um) == pytest.approx(tuple(off), abs=0.05)


async def test_a_stop_that_is_seen_from_beside_is_no_farther_off_for_that(world: World) -> None:
    run, ran = _run(world)
    world.station.always = lambda look: _unseen(look) if len(world.gantry.moves) == 3 else look
    await _measure(run, ran)
    assert [s.off_um for s in run.measured.stops] == pytest.approx([0.0] * len(ANGLES), abs=0.05)


async def test_a_landing_that_is_not_seen_is_left_out(world: World) -> None:
    run, ran = _run(world)
    await _measure(run, ran)
    world.station.always = lambda look: _unseen(look) if _at(world, 230.0) else look
    landings = await run.land(world.config.head.model(), world.cross_um, [30.0, 230.0])
    await ran.job.settle()
    assert [one.theta_deg for one in landings] == [30.0]


# --- going on with an interrupted run -----------------------------------------------------------------------------


async def _interrupted(world: World, after: int) -> RotationRun:
    """Run until so many angles are measured, then fail."""
    world.station.always = lambda look: replace(
        look, tip=NotFound(Reason.TOO_DARK, "lamp out"), cross=None
    ) if _at(world, ANGLES[after]) else look  # fmt: skip
    run, ran = _run(world)
    assert (await _fault(run, ran)).kind is FaultCode.FRAME_UNUSABLE
    world.station.always = lambda look: look
    world.gantry.moves.clear()
    return run


async def test_every_angle_is_on_disk_at_once(world: World) -> None:
    run = await _interrupted(world, 3)
    left = Partial.read(world.calibrations.folder)
    assert left is not None
    assert left.stops == run.measured.stops
    assert [s.theta_deg for s in left.stops] == ANGLES[:3]
    assert (left.station, left.probe) == ("station-1", world.calibrations.fingerprint)
    assert (left.angles, left.control_um) == (tuple(ANGLES), world.cross_um)


async def test_an_interrupted_run_goes_on_where_it_ended(world: World) -> None:
    before = await _interrupted(world, 3)
    run, ran = _run(world)
    assert await _measure(run, ran, resume=True)
    assert run.measured.stops[:3] == before.measured.stops
    assert [s.theta_deg for s in run.measured.stops] == ANGLES
    assert [round(to.theta_deg) for to, _ in world.gantry.moves] == [260, 320, 20, 80, 140]


async def test_an_interrupted_run_knows_what_its_earlier_legs_took(world: World) -> None:
    """So that its record and its page are of the whole run; a leg that began anew counts from there."""
    await _interrupted(world, 3)
    left = Partial.read(world.calibrations.folder)
    assert left is not None
    assert (left.spent.legs, left.spent.looks >= 3, left.spent.seconds > 0.0) == (1, True, True)
    run, ran = _run(world)
    await _measure(run, ran, resume=True)
    assert run.earlier == left.spent
    both = Partial.read(world.calibrations.folder)
    assert both is not None
    assert both.spent.legs == 2
    assert both.spent.looks >= left.spent.looks + 3
    anew, ran = _run(world)
    await _measure(anew, ran, resume=False)
    assert anew.earlier.legs == 0


async def test_what_was_learned_of_the_print_is_taken_over(world: World) -> None:
    head = world.config.head
    world.true_head = CircleHead(head.radius_um + 150.0, head.phase_deg)
    await _interrupted(world, 3)
    run, ran = _run(world)
    await _measure(run, ran, resume=True)
    between = 150.0 * 2 * math.sin(math.radians(30.0))
    assert run.measured.stops[3].off_um == pytest.approx(between, abs=0.5)


async def test_a_run_is_begun_from_the_start_if_that_is_asked_for(world: World) -> None:
    await _interrupted(world, 3)
    run, ran = _run(world)
    assert not await _measure(run, ran, resume=False)
    assert round(world.gantry.moves[0][0].theta_deg) == 140


@pytest.mark.parametrize(("moved_um", "goes_on"), [(39.5, True), (40.5, False)])
async def test_a_run_whose_last_stop_is_elsewhere_now_is_not_continued(
    world: World, moved_um: float, goes_on: bool
) -> None:
    await _interrupted(world, 3)
    world.gantry.scatter_um = lambda: (moved_um, 0.0) if len(world.gantry.moves) == 1 else (0.0, 0.0)
    run, ran = _run(world)
    assert await _measure(run, ran, resume=True) is goes_on
    assert round(world.gantry.moves[1][0].theta_deg) == (320 if goes_on else 140)
    assert [s.theta_deg for s in run.measured.stops] == ANGLES


async def test_a_run_whose_last_stop_cannot_be_seen_is_not_continued(world: World) -> None:
    await _interrupted(world, 3)
    world.station.always = lambda look: _unseen(look) if len(world.gantry.moves) <= len(ASIDE_UM) else look
    run, ran = _run(world)
    assert not await _measure(run, ran, resume=True)
    assert [s.theta_deg for s in run.measured.stops] == ANGLES


async def test_another_kind_of_run_is_not_continued(world: World) -> None:
    await _interrupted(world, 3)
    run, ran = _run(world, [*ANGLES, 90.0])
    assert not await _measure(run, ran, resume=True)


async def test_without_anything_left_a_run_begins(world: World) -> None:
    run, ran = _run(world)
    assert not await _measure(run, ran, resume=True)
    left = Partial.read(world.calibrations.folder)
    assert left is not None
    left.model_copy(update={"stops": (), "sightings": ()}).write(world.calibrations.folder)
    again, ran = _run(world)
    assert not await _measure(again, ran, resume=True)


async def test_the_head_follows_the_papers_height(tmp_path: Path) -> None:
    world = _world(tmp_path, gantry={"press_um": 200.0})
    world.height_um = lambda _x, _y: 50.0
    run, ran = _run(world, [0.0, 180.0])
    await _measure(run, ran)
    assert run.measured.card_height_um == pytest.approx(50.0, abs=0.1)
    search = world.station.searches[-1]
    assert isinstance(search, CrossSearch)
    # The head follows: it stands as far above the print as the map was made above its mark.
    assert world.gantry.moves[-1][0].z_um == pytest.approx(WORK_Z_UM + 50.0, abs=0.1)
    assert search.offset_px == pytest.approx(BELOW_PX, abs=0.01)
    for stop in run.measured.stops:
        tip = np.array((stop.x_um, stop.y_um)) + world.true_head.tip_offset_um(stop.theta_deg)
        assert tip == pytest.approx(world.cross_um, abs=0.5)
