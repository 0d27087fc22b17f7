"""A station's frames are exposed after light and head have settled, and a look finds what was asked for in them."""

from __future__ import annotations

import asyncio
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.domain.errors import Fault
from daemon.platform.clock import Stopwatch
from daemon.station import station as module
from daemon.station import tip_search
from daemon.station.allowance import Allowance
from daemon.station.station import CrossSearch, Search
from drivers.deadline import Deadline
from drivers.errors import Stalled
from drivers.gantry import Position
from drivers.lights import Light
from tests.daemon.procedures.fake_station import a_board as board
from tests.daemon.procedures.fake_station import (
    found_tip,
    missing,
    pose_map,
    probe_model,
)
from tests.daemon.station.bench import ANYWHERE, HERE, Bench
from vision import Reason, Tip

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


async def test_the_head_settles_from_when_it_was_seen_to_stand_not_from_when_all_questions_were_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench(settle_ms=9_000.0)
    stood_s = time.monotonic() - 0.5
    monkeypatch.setattr(type(bench.gantry), "at_rest_s", property(lambda _gantry: stood_s))
    await bench.station.go(HERE, bench.caller)
    await bench.station.capture(Light.WHITE, bench.caller)
    assert bench.camera.asked[0][0] == pytest.approx(stood_s + 9.0)


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


@pytest.mark.parametrize("lost", [set(), {2}])
async def test_after_the_last_look_it_is_dark_as_soon_as_red_is_exposed(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, lost: set[int]
) -> None:
    """It should be lit again only where the picture is lost."""
    Eyes(monkeypatch, found_tip(810.0, 600.0))
    bench.camera.lost = lost
    look = await bench.station.look(HERE, probe_model(), ANYWHERE, bench.caller, is_last=True)
    assert bench.lights.log == [Light.WHITE, Light.RED, Light.OFF, *[Light.RED for _ in lost]]
    assert look.red is not None


@pytest.mark.parametrize("lost", [set(), {1}])
async def test_after_the_last_look_at_the_tip_it_is_dark_while_the_picture_is_on_its_way(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, lost: set[int]
) -> None:
    Eyes(monkeypatch, found_tip(810.0, 600.0))
    bench.camera.lost = lost
    look = await bench.station.look_white(HERE, probe_model(), None, bench.caller, is_last=True)
    assert bench.lights.log == [Light.WHITE, Light.OFF, *[Light.WHITE for _ in lost]]
    assert look.tip
    assert look.white.sequence == 1 + len(lost)


async def test_white_is_lit_while_the_drives_are_asked_and_a_lost_reference_is_told_first(bench: Bench) -> None:
    """It should ask the first drive before the lamp, and leave no question about a lamp behind."""
    lit: list[list[Light]] = []
    asked = asyncio.Event()

    async def homed(_deadline: Deadline) -> bool:
        lit.append(list(bench.lights.log))
        await asked.wait()
        lit.append(list(bench.lights.log))
        return bench.gantry.is_homed

    bench.gantry.homed = homed  # type: ignore[method-assign]
    asyncio.get_running_loop().call_later(0.05, asked.set)
    await bench.station.require_homed(bench.caller, looks_next=True)
    assert lit == [[], [Light.WHITE]]
    await bench.station.require_homed(bench.caller)
    assert bench.lights.log == [Light.WHITE]
    bench.gantry.is_homed = False
    with pytest.raises(Fault, match="homed"):
        await bench.station.require_homed(bench.caller, looks_next=True)
    await asyncio.sleep(0)
    assert len(asyncio.all_tasks()) == 1


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
