"""The walk round a target learns the exact map, parallax included, or says why not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.config.sections.base import Section
from daemon.config.sections.touching import BrushSection
from daemon.domain.board_layers import Body, Painting
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.calibrate import map_walk
from daemon.procedures.calibrate.far_places import FAR_COUNT, FAR_REACH_PX, FAR_UM
from daemon.procedures.calibrate.map_walk import (
    LIFT_REACH_PX,
    LIFTS,
    MIN_SIGHTINGS,
    RINGS,
    SEARCH_STEPS,
    TABLE_6_1,
    MapAcquisition,
    table_step_um,
)
from daemon.procedures.calibrate.targets import choose_target
from daemon.procedures.move_sequence import MoveSequence
from daemon.procedures.registry import PROCEDURES
from daemon.station.station import CrossSearch, LookResult, Search
from daemon.storage.calibration_records import MapRecord
from drivers.errors import EnvelopeViolation, Stalled
from tests.daemon.procedures.cad_board import cad_board, cad_pad, rectangle
from tests.daemon.procedures.fake_station import (
    BELOW_PX,
    HOVER_UM,
    NEEDLE_RAD,
    SHAPE,
    TIP_PX,
    WORK_Z_UM,
    Edit,
    Ran,
    World,
    a_board,
    begin,
    missing,
    run,
)
from vision import NotFound, Reason, Seen
from vision.geometry.frames import rotation

REQUEST = {"op": "calibrate", "what": "map", "test_point": "A"}
WALK = sum(count for _, count in RINGS)


FREE_AT_WORK = {"surface_range_um": 100.0}
"""Working height is free of any surface that is possible: heights are no matter here."""


def _world(folder: Path, **changes: dict[str, Any] | Section) -> World:
    free = changes | {"gantry": FREE_AT_WORK}
    return World(folder, a_board(("A", 10_000.0, 5_000.0)), free).teach()


@pytest.fixture
def world(tmp_path: Path) -> World:
    return _world(tmp_path)


async def _map(world: World, request: dict[str, Any] | None = None, ran: Ran | None = None) -> Ran:
    return await run(world, PROCEDURES["calibrate"], REQUEST | (request or {}), ran)


async def _fault(world: World, request: dict[str, Any] | None = None, ran: Ran | None = None) -> Fault:
    with pytest.raises(Fault) as caught:
        await _map(world, request, ran)
    return caught.value


def _offsets(world: World, theta_deg: float = 0.0) -> list[Any]:
    """Return where the head went, from over the target's supposed place."""
    over = world.geometry.position_over(world.board.find("A").place_um, theta_deg)
    return [np.array((to.x_um - over.x_um, to.y_um - over.y_um, to.z_um - over.z_um)) for to, _ in world.gantry.moves]


def _hide(look: LookResult) -> LookResult:
    return replace(look, seen=Seen(missing(), (), (), (), (0, 0, 10, 10)))


# --- what comes out -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta_deg", [0.0, 75.0])
@pytest.mark.parametrize("place", [{}, {"test_point": None}], ids=["round", "cross"])
async def test_the_map_is_the_cameras_own(world: World, place: dict[str, Any], theta_deg: float) -> None:
    await _map(world, place | {"theta_deg": theta_deg})
    found = world.context.require_map()
    assert found.below_tip_px == pytest.approx(BELOW_PX, abs=0.02)
    assert found.below_sigma_px == pytest.approx(0.0, abs=1e-6)
    assert (found.work_z_um, found.hover_um) == (WORK_Z_UM, HOVER_UM)
    for px in ((820.0, 600.0), (770.0, 650.0), (805.0, 660.0)):
        true_way = world.true_map.correction(px, TIP_PX, theta_deg)
        way = found.correction(px, TIP_PX, theta_deg)
        assert (way.dx_um, way.dy_um) == pytest.approx((true_way.dx_um, true_way.dy_um), abs=0.3)


async def test_the_answer_and_the_record_carry_what_was_seen(world: World) -> None:
    ran = await _map(world, {"theta_deg": 30.0})
    told, record = ran.got.detail, world.calibrations.records["map"]
    assert isinstance(record, MapRecord)
    assert (record.mark, record.theta_deg, record.tip_px) == ("A", 30.0, TIP_PX)
    assert (ran.got.outcome, ran.got.test_point, told["what"]) == ("calibrated", "A", "map")
    assert told["sightings"] == len(record.sightings) == WALK + 3 + FAR_COUNT
    assert told["residual_um"] == pytest.approx(0.0, abs=0.02)
    assert told["below_tip_px"] == pytest.approx(list(BELOW_PX), abs=0.02)
    assert told["um_per_px"] == pytest.approx(1 / world.true_map.scale_px_per_um(TIP_PX), abs=0.01)
    assert 2_500.0 < told["radius_um"] < 3_700.0
    for seen in record.sightings:
        away = world.pad_um("A") - np.add(
            (seen.x_um, seen.y_um), world.config.head.model().tip_offset_um(seen.theta_deg)
        )
        (px,) = world.true_map.to_px(away, TIP_PX, seen.theta_deg)
        assert seen.target_px == pytest.approx(tuple(px), abs=1e-6)


async def test_every_look_of_the_walk_has_the_tip_measured(tmp_path: Path) -> None:
    """A tip that is carried from another picture is no ground for a map, nor for how far a lift shifts it."""
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {}).teach()
    await _map(world)
    assert len(world.station.measured) > 20
    assert all(world.station.measured)


async def test_a_target_off_its_place_is_walked_round_where_it_lies(world: World) -> None:
    world.true_pose = replace(world.true_pose, tx_um=60_280.0, ty_um=39_810.0)
    ran = await _map(world)
    assert world.context.require_map().below_tip_px == pytest.approx(BELOW_PX, abs=0.02)
    rings = np.array(_offsets(world)[3 : 3 + WALK])[:, :2]
    centre = rings[6:].mean(axis=0)
    # The small steps see the pad at the tip's own picture: BELOW_PX is not known yet.
    below = world.true_map.to_head_um(TIP_PX) - world.true_map.to_head_um(np.add(TIP_PX, BELOW_PX))
    assert centre == pytest.approx(np.array((280.0, -190.0)) - below, abs=12.0)
    assert ran.got.outcome == "calibrated"


async def test_how_far_the_lift_scatters_is_kept_as_its_uncertainty(world: World) -> None:
    rng = np.random.default_rng(7)
    noise = [(float(rng.normal(0, 0.1)), float(rng.normal(0, 0.3))) for _ in range(2 * LIFTS)]
    count = 3 + WALK + FAR_COUNT
    by_look = {count + 1 + n: error for n, error in enumerate(noise)}
    world.noise_px = lambda: by_look.get(len(world.station.searches), (0.0, 0.0))
    await _map(world)
    found = world.context.require_map()
    lifts = np.array([np.subtract(noise[2 * k + 1], noise[2 * k]) for k in range(LIFTS)]) + BELOW_PX
    assert found.below_tip_px == pytest.approx(tuple(lifts.mean(axis=0)), abs=0.02)
    assert found.below_sigma_px == pytest.approx(float(lifts.std(axis=0, ddof=1).mean()) / math.sqrt(LIFTS), abs=1e-3)


# --- the way of the walk ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("seen_px", "step_um"),
    [(10.0, 300.0), (9.99, 200.0), (6.0, 200.0), (5.99, 100.0), (4.0, 100.0), (3.99, 50.0), (3.0, 50.0), (2.99, 30.0),
     (0.0, 30.0), (500.0, 300.0)],
)  # fmt: skip
def test_fixed_steps_are_those_of_table_6_1(seen_px: float, step_um: float) -> None:
    assert table_step_um(seen_px) == step_um
    assert TABLE_6_1[0] == (10.0, 300.0)


async def test_it_steps_along_both_axes_then_walks_two_rings(world: World) -> None:
    ran = await _map(world)
    first, along_x, along_y, *rest = (offset[:2] for offset in _offsets(world))
    step = table_step_um(math.hypot(*BELOW_PX))
    assert first == pytest.approx((0.0, 0.0))
    assert along_x == pytest.approx((step, 0.0))
    assert along_y == pytest.approx((0.0, step))
    inner, outer = np.array(rest[:6]), np.array(rest[6:16])
    centre = outer.mean(axis=0)
    assert inner.mean(axis=0) == pytest.approx(centre, abs=1e-6)
    assert np.linalg.norm(inner - centre, axis=1) == pytest.approx([0.45 * 700.0] * 6)
    assert np.linalg.norm(outer - centre, axis=1) == pytest.approx([0.95 * 700.0] * 10)
    angles = np.degrees(np.arctan2(*(outer - centre).T[::-1])) % 360.0
    assert angles[0] == pytest.approx(0.95 * 36.0)
    assert np.diff(angles) == pytest.approx([36.0] * 9)
    assert ran.progress == [(4 + n, WALK + 3 + FAR_COUNT, "map on A") for n in range(WALK + FAR_COUNT)]
    assert ran.events[:3] == [Event.ACCEPTED, Event.SEEN, Event.ARRIVED]


async def test_the_walk_looks_wide_and_the_lift_near(world: World) -> None:
    await _map(world)
    searches = [s for s in world.station.searches if isinstance(s, Search)]
    wide = Search((0.0, 0.0), pytest.approx(2 * 700.0 / 12.0), pytest.approx(250.0 / 12.0))
    assert searches[: 3 + WALK] == [wide] * (3 + WALK)
    lifts = searches[3 + WALK + FAR_COUNT :]
    for low, high in zip(lifts[::2], lifts[1::2], strict=True):
        assert low == wide
        assert high.reach_px == LIFT_REACH_PX
        assert math.hypot(*high.offset_px) > 20.0, "it is expected where it was seen from below"


async def test_the_lift_is_beside_the_needle_across_its_direction(world: World) -> None:
    await _map(world)
    offsets = _offsets(world)[3 + WALK + FAR_COUNT :]
    assert [round(float(o[2])) for o in offsets] == [0, 200] * LIFTS
    assert all(np.allclose(o[:2], offsets[0][:2]) for o in offsets)
    seen = world.calibrations.records["map"]
    assert isinstance(seen, MapRecord)
    over = world.geometry.position_over(world.board.find("A").place_um, 0.0)
    (chosen,) = [s.target_px for s in seen.sightings
                 if np.allclose((s.x_um - over.x_um, s.y_um - over.y_um), offsets[0][:2])]  # fmt: skip
    scale = world.true_map.scale_px_per_um(TIP_PX)
    way = min(250.0 * scale + SHAPE.cylinder_half_px, 700.0 / 12.0)
    wanted = [np.add(TIP_PX, rotation(math.degrees(NEEDLE_RAD)) @ (0.0, side * way)) for side in (-1, 1)]

    def away(px: tuple[float, float]) -> float:
        return min(math.dist(px, want) for want in wanted)

    assert away(chosen) == min(away(s.target_px) for s in seen.sightings)


async def test_a_large_target_is_not_left_for_the_lift(tmp_path: Path) -> None:
    """Its half width and the needle's would be more than half the reach: half the reach it is."""
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0), diameter_um=1_600.0), {"gantry": FREE_AT_WORK}).teach()
    await _map(world)
    chosen = _offsets(world)[3 + WALK + FAR_COUNT][:2]
    record = world.calibrations.records["map"]
    assert isinstance(record, MapRecord)
    way = 700.0 / 12.0
    wanted = [np.add(TIP_PX, rotation(math.degrees(NEEDLE_RAD)) @ (0.0, side * way)) for side in (-1, 1)]
    over = world.geometry.position_over(world.board.find("A").place_um, 0.0)
    best = min(record.sightings, key=lambda s: min(math.dist(s.target_px, want) for want in wanted))
    assert chosen == pytest.approx((best.x_um - over.x_um, best.y_um - over.y_um))


async def test_extremes_are_the_corners_of_all_that_may_be_walked(world: World) -> None:
    ran = begin(REQUEST)
    walk = MapAcquisition(
        MoveSequence(ran.job, world.context), choose_target(world.context, world.board.find("A")), 0.0
    )
    over = world.geometry.position_over(world.board.find("A").place_um, 0.0)
    corners = {(p.x_um - over.x_um, p.y_um - over.y_um, p.z_um - over.z_um) for p in walk.extremes()}
    assert {(round(x), round(y), round(z)) for x, y, z in corners} == {
        (x, y, z) for x in (-1400, 1400) for y in (-1400, 1400) for z in (0, 200)
    }
    assert walk.over == over


@pytest.mark.parametrize(("room_um", "good"), [(1_390.0, False), (1_410.0, True)])
@pytest.mark.parametrize(("axis", "end"), [("x", "minimum"), ("x", "maximum"), ("y", "minimum"), ("y", "maximum")])
async def test_there_must_be_room_for_the_walk_before_it_begins(
    tmp_path: Path, axis: str, end: str, room_um: float, good: bool
) -> None:
    free = _world(tmp_path / "free")
    over = free.geometry.position_over(free.board.find("A").place_um, 0.0)
    limit = getattr(over, f"{axis}_um") + (room_um if end == "maximum" else -room_um)
    section = getattr(free.config.axes, axis).model_copy(update={end: limit})
    world = _world(tmp_path / "tight", axes={axis: section})
    if good:
        await _map(world)
        return
    ran = begin(REQUEST)
    with pytest.raises(EnvelopeViolation):
        await _map(world, ran=ran)
    assert (world.gantry.moves, ran.events) == ([], [])


async def test_far_from_the_tip_the_map_is_as_good_as_what_was_seen_there(world: World) -> None:
    """The flex of the stops bends a map of the near rings alone by some per cent of what is far out."""
    rng = np.random.default_rng(3)
    world.noise_px = lambda: (float(rng.normal(0, 0.7)), float(rng.normal(0, 0.7)))
    await _map(world)
    found = world.context.require_map()
    for far_px in ((280.0, 0.0), (-280.0, 0.0), (0.0, 280.0), (0.0, -280.0)):
        px = np.add(TIP_PX, far_px)
        off_um = found.from_tip_um(px, TIP_PX, 0.0) - world.true_map.from_tip_um(px, TIP_PX, 0.0)
        assert float(np.linalg.norm(off_um)) < 45.0


async def test_the_far_ring_is_looked_for_where_the_near_ones_say_that_it_is(world: World) -> None:
    await _map(world)
    searches = [s for s in world.station.searches if isinstance(s, Search)][3 + WALK : 3 + WALK + FAR_COUNT]
    offsets = np.array(_offsets(world)[3 + WALK : 3 + WALK + FAR_COUNT])
    assert {s.reach_px for s in searches} == {FAR_REACH_PX}
    assert np.linalg.norm(offsets[:, :2] - offsets[:, :2].mean(axis=0), axis=1) == pytest.approx([FAR_UM] * FAR_COUNT)
    assert set(offsets[:, 2]) == {0.0}
    assert all(math.hypot(*s.offset_px) > 150.0 for s in searches)


async def test_far_places_out_of_reach_or_unseen_are_left_out(tmp_path: Path) -> None:
    free = _world(tmp_path / "free")
    over = free.geometry.position_over(free.board.find("A").place_um, 0.0)
    section = free.config.axes.x.model_copy(update={"maximum": over.x_um + 1_500.0})
    world = _world(tmp_path / "tight", axes={"x": section})
    world.station.script[3 + WALK + 1] = _hide
    told = (await _map(world)).got.detail
    assert told["sightings"] == WALK + 3 + FAR_COUNT - 2 - 1
    assert max(offset[0] for offset in _offsets(world)) <= 1_500.0


async def test_a_far_place_without_room_to_come_to_it_from_below_is_left_out(tmp_path: Path) -> None:
    """The axes come to a place from below it: one that is nearer to their end would be refused in mid-walk."""
    free = _world(tmp_path / "free")
    over = free.geometry.position_over(free.board.find("A").place_um, 0.0)
    section = free.config.axes.x.model_copy(update={"minimum": over.x_um - 2_800.0})
    world = _world(tmp_path / "tight", axes={"x": section})
    assert (await _map(world)).got.detail["sightings"] == WALK + 3 + FAR_COUNT - 2
    room_um = world.config.gantry.approach_um
    assert min(to.x_um for to, _ in world.gantry.moves) - room_um >= section.minimum


def _glare(look: LookResult) -> LookResult:
    return replace(look, seen=Seen(missing(Reason.SATURATED), (), (), (), (0, 0, 10, 10)))


def _no_tip(reason: Reason) -> Edit:
    return lambda look: replace(look, tip=NotFound(reason, "no tip"), seen=None)


@pytest.mark.parametrize("count", [1, FAR_COUNT])
@pytest.mark.parametrize("unseen", [_glare, _no_tip(Reason.TOO_DARK), _no_tip(Reason.NO_NEEDLE)])
async def test_what_is_not_seen_at_far_places_does_not_end_a_map_of_which_the_near_ones_are_good(
    world: World, count: int, unseen: Edit
) -> None:
    world.station.script = dict.fromkeys(range(4 + WALK, 4 + WALK + count), unseen)
    assert (await _map(world)).got.detail["sightings"] == WALK + 3 + FAR_COUNT - count
    assert world.context.require_map().below_tip_px == pytest.approx(BELOW_PX, abs=0.02)


async def test_a_lamp_that_goes_out_on_the_way_to_far_places_is_told(world: World) -> None:
    world.station.script = dict.fromkeys(range(4 + WALK, 4 + WALK + FAR_COUNT + 2), _glare)
    assert (await _fault(world)).kind is FaultCode.FRAME_UNUSABLE
    assert len(world.gantry.moves) == 3 + WALK + FAR_COUNT + 1


async def test_a_fault_of_the_machine_at_a_far_place_ends_it_at_once(world: World) -> None:
    world.gantry.failures[3 + WALK + 2] = Stalled("Y stalled", device="y")
    with pytest.raises(Stalled):
        await _map(world)
    assert len(world.gantry.moves) == 3 + WALK + 2


@pytest.mark.parametrize(("seen", "taken"), [(0, 0), (1, 0), (2, 0), (3, 3)])
async def test_so_few_far_sightings_that_none_is_held_against_another_bend_no_map(
    world: World, seen: int, taken: int
) -> None:
    world.station.script = dict.fromkeys(range(4 + WALK, 4 + WALK + FAR_COUNT - seen), _hide)
    told = (await _map(world)).got.detail
    assert told["sightings"] == WALK + 3 + taken
    assert (told["radius_um"] > 1_000.0) is (taken > 0)


def _seen_off(px: float) -> Edit:
    """Return what makes a pad seen by so much beside where it is."""

    def moved(look: LookResult) -> LookResult:
        assert look.seen is not None
        (pad,) = look.seen.taken
        off = replace(pad, x_px=pad.x_px + px)
        return replace(look, seen=replace(look.seen, nearest=off, taken=(off,)))

    return moved


async def test_far_sightings_that_the_near_ones_contradict_are_left_out(world: World) -> None:
    world.station.script = dict.fromkeys(range(4 + WALK, 4 + WALK + FAR_COUNT), _seen_off(20.0))
    told = (await _map(world)).got.detail
    assert (told["sightings"], told["residual_um"]) == (WALK + 3, pytest.approx(0.0, abs=0.02))
    assert told["radius_um"] < 1_000.0


async def test_near_sightings_of_another_thing_do_not_lead_the_far_ones_astray(world: World) -> None:
    world.station.script = dict.fromkeys((8, 12, 17), _seen_off(90.0))
    assert (await _map(world)).got.detail["sightings"] == WALK + 3 + FAR_COUNT
    searches = [s for s in world.station.searches if isinstance(s, Search)][3 + WALK : 3 + WALK + FAR_COUNT]
    record = world.calibrations.records["map"]
    assert isinstance(record, MapRecord)
    for search, seen in zip(searches, record.sightings[3 + WALK :], strict=True):
        assert np.add(TIP_PX, search.offset_px) == pytest.approx(seen.target_px, abs=0.5)


@pytest.mark.parametrize("what", ["bodies", "soldered"])
async def test_the_needle_comes_down_nowhere_far_out_where_a_part_or_solder_may_be(tmp_path: Path, what: str) -> None:
    board = cad_board(cad_pad("A", 10_000.0, 5_000.0, kind="site", shape="round", diameter_um=500.0, part=None))
    assert board.layers is not None
    part = rectangle(14_500.0, 5_000.0, 1_000.0, 400.0)
    there = (
        {"bodies": (Body(outline=part, part="U1"),)} if what == "bodies" else {"soldered": Painting(outlines=(part,))}
    )
    side = board.layers.top.model_copy(update=there)
    board = board.model_copy(update={"layers": board.layers.model_copy(update={"top": side})})
    world = World(tmp_path, board, {"gantry": FREE_AT_WORK}).teach()
    assert (await _map(world)).got.detail["sightings"] == WALK + 3 + FAR_COUNT - 2
    tips_um = [world.geometry.robot_to_board_um(world.geometry.tip_um(to)) for to, _ in world.gantry.moves]
    assert max(float(tip[0]) for tip in tips_um) < 14_000.0 - 1_500.0, "the barrel's radius"


async def test_the_needle_comes_down_nowhere_far_out_on_a_higher_reference_pad(tmp_path: Path) -> None:
    free = _world(tmp_path / "free")
    x_um, y_um = (float(v) for v in free.pad_um("A"))
    high = free.config.gantry.touch_z_um + 400.0
    brush = BrushSection(x_um=x_um + 7_500.0, y_um=y_um, z_um=high)
    world = _world(tmp_path / "world", brush=brush)
    assert (await _map(world)).got.detail["sightings"] == WALK + 3 + FAR_COUNT - 2
    assert max(offset[0] for offset in _offsets(world)) < 2_700.0


# --- what stands in the way ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("hidden", [1, 3, 7])
async def test_a_target_hidden_at_first_is_searched_round_its_place(world: World, hidden: int) -> None:
    world.station.script = dict.fromkeys(range(1, hidden + 1), _hide)
    await _map(world)
    offsets = [o[:2] for o in _offsets(world)]
    assert offsets[: hidden + 1] == [pytest.approx(step) for step in SEARCH_STEPS[: hidden + 1]]
    start = np.array(SEARCH_STEPS[hidden])
    assert offsets[hidden + 1] == pytest.approx(np.add(start, (300.0, 0.0)))
    assert offsets[hidden + 2] == pytest.approx(np.add(start, (0.0, 300.0)))


async def test_a_hidden_step_is_taken_the_other_way(world: World) -> None:
    world.station.script = dict.fromkeys((2, 4), _hide)
    await _map(world)
    offsets = [o[:2] for o in _offsets(world)]
    assert offsets[1:5] == [pytest.approx(o) for o in ((200.0, 0.0), (-200.0, 0.0), (0.0, 200.0), (0.0, -200.0))]
    assert world.context.require_map().below_tip_px == pytest.approx(BELOW_PX, abs=0.02)


async def test_a_step_hidden_at_both_ends_is_taken_longer(world: World) -> None:
    """A target right beside the needle, hidden just not too much at first, may be hidden at both ends of a step."""
    world.station.script = dict.fromkeys((2, 3, 5, 6, 7), _hide)
    await _map(world)
    wanted = ((200.0, 0.0), (-200.0, 0.0), (300.0, 0.0), (0.0, 200.0), (0.0, -200.0), (0.0, 300.0), (0.0, -300.0))
    assert [o[:2] for o in _offsets(world)][1:8] == [pytest.approx(o) for o in wanted]
    assert world.context.require_map().below_tip_px == pytest.approx(BELOW_PX, abs=0.02)


async def test_a_target_seen_from_nowhere_is_a_fault_with_the_last_reason(world: World) -> None:
    world.hidden = {"A"}
    fault = await _fault(world)
    assert fault.kind is FaultCode.TEST_POINT_NOT_FOUND
    assert fault.message == "A was not seen with the tip: it is no_test_point"
    assert len(world.gantry.moves) == len(SEARCH_STEPS)


@pytest.mark.parametrize(("lost", "good"), [(WALK + 3 - MIN_SIGHTINGS, True), (WALK + 4 - MIN_SIGHTINGS, False)])
async def test_too_few_sightings_are_no_map(world: World, lost: int, good: bool) -> None:
    # Every other place of the walk first, so that what is left surrounds the target.
    order = [*range(4, 4 + WALK, 2), *range(5, 4 + WALK, 2)]
    world.station.script = dict.fromkeys(order[:lost], _hide)
    if good:
        assert (await _map(world)).got.detail["sightings"] == MIN_SIGHTINGS + FAR_COUNT
        return
    fault = await _fault(world)
    assert fault.kind is FaultCode.CALIBRATION_FAILED
    assert f"A was seen from {MIN_SIGHTINGS - 1} places only; {MIN_SIGHTINGS} are needed: it is no_test_point" in (
        fault.message
    )
    assert world.calibrations.pose_map is None


@pytest.mark.parametrize("which", [1, 2])
async def test_a_target_lost_while_lifted_is_no_map(world: World, which: int) -> None:
    world.station.script[3 + WALK + FAR_COUNT + which] = _hide
    fault = await _fault(world)
    assert fault.kind is FaultCode.CALIBRATION_FAILED
    assert "A was lost while the needle was lifted beside it: it is no_test_point" in fault.message


async def test_an_image_that_does_not_move_with_the_head_shows_no_target(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    still = np.array((830.0, 640.0))

    def at_rest(look: LookResult) -> LookResult:
        assert look.seen is not None
        (pad,) = look.seen.taken
        slow = still + 0.1 * (np.array((pad.x_px, pad.y_px)) - still)
        moved = replace(pad, x_px=float(slow[0]), y_px=float(slow[1]))
        return replace(look, seen=replace(look.seen, nearest=moved, taken=(moved,)))

    world.station.always = at_rest
    fault = await _fault(world)
    assert "the picture hardly moves with the head" in fault.message
    assert len(world.gantry.moves) == 3
    world.station.always = lambda look: look
    scale = abs(np.linalg.det(np.linalg.inv(world.true_map.homography[:2, :2])))
    monkeypatch.setattr(map_walk, "LEAST_SCALE", scale * 0.5)
    await _map(world)
    monkeypatch.setattr(map_walk, "LEAST_SCALE", scale * 2.0)
    assert "hardly moves" in (await _fault(world)).message


async def test_the_walk_goes_no_farther_than_the_largest_placement_error_from_where_it_began(tmp_path: Path) -> None:
    world = _world(tmp_path, servo={"max_placement_um": 300.0})
    world.true_pose = replace(world.true_pose, tx_um=60_420.0)
    await _map(world)
    rings = np.array(_offsets(world)[: -FAR_COUNT - 2 * LIFTS][-WALK:])[:, :2]
    assert np.linalg.norm(rings[6:].mean(axis=0)) == pytest.approx(300.0)


async def test_an_unusable_frame_ends_it_at_once(world: World) -> None:
    world.station.script[5] = lambda look: replace(look, tip=NotFound(Reason.TOO_DARK, "dark"), seen=None)
    assert (await _fault(world)).kind is FaultCode.FRAME_UNUSABLE
    assert len(world.gantry.moves) == 5


async def test_it_needs_probe_and_homing_and_a_known_target(tmp_path: Path) -> None:
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {})
    ran = begin(REQUEST)
    assert "tip has not been taught" in (await _fault(world, ran=ran)).message
    assert ran.job.partial.test_point == "A"
    world.teach().gantry.is_homed = False
    assert (await _fault(world)).kind is FaultCode.NOT_HOMED
    assert (await _fault(world, {"test_point": "nil"})).kind is FaultCode.UNKNOWN_TEST_POINT
    assert world.gantry.moves == []


async def test_on_the_cross_only_white_frames_are_taken(world: World) -> None:
    await _map(world, {"test_point": None})
    assert all(isinstance(s, CrossSearch) for s in world.station.searches)
    record = world.calibrations.records["map"]
    assert isinstance(record, MapRecord)
    assert record.mark == "control point"
