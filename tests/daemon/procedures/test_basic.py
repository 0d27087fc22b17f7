"""Home, lift, place and look do one thing each, and say what came of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.registry import PROCEDURES
from daemon.station.station import Search
from daemon.wire.operations.table import OPERATIONS
from drivers.errors import EnvelopeViolation, Stalled
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import BELOW_PX, Ran, World, a_board, begin, run
from vision import Reason
from vision.core.not_found import NotFound


@pytest.fixture
def world(tmp_path: Path) -> World:
    board = a_board(("A", 10_000.0, 5_000.0), ("B", 20_000.0, 5_000.0))
    fiducial = board.points[1].model_copy(update={"name": "F", "y_um": 9_000.0, "why_not": "a fiducial"})
    return World(tmp_path, board.model_copy(update={"points": (*board.points, fiducial)}), {})


async def _failed(world: World, request: dict[str, object], ran: Ran | None = None) -> Fault:
    with pytest.raises(Fault) as caught:
        await run(world, PROCEDURES[str(request["op"])], request, ran)
    return caught.value


def test_every_job_has_the_procedure_of_its_operation() -> None:
    assert set(PROCEDURES) == {row.op for row in OPERATIONS.rows if row.is_job}


@pytest.mark.parametrize("op", sorted(PROCEDURES))
async def test_a_procedure_refuses_a_request_of_another_kind(world: World, op: str) -> None:
    other = {"op": "home"} if op != "home" else {"op": "look"}
    with pytest.raises(TypeError, match="is not for"):
        await PROCEDURES[op](begin(other).job, world.context)


# --- home ---------------------------------------------------------------------------------------------------------


async def test_home_homes_all_axes_and_says_where_the_head_is(world: World) -> None:
    ran = await run(world, PROCEDURES["home"], {"op": "home"})
    assert world.gantry.homings == 1
    assert ran.events == [Event.DEPARTED, Event.ARRIVED]
    assert ran.got.outcome == "homed"
    assert ran.got.detail == {"position": {"x_um": 50_000.0, "y_um": 40_000.0, "z_um": 5_200.0, "theta_deg": 0.0}}
    assert ran.job.moves == 1


async def test_home_fails_if_a_drive_does_not_agree_afterwards(world: World) -> None:
    world.gantry.is_homed = False
    assert (await _failed(world, {"op": "home"})).kind is FaultCode.NOT_HOMED


async def test_a_homing_that_leaves_the_needle_down_fails(world: World) -> None:
    world.gantry.reported = replace(world.gantry.reported, z_um=4_900.0)
    assert (await _failed(world, {"op": "home"})).kind is FaultCode.NEEDLE_DOWN


async def test_a_homing_that_fails_never_arrives(world: World) -> None:
    world.gantry.failures[0] = Stalled("blocked", device="z")
    ran = begin({"op": "home"})
    with pytest.raises(Stalled):
        await run(world, PROCEDURES["home"], {"op": "home"}, ran)
    assert ran.events == [Event.DEPARTED]


# --- lift ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("z_um", [4_900.0, 5_200.0, 12_500.0])
async def test_a_lift_raises_the_needle_straight_up_and_no_lower_than_it_is(world: World, z_um: float) -> None:
    world.gantry.reported = replace(world.gantry.reported, z_um=z_um)
    before = world.gantry.reported
    ran = await run(world, PROCEDURES["lift"], {"op": "lift"})
    assert ran.events == [Event.DEPARTED, Event.ARRIVED]
    assert ran.got.outcome == "lifted"
    assert ran.got.detail["position"]["z_um"] == max(z_um, 12_000.0)
    assert [move for move, _ in world.gantry.moves] == ([replace(before, z_um=12_000.0)] if z_um < 12_000.0 else [])


async def test_a_lift_of_axes_without_a_reference_moves_nothing(world: World) -> None:
    world.gantry.is_homed = False
    assert (await _failed(world, {"op": "lift"})).kind is FaultCode.NOT_HOMED
    assert world.gantry.moves == []


async def test_a_lift_whose_needle_is_read_to_be_down_says_so(world: World) -> None:
    world.gantry.off_um = (0.0, 0.0, -7_000.0)
    world.gantry.reported = replace(world.gantry.reported, z_um=4_900.0)
    assert (await _failed(world, {"op": "lift"})).kind is FaultCode.NEEDLE_DOWN


# --- place --------------------------------------------------------------------------------------------------------


async def test_place_puts_the_tip_over_a_test_point(world: World) -> None:
    ran = await run(world, PROCEDURES["place"], {"op": "place", "test_point": "A", "theta_deg": 200.0})
    assert world.miss_um("A") == pytest.approx((0.0, 0.0), abs=1e-6)
    assert ran.events == [Event.ACCEPTED, Event.SEEN, Event.ARRIVED]
    assert (ran.got.outcome, ran.got.test_point, ran.job.moves) == ("placed", "A", 1)
    at = ran.got.detail["position"]
    assert at["theta_deg"] == -160.0
    assert at["z_um"] == 5_600.0
    assert [kind for kind, _ in ran.steps] == ["move"]


async def test_place_takes_any_place_of_the_board_and_fiducials(world: World) -> None:
    ran = await run(world, PROCEDURES["place"], {"op": "place", "board_um": [1_000.0, 2_000.0]})
    assert world.tip_um() == pytest.approx((61_000.0, 42_000.0))
    assert ran.got.test_point is None
    await run(world, PROCEDURES["place"], {"op": "place", "test_point": "F"})
    assert world.miss_um("F") == pytest.approx((0.0, 0.0), abs=1e-6)


async def test_a_place_on_a_station_without_a_map_says_that_nobody_saw_it_and_what_to_do(tmp_path: Path) -> None:
    """On a board without layers, too, where no look would follow: what comes next needs the map."""
    world = World(tmp_path, a_board(("A", 20_000.0, 15_000.0)), {}).teach()
    told = (await run(world, PROCEDURES["place"], {"op": "place", "test_point": "A"})).got.detail
    assert told["confirmed_by"] == "drives"
    assert "map from image to robot" in told["unconfirmed"]["message"]
    assert told["unconfirmed"]["advice"] == "`calibrate map`", "its tip is taught"
    world.with_map()
    again = (await run(world, PROCEDURES["place"], {"op": "place", "test_point": "A"})).got.detail
    assert "unconfirmed" not in again


async def test_place_refuses_what_is_unknown_not_homed_or_out_of_reach_before_it_moves(world: World) -> None:
    assert (await _failed(world, {"op": "place", "test_point": "nil"})).kind is FaultCode.UNKNOWN_TEST_POINT
    with pytest.raises(EnvelopeViolation):
        await run(world, PROCEDURES["place"], {"op": "place", "board_um": [1_000.0, 200_000.0]})
    world.gantry.is_homed = False
    ran = begin({"op": "place", "test_point": "A"})
    assert (await _failed(world, {"op": "place", "test_point": "A"}, ran)).kind is FaultCode.NOT_HOMED
    assert ran.job.partial.test_point == "A"
    assert (ran.events, world.gantry.moves) == ([], [])


@pytest.mark.parametrize(
    ("off_um", "good"), [((6.0, 7.0, 3.8), True), ((6.0, 7.0, 4.1), False), ((0, 0, -10.5), False)]
)
async def test_axes_that_stand_elsewhere_than_they_were_sent_are_a_fault(
    world: World, off_um: tuple[float, float, float], good: bool
) -> None:
    world.gantry.off_um = off_um
    request = {"op": "place", "test_point": "A"}
    if good:
        await run(world, PROCEDURES["place"], request)
        return
    fault = await _failed(world, request)
    assert fault.kind is FaultCode.MOTION_FAILED
    assert "10 um" in fault.message


# --- look ---------------------------------------------------------------------------------------------------------


async def test_a_look_at_a_test_point_says_how_far_it_is_and_moves_nothing(world: World) -> None:
    world.teach().with_map()
    world.put_beside("A", (120.0, -50.0))
    ran = await run(world, PROCEDURES["look"], {"op": "look", "test_point": "A"})
    assert ran.got.error_before_um == pytest.approx(130.0, abs=0.02)
    assert (ran.got.detail["dx_um"], ran.got.detail["dy_um"]) == pytest.approx((120.0, -50.0), abs=0.02)
    assert (ran.got.outcome, ran.got.test_point) == ("looked", "A")
    assert ran.events == [Event.ACCEPTED]
    assert world.gantry.moves == []
    assert (ran.job.looks, len(ran.steps)) == (1, 1)


async def test_a_look_at_a_test_point_needs_a_map_and_a_point_that_may_be_touched(world: World) -> None:
    world.teach()
    assert (await _failed(world, {"op": "look", "test_point": "A"})).kind is FaultCode.NOT_CALIBRATED
    world.with_map()
    assert (await _failed(world, {"op": "look", "test_point": "F"})).kind is FaultCode.UNKNOWN_TEST_POINT


async def test_a_free_look_lists_every_pad_round_the_place_below_the_tip(world: World) -> None:
    world.teach().with_map()
    world.put_beside("A", (30.0, 40.0))
    ran = await run(world, PROCEDURES["look"], {"op": "look"})
    (pad,) = ran.got.detail["taken"]
    assert (pad["kind"], pad["rule"]) == ("site", "site_filled")
    assert 800.0 < pad["x_px"] < 810.0
    assert world.station.searches == [Search(BELOW_PX, pytest.approx(1000.0 / 12.0), None)]
    assert ran.steps == [("look", ran.got.detail)]
    assert ran.job.last_look is not None


async def test_without_map_or_probe_a_free_look_takes_frames_all_the_same(world: World) -> None:
    ran = await run(world, PROCEDURES["look"], {"op": "look"})
    assert isinstance(world.station.searches[0], Search)
    assert world.station.searches[0].offset_px == (0.0, 0.0)
    assert "taken" not in ran.got.detail
    assert "tip_px" not in ran.got.detail
    assert ran.got.detail["white_sequence"] == 1
    world.teach()
    world.station.always = lambda seen: seen.__class__(
        seen.white, seen.red, seen.position, NotFound(Reason.NO_NEEDLE, "none"), seen.expected_tip_px
    )
    assert "tip_px" not in (await run(world, PROCEDURES["look"], {"op": "look"})).got.detail


async def test_the_head_is_where_the_drives_say(world: World) -> None:
    world.gantry.reported = Position(1_000.0, 2_000.0, 9_000.0, 5.0)
    ran = await run(world, PROCEDURES["look"], {"op": "look"})
    assert (ran.got.detail["x_um"], ran.got.detail["z_um"]) == (1_000.0, 9_000.0)
