"""A touch goes down slowly onto the measured surface, no deeper than asked, or is refused by name."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_mark import PointMark
from daemon.domain.point_test import PadWear
from daemon.domain.states import Event
from daemon.jobs.context import Touching
from daemon.jobs.held_touch import HeldTouch
from daemon.platform.clock import utc_now
from daemon.procedures.registry import PROCEDURES
from daemon.station.station import Station
from daemon.storage.calibration_records import SurfaceRecord
from drivers.errors import EmergencyStop
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import Ran, ScriptedStation, World, a_board, begin, run
from tests.daemon.tools.report.synthetic import surface_record

TOUCH_Z_UM, SURFACE_UM, PRESS_UM = 5_000.0, 40.0, 300.0
ALIGNED: Mapping[str, Any] = {"board_id": "b17"}
LONG_AGO = "2001-01-01T00:00:00.000+00:00"


class Book:
    """Touches, counted as a journal counts them."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, str | None, str]] = []
        """When, on which board and at which point."""
        self.begun: list[tuple[str, str | None, str]] = []
        self.told: dict[str, Any] = {}
        self.marks: dict[str, PointMark] = {}
        self.pumped = 0
        """Pushes of the pin beside the first of each touch."""

    async def touches_of(self, board_id: str | None, point: str, since: str) -> int:
        return sum(
            its_point == point and ((board_id is not None and its_board == board_id) or at >= since)
            for at, its_board, its_point in self.rows
        )

    async def mark_of(self, _board: str, _side: str, point: str) -> PointMark | None:
        return self.marks.get(point)

    async def wear_of(self, board_id: str | None, point: str, since: str, _visit: str) -> PadWear:
        touches = await self.touches_of(board_id, point, since)
        return PadWear(touches, touches + self.pumped, 0, 0)

    async def begin_touch(self, job_id: str, board_id: str | None, point: str) -> int:
        self.begun.append((job_id, board_id, point))
        self.rows.append((utc_now(), board_id, point))
        return 1

    async def tell_touch(self, number: int, facts: Mapping[str, Any]) -> None:
        assert number == 1
        self.told |= facts


class Holder:
    """Who asks for one touch, and what it hears of it."""

    def __init__(self, key: str = "", book: Book | None = None) -> None:
        self.book, self.made = book or Book(), asyncio.Event()
        self.held = HeldTouch("job-1", key)
        self.touching = Touching(self.held, key, self.book, lambda _contact: self.made.set())

    def begin(self, **fields: Any) -> Ran:
        return begin({"op": "touch", "test_point": "A", **fields}, self.touching)


@pytest.fixture
def world(tmp_path: Path) -> World:
    """A station that knows how high its board lies, with the tip over A, seen to be there."""
    world = World(tmp_path, a_board(("A", 20_000.0, 15_000.0), ("B", 25_000.0, 15_000.0)), {})
    world.teach().with_map().calibrations.store(_surface(world))
    world.height_um = lambda x, y: world.geometry.height_um((x, y))
    _over(world, "A")
    return world


def _surface(world: World) -> SurfaceRecord:
    """Return a surface that was touched all over the board."""
    record = surface_record(raised_um=SURFACE_UM)
    origin, spread = (world.config.board.origin_x_um, world.config.board.origin_y_um), 40_000.0 / 130_000.0
    touches = [
        touch.model_copy(
            update={
                "x_um": origin[0] + (touch.x_um - 200_000.0) * spread,
                "y_um": origin[1] + (touch.y_um - 150_000.0) * spread,
            }
        )
        for touch in record.touches
    ]
    return record.model_copy(update={**world.made(), "touches": tuple(touches)})


def _lay_in(world: World, board_id: str | None) -> None:
    """Align a board, and measure it as it lies."""
    world.with_alignment(world.true_pose, board_id=board_id).calibrations.store(_surface(world))


def _over(world: World, name: str, *, seen: bool = True, key: str = "") -> None:
    world.put_tip(world.pad_um(name))
    at = replace(world.gantry.reported, z_um=world.geometry.look_z_um(world.pad_um(name)))
    world.gantry.reported = world.gantry.actual = at
    world.station.needle.reported(at)
    world.station.needle.stand.came(name, key, at, seen=seen)


def _surface_z_um(world: World) -> float:
    return TOUCH_Z_UM + world.geometry.height_um(world.tip_um())


async def _touch(world: World, tester: Holder, **fields: Any) -> Ran:
    return await run(world, PROCEDURES["touch"], {}, tester.begin(**fields))


async def _refused(world: World, tester: Holder, **fields: Any) -> Fault:
    begun = list(tester.book.begun)
    world.gantry.moves.clear()
    with pytest.raises(Fault) as caught:
        await _touch(world, tester, **fields)
    assert world.gantry.moves == [], "it moved"
    assert tester.book.begun == begun
    return caught.value


async def test_it_goes_down_to_the_surface_less_the_press_and_comes_back_up(world: World) -> None:
    tester, start = Holder(), world.gantry.reported
    ran = await _touch(world, tester)
    (down, _), (up, _) = world.gantry.moves
    assert down == replace(start, z_um=pytest.approx(_surface_z_um(world) - PRESS_UM))
    assert up == start
    assert ran.events == [Event.ACCEPTED, Event.SEEN, Event.ARRIVED, Event.OFF_TARGET, Event.ARRIVED]
    assert (ran.got.outcome, ran.got.detail["ended_by"]) == ("touched", "at_once")
    assert ran.got.detail["contact"]["pressed_um"] == pytest.approx(PRESS_UM, abs=0.1)
    assert tester.made.is_set()
    assert tester.book.begun == [("job-1", None, "A")]
    assert tester.book.told == {
        "z_end_um": pytest.approx(down.z_um, abs=0.01), "pressed_um": pytest.approx(PRESS_UM, abs=0.1),
        "force_n": pytest.approx(0.3 + 0.6 * 0.3), "speed_um_s": world.config.gantry.descent_speed,
        "ended_by": "at_once",
    }  # fmt: skip


async def test_it_goes_slowly_from_above_where_the_board_may_be(world: World) -> None:
    await _touch(world, Holder())
    approach_um = world.config.touch.approach_um
    assert world.gantry.slow_z_um[0] >= _surface_z_um(world) + approach_um - 1e-6


async def test_a_request_says_how_far_the_pin_is_pushed_in_up_to_the_most_that_is_allowed(world: World) -> None:
    ran = await _touch(world, Holder(), press_um=120.0)
    assert ran.got.detail["contact"]["pressed_um"] == pytest.approx(120.0, abs=0.1)
    world.gantry.moves.clear()
    _over(world, "A")
    assert (await _refused(world, Holder(), press_um=301.0)).kind is FaultCode.INVALID_REQUEST


async def test_the_lamps_are_off_while_the_needle_is_down(world: World) -> None:
    await _touch(world, Holder())
    assert world.lights.log[-1].name == "OFF"


@pytest.mark.parametrize("name", ["B", "A"])
async def test_a_point_is_refused_over_which_this_client_has_not_put_the_head(world: World, name: str) -> None:
    key = "another" if name == "A" else ""
    assert (await _refused(world, Holder(key), test_point=name)).kind is FaultCode.NOT_AT_TEST_POINT


async def test_a_board_whose_height_nobody_measured_is_refused(tmp_path: Path) -> None:
    world = World(tmp_path, a_board(("A", 20_000.0, 15_000.0)), {}).teach().with_map()
    _over(world, "A")
    assert (await _refused(world, Holder())).kind is FaultCode.SURFACE_UNKNOWN


async def test_axes_that_are_not_homed_are_refused(world: World) -> None:
    world.gantry.is_homed = False
    assert (await _refused(world, Holder())).kind is FaultCode.NOT_HOMED


async def test_a_board_that_was_not_aligned_is_refused(world: World) -> None:
    assert (await _refused(world, Holder(), **ALIGNED)).kind is FaultCode.NOT_ALIGNED


async def test_a_point_that_was_pressed_before_must_have_been_seen_since(world: World) -> None:
    _over(world, "A", seen=False)
    book = Book()
    assert (await _touch(world, Holder(book=book))).got.outcome == "touched"
    assert (await _refused(world, Holder(book=book))).kind is FaultCode.LOOK_NEEDED
    _over(world, "A", seen=True)
    assert (await _touch(world, Holder(book=book))).got.outcome == "touched"
    assert (await _refused(world, Holder(book=book))).kind is FaultCode.LOOK_NEEDED, "the press used the look up"


@pytest.mark.parametrize(("first", "then"), [(ALIGNED, {}), ({}, ALIGNED)])
async def test_who_leaves_out_the_board_that_was_aligned_needs_a_look_all_the_same(
    world: World, first: Mapping[str, Any], then: Mapping[str, Any]
) -> None:
    _lay_in(world, "b17")
    _over(world, "A")
    book = Book()
    ran = await _touch(world, Holder(book=book), **first)
    assert (ran.got.detail["contact"]["board_id"], ran.got.detail["touches_of_pad"]) == ("b17", 1)
    _over(world, "A", seen=False)
    assert (await _refused(world, Holder(book=book), **then)).kind is FaultCode.LOOK_NEEDED


async def test_to_be_aligned_again_does_not_make_a_pressed_pad_of_a_named_board_a_new_one(world: World) -> None:
    book = Book()
    book.rows.append((LONG_AGO, "b17", "A"))
    _lay_in(world, "b17")
    _over(world, "A", seen=False)
    assert (await _refused(world, Holder(book=book))).kind is FaultCode.LOOK_NEEDED
    _lay_in(world, None)
    assert (await _touch(world, Holder(book=book))).got.outcome == "touched", "a board that nobody named may be new"


async def test_a_first_touch_may_go_by_calibration_alone(world: World) -> None:
    _over(world, "A", seen=False)
    assert (await _touch(world, Holder())).got.outcome == "touched"


async def test_a_point_that_a_person_forbade_is_not_touched_until_it_is_approved_again(world: World) -> None:
    book = Book()
    book.marks["A"] = PointMark(point="A", mark="forbidden", reason="its trace lifts", by="Kim", at=LONG_AGO)
    fault = await _refused(world, Holder(book=book))
    assert fault.kind is FaultCode.POINT_FORBIDDEN
    assert ("Kim" in fault.message, fault.detail["reason"]) == (True, "its trace lifts")
    book.marks["A"] = book.marks["A"].model_copy(update={"mark": "approved"})
    assert (await _touch(world, Holder(book=book))).got.outcome == "touched"


@pytest.mark.parametrize("named", [ALIGNED, {}])
async def test_a_pad_of_a_board_is_touched_so_often_and_no_more(world: World, named: Mapping[str, Any]) -> None:
    _lay_in(world, "b17")
    _over(world, "A")
    book, most = Book(), world.config.touch.touches_per_pad
    book.rows += [(LONG_AGO, "b17", "A")] * (most - 1) + [(LONG_AGO, "b18", "A"), (LONG_AGO, "b17", "B")]
    ran = await _touch(world, Holder(book=book), **named)
    assert ran.got.detail["touches_of_pad"] == most
    _over(world, "A")
    spent = await _refused(world, Holder(book=book), **named)
    assert (spent.kind, spent.detail["touches"]) == (FaultCode.TOUCH_BUDGET_SPENT, most)


async def test_a_pad_that_was_pumped_as_often_as_it_may_be_is_not_touched_again(world: World) -> None:
    _lay_in(world, "b17")
    _over(world, "A")
    book = Book()
    book.rows, book.pumped = [(LONG_AGO, "b17", "A")] * 2, 6
    spent = await _refused(world, Holder(book=book), **ALIGNED)
    assert (spent.kind, spent.detail["presses"]) == (FaultCode.TOUCH_BUDGET_SPENT, 8)


async def test_a_board_that_lies_higher_than_it_was_measured_is_not_pressed(world: World) -> None:
    """The pin is pushed in already where it should hover: by hand, another board was put in."""
    measured = world.height_um
    world.height_um = lambda x, y: measured(x, y) + 350.0
    tester = Holder()
    with pytest.raises(Fault) as caught:
        await _touch(world, tester)
    assert caught.value.kind is FaultCode.WRONG_HEIGHT
    assert tester.book.begun == []
    assert all(target.z_um > world.gantry.config.gantry.work_z_um for target, _ in world.gantry.moves)


async def _asked(world: World, monkeypatch: pytest.MonkeyPatch, times: int) -> None:
    """Wait until the drives were asked for their reference so often."""
    enough, left = asyncio.Event(), times

    async def homed(_deadline: Any) -> bool:
        nonlocal left
        left -= 1
        if left == 0:
            enough.set()
        return True

    monkeypatch.setattr(world.gantry, "homed", homed)
    await enough.wait()


async def test_a_held_needle_stays_until_it_is_lifted_and_the_drives_are_asked_meanwhile(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    tester = Holder()
    job = asyncio.create_task(_touch(world, tester, hold_ms=60_000, lease_ms=30_000))
    await tester.made.wait()
    assert tester.held.contact is not None
    await _asked(world, monkeypatch, times=3)
    assert len(world.gantry.moves) == 1, "it moved while it was held"
    tester.held.lift("", {"verdict": "pass", "value": 0.4, "unit": "ohm"})
    got = (await job).got
    assert (got.detail["ended_by"], got.detail["measured"]["value"]) == ("lift", 0.4)
    assert tester.book.told["verdict"] == "pass"
    assert world.gantry.reported.z_um == pytest.approx(world.geometry.look_z_um(world.tip_um()))


async def test_a_verdict_is_kept_also_where_the_way_up_fails(world: World) -> None:
    world.gantry.failures[2] = EmergencyStop("the stop was pressed", device="z")
    tester = Holder()
    tester.held.lift("", {"verdict": "pass"})
    with pytest.raises(EmergencyStop):
        await _touch(world, tester, hold_ms=60_000, lease_ms=30_000)
    assert (tester.book.told["ended_by"], tester.book.told["verdict"]) == ("lift", "pass")


async def test_what_is_measured_is_heard_until_the_needle_is_up_and_not_after_that(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    tester, move_to = Holder(), world.gantry.move_to

    async def rising(*args: Any, **also: Any) -> Position:
        if world.gantry.moves:
            tester.held.lift("", {"verdict": "pass"})
        return await move_to(*args, **also)

    monkeypatch.setattr(world.gantry, "move_to", rising)
    got = (await _touch(world, tester)).got
    tester.held.lift("", {"verdict": "open"})
    assert (got.detail["ended_by"], got.detail["measured"]) == ("at_once", {"verdict": "pass"})
    assert tester.held.measured == tester.held.close() == {"verdict": "pass"}


async def test_a_lease_that_nobody_renews_ends_the_touch_in_a_fault_with_the_needle_up(world: World) -> None:
    tester = Holder()
    with pytest.raises(Fault) as caught:
        await _touch(world, tester, hold_ms=60_000, lease_ms=200)
    assert caught.value.kind is FaultCode.LEASE_EXPIRED
    assert world.station.needle.is_up
    assert tester.book.told["ended_by"] == "lease_expired"


async def test_an_emergency_stop_is_noticed_while_the_needle_is_held(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    tester = Holder()
    job = asyncio.create_task(_touch(world, tester, hold_ms=60_000, lease_ms=30_000))
    await tester.made.wait()

    async def lost(_deadline: Any) -> bool:
        raise EmergencyStop("the stop was pressed", device="z")

    monkeypatch.setattr(world.gantry, "homed", lost)
    with pytest.raises(EmergencyStop):
        await job
    assert len(world.gantry.moves) == 1, "nothing is moved by the job itself"


async def _goes_aside(world: World, station: Station) -> Position:
    """Return where the head stands after a move sideways."""
    aside = replace(world.gantry.reported, x_um=world.gantry.reported.x_um + 3_000.0)
    return await station.go(aside, begin({"op": "look"}).job)


@pytest.mark.parametrize("reloaded", [False, True])
async def test_after_a_touch_nothing_moves_sideways_before_the_pin_was_seen_free(world: World, reloaded: bool) -> None:
    await _touch(world, Holder())
    lifted = world.gantry.actual
    world.gantry.sticks_at_um = world.gantry.reported.z_um - 500.0
    world.gantry.actual = replace(world.gantry.reported, z_um=world.gantry.sticks_at_um)
    station = world.station
    if reloaded:  # the devices were opened again, or the configuration was read again: the pin is pushed in as before
        station = ScriptedStation(world, station.needle)
        station.needle.adopt(world.geometry.up_z_um, world.geometry.surface_z_um)
    with pytest.raises(Fault) as caught:
        await _goes_aside(world, station)
    assert caught.value.kind is FaultCode.AXIS_STALLED
    world.gantry.sticks_at_um, world.gantry.actual = None, lifted
    went = await _goes_aside(world, station)
    assert went.x_um == pytest.approx(lifted.x_um + 3_000.0), "it was seen free"
