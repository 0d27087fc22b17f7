"""A station's frames are exposed after light and head have settled; its moves and waits are booked and bounded."""

from __future__ import annotations

import asyncio
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from daemon.config.model import Config, load_config
from daemon.domain.errors import Fault, FaultCode
from daemon.platform.clock import Stopwatch
from daemon.station import station as module
from daemon.station import tip_search
from daemon.station.allowance import Allowance
from daemon.station.free_pin import FreePin
from daemon.station.needle import NeedlePlace
from daemon.station.station import CrossSearch, Search, Station
from drivers.deadline import Deadline
from drivers.errors import EnvelopeViolation, Stalled
from drivers.gantry import Position
from drivers.lights import Light
from tests.daemon.procedures.fake_station import (
    EXAMPLE,
    FakeCamera,
    FakeGantry,
    FakeLights,
    found_tip,
    hardware,
    missing,
    pose_map,
    probe_model,
)
from tests.daemon.procedures.fake_station import a_board as board
from vision import KnownTip, Reason, Tip

HERE = Position(50_000.0, 40_000.0, 5_200.0, 0.0)


class Bench:
    """A station on fake devices, and a caller with an hour to spend."""

    def __init__(self, **gantry: Any) -> None:
        config: Config = load_config(EXAMPLE)
        self.config = config.model_copy(update={"gantry": config.gantry.model_copy(update=gantry)})
        self.gantry, self.lights, self.camera = FakeGantry(config, HERE, HERE), FakeLights(), FakeCamera()
        self.camera.pixels = np.zeros((1200, 1600, 3), dtype=np.uint8)
        self.hardware = hardware(self.gantry, self.lights, self.camera)
        self.station = Station(self.config, self.hardware)
        self.caller = Allowance(Deadline.after(3_600.0), Stopwatch())

        self.station.needle.reported(HERE)

    def booked_ms(self, what: str) -> float | None:
        return self.caller.watch.timing_ms()["triggered"].get(what)


@pytest.fixture
def bench() -> Bench:
    return Bench()


# --- moves --------------------------------------------------------------------------------------------------------


async def test_a_move_goes_to_its_target_under_the_callers_deadline_and_is_booked(bench: Bench) -> None:
    target = replace(HERE, x_um=51_000.0)
    assert await bench.station.go(target, bench.caller) == target
    assert await bench.station.go(HERE, bench.caller, from_above=frozenset({"y"})) == HERE
    assert bench.gantry.moves == [(target, frozenset()), (HERE, {"y"})]
    assert bench.gantry.asked == [bench.caller.deadline] * 2
    assert bench.booked_ms("motion") is not None
    assert bench.booked_ms("bus") is None


BESIDE = [replace(HERE, x_um=50_010.0), replace(HERE, y_um=39_990.0), replace(HERE, theta_deg=1.0)]


@pytest.mark.parametrize("target", BESIDE)
async def test_while_the_needle_is_down_nothing_goes_sideways(bench: Bench, target: Position) -> None:
    pressed = replace(HERE, z_um=4_900.0)
    await bench.station.go(pressed, bench.caller)
    for way in (target, replace(target, z_um=4_900.0), replace(target, z_um=12_000.0)):
        with pytest.raises(Fault) as caught:
            await bench.station.go(way, bench.caller)
        assert caught.value.kind is FaultCode.NEEDLE_DOWN
    assert [move for move, _ in bench.gantry.moves] == [pressed]
    await bench.station.go(replace(HERE, z_um=4_800.0), bench.caller)
    await bench.station.go(replace(HERE, z_um=12_000.0), bench.caller)
    await bench.station.go(target, bench.caller)
    assert len(bench.gantry.moves) == 4, "straight down and straight up it may go, and once it is up anywhere"


@pytest.mark.parametrize("target", BESIDE)
async def test_while_nothing_is_known_of_the_needle_it_is_read_before_anything_goes_sideways(
    bench: Bench, target: Position
) -> None:
    bench.station.needle.forget()
    bench.gantry.reported = replace(HERE, z_um=4_900.0)
    with pytest.raises(Fault) as caught:
        await bench.station.go(target, bench.caller)
    assert caught.value.kind is FaultCode.NEEDLE_DOWN
    assert bench.gantry.moves == []
    bench.station.needle.forget()
    bench.gantry.reported = HERE
    await bench.station.go(target, bench.caller)


async def test_a_descent_that_fails_leaves_the_needle_down_until_it_is_read_to_be_up(bench: Bench) -> None:
    bench.gantry.failures[1] = Stalled("stuck", device="z")
    with pytest.raises(Stalled):
        await bench.station.go(replace(HERE, z_um=4_900.0), bench.caller)
    assert bench.station.needle.may_be_down
    assert bench.station.needle.z_um is None
    await bench.station.retract(Deadline.after(60.0))
    assert bench.station.needle.is_up


async def test_after_homing_the_needle_is_where_the_drives_say(bench: Bench) -> None:
    bench.gantry.reported = replace(HERE, z_um=30_000.0)
    await bench.station.home(bench.caller)
    assert (bench.station.needle.place, bench.station.needle.z_um) == (NeedlePlace.UP, 30_000.0)
    bench.gantry.failures[0] = Stalled("stuck", device="x")
    with pytest.raises(Stalled):
        await bench.station.home(bench.caller)
    assert bench.station.needle.place is NeedlePlace.UNKNOWN


async def test_only_homing_that_came_to_its_end_stands_for_a_pin_that_was_seen_free(bench: Bench) -> None:
    free = FreePin(probe_model(), (800.0, 620.0), 2.0, 5_200.0)
    bench.station.pressing(free)
    bench.gantry.failures[0] = Stalled("stuck", device="x")
    with pytest.raises(Stalled):
        await bench.station.home(bench.caller)
    assert bench.station.needle.free_pin is free
    bench.gantry.failures.clear()
    await bench.station.home(bench.caller)
    assert bench.station.needle.free_pin is None


# --- a needle that the last look did not show ----------------------------------------------------------------------

SIDEWAYS = replace(HERE, x_um=60_000.0)
AT_TAUGHT, PUSHED = found_tip(800.0, 600.0), found_tip(800.0, 560.0)
HIDDEN = missing(Reason.NO_NEEDLE)


def _seeing(bench: Bench, monkeypatch: pytest.MonkeyPatch, *tips: Any) -> None:
    """Have looks find these, one after the other, the last for good; there is a map."""
    found = list(tips)
    monkeypatch.setattr("daemon.station.tip_search.find_tip", lambda *_: found.pop(0) if len(found) > 1 else found[0])
    bench.station.needle.taught_free = lambda: FreePin(probe_model(), (800.0, 600.0), 2.0, 12_000.0)


async def test_where_the_last_look_did_not_show_the_tip_it_is_seen_free_above_before_anything_goes_sideways(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its Z may stand lower than it counts, and the pin be pressed."""
    _seeing(bench, monkeypatch, HIDDEN, AT_TAUGHT)
    await bench.station.look_white(HERE, probe_model(), None, bench.caller)
    await bench.station.go(SIDEWAYS, bench.caller)
    assert [to for to, _ in bench.gantry.moves] == [replace(HERE, z_um=12_000.0), SIDEWAYS]
    await bench.station.go(HERE, bench.caller)
    assert len(bench.gantry.moves) == 3, "once it was seen it is not asked again"


@pytest.mark.parametrize(("tip", "kind"), [(PUSHED, FaultCode.AXIS_STALLED), (HIDDEN, FaultCode.TIP_NOT_FOUND)])
async def test_a_needle_that_is_seen_pressed_or_not_at_all_goes_nowhere_until_it_is_homed(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, tip: Any, kind: FaultCode
) -> None:
    _seeing(bench, monkeypatch, HIDDEN, tip)
    await bench.station.look_white(HERE, probe_model(), None, bench.caller)
    for _ in range(2):
        with pytest.raises(Fault) as caught:
            await bench.station.go(SIDEWAYS, bench.caller)
        assert caught.value.kind is kind
    assert {(to.x_um, to.y_um) for to, _ in bench.gantry.moves} == {(HERE.x_um, HERE.y_um)}
    await bench.station.home(bench.caller)
    await bench.station.go(SIDEWAYS, bench.caller)


@pytest.mark.parametrize("tips", [(HIDDEN, AT_TAUGHT), (missing(Reason.TOO_DARK), missing(Reason.TOO_DARK))])
async def test_a_tip_that_the_next_look_shows_or_a_picture_that_is_no_good_puts_no_needle_in_doubt(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, tips: Any
) -> None:
    _seeing(bench, monkeypatch, *tips)
    for _ in range(2):
        await bench.station.look_white(HERE, probe_model(), None, bench.caller)
    await bench.station.go(SIDEWAYS, bench.caller)
    assert [to for to, _ in bench.gantry.moves] == [SIDEWAYS]


async def test_a_tip_that_is_carried_to_where_the_ground_hides_it_puts_no_needle_in_doubt(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stands at its free place, and homing ends that it may be carried: the needle may be another one then."""
    _seeing(bench, monkeypatch, AT_TAUGHT, HIDDEN)
    monkeypatch.setattr(KnownTip, "carried_to", lambda *_: AT_TAUGHT)
    model = probe_model()
    for _ in range(3):
        look = await bench.station.look_white(HERE, model, None, bench.caller)
        assert look.tip is AT_TAUGHT
    await bench.station.go(SIDEWAYS, bench.caller)
    assert [to for to, _ in bench.gantry.moves] == [SIDEWAYS]
    await bench.station.home(bench.caller)
    assert (await bench.station.look_white(HERE, model, None, bench.caller)).tip is HIDDEN


@pytest.mark.parametrize("measured", [False, True])
@pytest.mark.parametrize("white_only", [False, True])
async def test_a_look_for_a_calibration_has_the_tip_measured(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, measured: bool, white_only: bool
) -> None:
    _seeing(bench, monkeypatch, AT_TAUGHT, HIDDEN)
    monkeypatch.setattr(KnownTip, "carried_to", lambda *_: AT_TAUGHT)
    monkeypatch.setattr("daemon.station.station.find_test_points", lambda *_a, **_k: object())
    model = probe_model()
    await bench.station.look_white(HERE, model, None, bench.caller)
    look: Any
    if white_only:
        look = await bench.station.look_white(HERE, model, None, bench.caller, measured=measured)
    else:
        look = await bench.station.look(HERE, model, ANYWHERE, bench.caller, measured=measured)
    assert look.tip is (HIDDEN if measured else AT_TAUGHT)


async def test_a_pushed_pin_whose_tip_is_carried_is_not_dragged(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    _seeing(bench, monkeypatch, AT_TAUGHT, HIDDEN)
    monkeypatch.setattr(KnownTip, "carried_to", lambda *_: PUSHED)
    model = probe_model()
    await bench.station.look_white(HERE, model, None, bench.caller)
    bench.station.pressing(FreePin(model, (800.0, 600.0), 2.0, 12_000.0))
    with pytest.raises(Fault) as caught:
        await bench.station.go(SIDEWAYS, bench.caller)
    assert caught.value.kind is FaultCode.AXIS_STALLED
    assert {(to.x_um, to.y_um) for to, _ in bench.gantry.moves} == {(HERE.x_um, HERE.y_um)}


@pytest.mark.parametrize(
    ("then", "now", "off_px", "goes"),
    [(False, False, 2.5, False), (True, False, 2.5, True), (False, True, 2.5, True), (True, True, 4.0, False)],
)
async def test_a_tip_known_by_its_marking_is_free_within_what_that_tells(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, then: bool, now: bool, off_px: float, goes: bool
) -> None:
    """It tells to 2 px, and a pin that was not lifted stands 13 px off: the first must not be called a stalled Z."""
    seen = replace(found_tip(800.0 + off_px, 600.0), by_marking=now)
    _seeing(bench, monkeypatch, seen)
    free = FreePin(probe_model(), (800.0, 600.0), 1.7, 12_000.0, roughly_px=3.4, by_marking=then)
    bench.station.pressing(free)
    if goes:
        await bench.station.go(SIDEWAYS, bench.caller)
        assert bench.station.needle.free_pin is None
        return
    with pytest.raises(Fault) as caught:
        await bench.station.go(SIDEWAYS, bench.caller)
    assert caught.value.kind is FaultCode.AXIS_STALLED


async def test_a_target_out_of_reach_is_refused(bench: Bench) -> None:
    outside = replace(HERE, x_um=-1.0)
    with pytest.raises(EnvelopeViolation):
        await bench.station.go(outside, bench.caller)
    with pytest.raises(EnvelopeViolation):
        bench.station.check(outside)
    bench.station.check(HERE)
    assert bench.gantry.moves == []


@pytest.mark.parametrize(("z_um", "moves"), [(5_205.0, 0), (5_195.0, 0), (5_205.1, 1), (5_194.9, 1), (12_000.0, 1)])
async def test_z_is_brought_to_a_height_unless_it_is_there(bench: Bench, z_um: float, moves: int) -> None:
    at = replace(HERE, z_um=z_um, theta_deg=7.0)
    reached = await bench.station.to_height(at, 5_200.0, bench.caller)
    assert reached == (replace(at, z_um=5_200.0) if moves else at)
    assert len(bench.gantry.moves) == moves


async def test_homing_is_a_motion_and_is_asked_of_the_drives(bench: Bench) -> None:
    await bench.station.home(bench.caller)
    assert bench.gantry.homings == 1
    assert bench.booked_ms("motion") is not None
    await bench.station.require_homed(bench.caller)
    bench.gantry.is_homed = False
    with pytest.raises(Fault) as caught:
        await bench.station.require_homed(bench.caller)
    assert caught.value.kind is FaultCode.NOT_HOMED


async def test_the_drives_are_asked_for_two_seconds_at_most(bench: Bench) -> None:
    await bench.station.require_homed(bench.caller)
    assert bench.gantry.asked[-1].at_s <= time.monotonic() + 2.0
    soon = Allowance(Deadline.after(0.5), Stopwatch())
    await bench.station.require_homed(soon)
    assert bench.gantry.asked[-1] == soon.deadline


async def test_the_position_is_what_the_drives_say(bench: Bench) -> None:
    assert await bench.station.position(bench.caller) == HERE
    assert bench.gantry.asked == [bench.caller.deadline]
    assert bench.booked_ms("bus") is not None


@pytest.mark.parametrize(("z_um", "moves"), [(11_999.0, 1), (12_000.0, 0), (15_000.0, 0)])
async def test_the_needle_is_lifted_to_the_safe_height_if_it_is_lower(bench: Bench, z_um: float, moves: int) -> None:
    bench.gantry.reported = replace(HERE, z_um=z_um)
    await bench.station.retract(bench.caller.deadline)
    assert bench.gantry.moves == [(replace(HERE, z_um=12_000.0), frozenset())] * moves


async def test_stop_reaches_the_axes(bench: Bench) -> None:
    await bench.station.stop()
    assert bench.gantry.stopped == 1


def test_exchanges_are_those_of_all_lines(bench: Bench) -> None:
    assert bench.station.exchanges == 0
    lines = {name: SimpleNamespace(statistics=SimpleNamespace(requests=n)) for name, n in (("a", 3), ("b", 4))}
    bench.hardware.buses = cast("Any", lines)
    assert bench.station.exchanges == 7


# --- light and frames ---------------------------------------------------------------------------------------------


async def test_lamps_are_switched_under_the_callers_deadline(bench: Bench) -> None:
    await bench.station.prepare_white(bench.caller)
    await bench.station.lights_off(bench.caller)
    assert bench.lights.log == [Light.WHITE, Light.OFF]
    assert bench.lights.asked == [bench.caller.deadline] * 2
    assert bench.booked_ms("bus") is not None


async def test_a_frame_is_exposed_after_its_light_has_settled(bench: Bench) -> None:
    bench.lights.settle_s = 5.0
    before_s = time.monotonic()
    await bench.station.capture(Light.RED, bench.caller)
    ((ready_s, deadline),) = bench.camera.asked
    assert bench.lights.log == [Light.RED]
    assert before_s + 5.0 <= ready_s <= time.monotonic() + 5.0
    # A frame may take what is left to wait, and the camera's own patience.
    assert before_s + 5.0 + 3.0 <= deadline.at_s <= time.monotonic() + 5.0 + 3.0
    assert bench.booked_ms("light") == pytest.approx(5_000.0, abs=500.0)


@pytest.mark.parametrize("what", ["go", "home", "failed go"])
async def test_a_frame_is_exposed_after_the_head_has_come_to_rest(what: str) -> None:
    bench = Bench(settle_ms=9_000.0)
    before_s = time.monotonic()
    if what == "home":
        await bench.station.home(bench.caller)
    elif what == "go":
        await bench.station.go(HERE, bench.caller)
    else:
        bench.gantry.failures[1] = Stalled("blocked", device="x")
        with pytest.raises(Stalled):
            await bench.station.go(HERE, bench.caller)
    moved_s = time.monotonic()
    await bench.station.capture(Light.WHITE, bench.caller)
    ((ready_s, _),) = bench.camera.asked
    assert before_s + 9.0 <= ready_s <= moved_s + 9.0


async def test_waiting_for_the_exposure_is_booked_apart_from_the_light(bench: Bench) -> None:
    bench.lights.settle_s = 2.0
    bench.camera.late_s = 0.75
    await bench.station.capture(Light.WHITE, bench.caller)
    assert bench.booked_ms("exposure") == pytest.approx(750.0, abs=1.0)


async def test_where_all_is_settled_the_exposure_is_booked_from_when_it_was_asked_for() -> None:
    bench = Bench(settle_ms=0.0)
    bench.lights.settle_s = -100.0
    bench.camera.late_s = 104.0
    await bench.station.go(HERE, bench.caller)
    await bench.station.capture(Light.WHITE, bench.caller)
    ((ready_s, _),) = bench.camera.asked
    assert bench.booked_ms("light") == 0.0
    assert bench.booked_ms("exposure") == pytest.approx((ready_s + 104.0 - time.monotonic()) * 1e3, abs=500.0)


async def test_a_frame_is_not_waited_for_beyond_the_callers_deadline(bench: Bench) -> None:
    soon = Allowance(Deadline.after(0.5), Stopwatch())
    await bench.station.capture(Light.WHITE, soon)
    assert bench.camera.asked[0][1] == soon.deadline


# --- looks --------------------------------------------------------------------------------------------------------


class Eyes:
    """Vision that answers as told; what it was asked is kept."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, tip: Any) -> None:
        self.asked: list[tuple[str, Any]] = []
        self.tip, self.seen, self.cross = tip, object(), object()
        monkeypatch.setattr(tip_search, "find_tip", self._tip)
        monkeypatch.setattr(module, "find_test_points", self._pads)
        monkeypatch.setattr(module, "find_control_point", self._cross)

    def _tip(self, _pixels: Any, model: Any) -> Any:
        self.asked.append(("tip", model))
        return self.tip

    def _pads(self, _pixels: Any, **how: Any) -> Any:
        self.asked.append(("pads", how))
        return self.seen

    def _cross(self, _pixels: Any, *how: Any) -> Any:
        self.asked.append(("cross", how))
        return self.cross


async def test_a_look_finds_the_tip_in_white_and_the_pads_round_the_place_below_it_in_red(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    tip, model = found_tip(810.0, 600.0), probe_model()
    eyes = Eyes(monkeypatch, tip)
    look = await bench.station.look(HERE, model, Search((3.0, -7.0), 60.0, 21.0), bench.caller)
    assert bench.lights.log == [Light.WHITE, Light.RED]
    assert look.red is not None
    assert (look.white.sequence, look.red.sequence) == (1, 2)
    assert (look.tip, look.seen, look.cross) == (tip, eyes.seen, None)
    assert (look.position, look.expected_tip_px) == (HERE, model.tip_px)
    how = {"around_px": (813.0, 593.0), "reach_px": 60.0, "expected_radius_px": 21.0, "needle": tip}
    assert eyes.asked == [("tip", model), ("pads", how)]


async def test_without_a_tip_no_pads_are_searched(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    eyes = Eyes(monkeypatch, missing(Reason.NO_NEEDLE))
    look = await bench.station.look(HERE, probe_model(), Search((0.0, 0.0), 60.0, None), bench.caller)
    assert (look.tip, look.seen) == (eyes.tip, None)
    untaught = await bench.station.look(HERE, None, Search((0.0, 0.0), 60.0, None), bench.caller)
    assert (untaught.tip, untaught.seen, untaught.expected_tip_px) == (None, None, None)
    assert [what for what, _ in eyes.asked] == ["tip"]


async def test_a_white_look_finds_the_cross_round_the_place_below_the_tip(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    eyes = Eyes(monkeypatch, found_tip(810.0, 600.0))
    model = probe_model()
    look = await bench.station.look_white(HERE, model, CrossSearch((3.0, -7.0), 60.0, 55.0), bench.caller)
    assert bench.lights.log == [Light.WHITE]
    assert (look.red, look.cross, look.position) == (None, eyes.cross, HERE)
    assert eyes.asked == [("tip", model), ("cross", ((813.0, 593.0), 60.0, 55.0))]


@pytest.mark.parametrize("lost", [True, False])
async def test_a_cross_is_searched_only_if_it_is_asked_for_and_there_is_a_tip(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, lost: bool
) -> None:
    eyes = Eyes(monkeypatch, missing(Reason.BENT) if lost else found_tip(810.0, 600.0))
    search = CrossSearch((0.0, 0.0), 60.0, 55.0) if lost else None
    look = await bench.station.look_white(HERE, probe_model(), search, bench.caller)
    assert look.cross is None
    assert isinstance(look.tip, Tip) is not lost
    assert [what for what, _ in eyes.asked] == ["tip"]


async def test_a_look_whose_red_frame_fails_leaves_no_search_behind(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    Eyes(monkeypatch, found_tip(810.0, 600.0))

    async def fails(_t_s: float, _deadline: Deadline) -> Any:
        raise Stalled("no frame", device="camera")

    bench.camera.arrives[1] = asyncio.Event()
    expose = bench.camera.exposed_after

    async def fails_second(t_s: float, deadline: Deadline) -> Any:
        return await (fails if bench.camera.asked else expose)(t_s, deadline)

    monkeypatch.setattr(bench.camera, "exposed_after", fails_second)
    with pytest.raises(Stalled):
        await bench.station.look(HERE, probe_model(), Search((0.0, 0.0), 60.0, None), bench.caller)
    await asyncio.sleep(0)
    assert len(asyncio.all_tasks()) == 1


ANYWHERE = Search((0.0, 0.0), 60.0, None)


async def test_red_is_switched_as_soon_as_white_is_exposed_before_its_picture_has_arrived(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    eyes = Eyes(monkeypatch, found_tip(810.0, 600.0))
    white, exposed = asyncio.Event(), asyncio.Event()
    bench.camera.arrives[1] = white
    expose = bench.camera.exposed_after

    async def told(t_s: float, deadline: Deadline) -> Any:
        if bench.camera.asked:
            exposed.set()
        return await expose(t_s, deadline)

    monkeypatch.setattr(bench.camera, "exposed_after", told)
    looking = asyncio.create_task(bench.station.look(HERE, probe_model(), ANYWHERE, bench.caller))
    await exposed.wait()
    assert bench.lights.log == [Light.WHITE, Light.RED]
    assert eyes.asked == []
    white.set()
    look = await looking
    assert look.red is not None
    assert (look.white.sequence, look.red.sequence) == (1, 2)
    assert [what for what, _ in eyes.asked] == ["tip", "pads"]


@pytest.mark.parametrize("moves_next", [False, True])
@pytest.mark.parametrize(
    ("lost", "frames", "lamps"),
    [
        ({1}, (3, 2), [Light.WHITE]),
        ({2}, (1, 3), [Light.RED]),
        ({1, 2}, (3, 4), [Light.WHITE, Light.RED]),
    ],
)
async def test_a_frame_that_is_lost_is_taken_anew_under_its_own_light_and_the_other_one_is_kept(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, lost: set[int], frames: tuple[int, int], lamps: list[Light],
    *, moves_next: bool,
) -> None:  # fmt: skip
    """It should never search the tip, or a pad, in a picture of another light."""
    eyes = Eyes(monkeypatch, found_tip(810.0, 600.0))
    bench.camera.lost = lost
    look = await bench.station.look(HERE, probe_model(), ANYWHERE, bench.caller, moves_next=moves_next)
    ahead = [Light.WHITE] if moves_next else []
    assert bench.lights.log == [Light.WHITE, Light.RED, *ahead, *lamps]
    assert look.red is not None
    assert (look.white.sequence, look.red.sequence) == frames
    assert [what for what, _ in eyes.asked] == ["tip", "pads"]


async def test_before_a_move_white_is_lit_and_the_drives_are_asked_while_the_search_goes_on(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    eyes = Eyes(monkeypatch, found_tip(810.0, 600.0))
    asked = threading.Event()
    position = bench.gantry.position

    async def told(deadline: Deadline) -> Position:
        asked.set()
        return await position(deadline)

    def searches(_pixels: Any, **_how: Any) -> Any:
        assert asked.wait(30.0), "the search is over only when they were asked"
        return eyes.seen

    monkeypatch.setattr(bench.gantry, "position", told)
    monkeypatch.setattr(module, "find_test_points", searches)
    look = await bench.station.look(HERE, probe_model(), ANYWHERE, bench.caller, moves_next=True)
    assert bench.lights.log == [Light.WHITE, Light.RED, Light.WHITE]
    assert look.seen is eyes.seen


async def test_drives_that_fail_while_the_search_goes_on_end_the_look_and_leave_nothing_behind(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    Eyes(monkeypatch, found_tip(810.0, 600.0))

    async def fails(_deadline: Deadline) -> Position:
        raise Stalled("silent", device="x")

    monkeypatch.setattr(bench.gantry, "position", fails)
    with pytest.raises(Stalled):
        await bench.station.look(HERE, probe_model(), ANYWHERE, bench.caller, moves_next=True)
    await asyncio.sleep(0)
    assert len(asyncio.all_tasks()) == 1


async def test_a_lamp_that_shone_before_is_not_waited_for_again(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """It should count the settling from when it was switched, whenever that was."""
    bench.lights.settle_s = 5.0
    switched_s = time.monotonic() - 4.0
    monkeypatch.setattr(bench.lights, "set", answers(switched_s))
    await bench.station.capture(Light.WHITE, bench.caller)
    assert bench.camera.asked[0][0] == switched_s + 5.0


def answers(result: Any) -> Any:
    """Return what always gives this."""

    async def answer(*_asked: Any) -> Any:
        return result

    return answer


def test_a_search_by_the_map_is_of_cads_size_round_the_place_below_the_tip(tmp_path: Path) -> None:
    exact = pose_map()
    point = board(("A", 0.0, 0.0), diameter_um=600.0).points[0]
    search = Search.by_map(exact, (800.0, 620.0), point, 820.0, 50.0)
    scale = exact.scale_px_per_um((800.0, 620.0))
    assert search.offset_px == pytest.approx(np.multiply(exact.below_tip_px, 0.75))
    assert search.reach_px == pytest.approx(820.0 * scale)
    assert search.expected_radius_px == pytest.approx(300.0 * scale)
