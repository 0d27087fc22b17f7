"""A needle that the last look did not show, or by its marking alone, goes nowhere before it was seen free."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.station.free_pin import FreePin
from tests.daemon.procedures.fake_station import (
    found_tip,
    missing,
    probe_model,
)
from tests.daemon.station.bench import ANYWHERE, HERE, Bench
from vision import KnownTip, Reason

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
    [(False, False, (2.5, 0.0), False), (True, False, (2.5, 0.0), True), (False, True, (0.0, -2.5), True),
     (True, True, (0.0, -3.5), False), (False, True, (0.0, 4.0), True)],
)  # fmt: skip
async def test_a_tip_known_by_its_marking_is_free_within_what_that_tells(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, then: bool, now: bool, off_px: tuple[float, float], goes: bool
) -> None:
    """Across it may be off, which no push does; a pin that was not lifted stands 13 px off, and no Z has stalled."""
    _seeing(bench, monkeypatch, replace(found_tip(800.0 + off_px[0], 600.0 + off_px[1]), by_marking=now))
    free = FreePin(probe_model(), (800.0, 600.0), 1.7, 12_000.0, away_px=(0.0, -1.0), by_marking=then)
    bench.station.pressing(free)
    if goes:
        await bench.station.go(SIDEWAYS, bench.caller)
        assert bench.station.needle.free_pin is None
        return
    with pytest.raises(Fault) as caught:
        await bench.station.go(SIDEWAYS, bench.caller)
    assert caught.value.kind is FaultCode.AXIS_STALLED
