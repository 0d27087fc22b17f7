"""A calibration target is seen with the tip, or it is said why not; what is seen badly counts as not seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.calibrate.targets import (
    MAX_CROSS_SIGMA_PX,
    MIN_VISIBLE,
    CalibrationTarget,
    CrossTarget,
    NotSeen,
    RoundTarget,
    Sighting,
    choose_target,
)
from daemon.station.station import CrossSearch, Search
from tests.daemon.procedures.fake_station import BELOW_PX, TIP_PX, World, a_board, begin
from vision import NotFound, Reason, Seen
from vision.geometry.frames import Rigid2

CROSS_UM = (30_000.0, 22_000.0)


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {}).teach().with_map()


def _target(world: World, name: str | None) -> CalibrationTarget:
    """Return a target, with the tip over it."""
    target = choose_target(world.context, world.board.find(name) if name else None)
    world.put_tip(target.place_um)
    return target


async def _see(world: World, target: CalibrationTarget) -> Sighting | NotSeen:
    ran = begin({"op": "home"})
    seen = await target.see(ran.job, world.context, world.gantry.reported, BELOW_PX, 60.0)
    await ran.job.settle()
    assert ran.job.looks == 1
    assert [kind for kind, _ in ran.steps] == ["look"]
    return seen


def test_a_named_target_lies_where_the_board_does_else_it_is_the_printed_cross(world: World) -> None:
    named = choose_target(world.context, world.board.find("A"))
    assert isinstance(named, RoundTarget)
    assert (named.name, named.size_um, named.place_um) == ("A", 500.0, pytest.approx((70_000.0, 45_000.0)))
    world.with_alignment(Rigid2(0.0, 60_100.0, 40_000.0))
    assert choose_target(world.context, named.point).place_um == pytest.approx((70_100.0, 45_000.0))
    cross = choose_target(world.context, None)
    assert cross == CrossTarget(CROSS_UM, 720.0)
    assert (cross.name, cross.size_um) == ("control point", 1_440.0)


def test_without_a_cross_in_the_configuration_there_is_none(world: World) -> None:
    world.context.config = world.config.model_copy(update={"control_point": None})
    with pytest.raises(Fault) as caught:
        choose_target(world.context, None)
    assert caught.value.kind is FaultCode.NOT_CALIBRATED
    assert "write its place into station.toml" in caught.value.advice


@pytest.mark.parametrize("name", ["A", None])
async def test_a_target_is_where_it_would_be_if_the_tip_stood_at_its_taught_place(
    world: World, name: str | None
) -> None:
    target = _target(world, name)
    world.flex_px = lambda: (3.0, -2.0)
    seen = await _see(world, target)
    assert isinstance(seen, Sighting)
    assert seen.target_px == pytest.approx((TIP_PX[0] + BELOW_PX[0], TIP_PX[1] + BELOW_PX[1]), abs=1e-6)
    assert seen.tip.x_px == TIP_PX[0] + 3.0
    assert seen.position == world.gantry.reported
    target_sigma = 0.1 if name else 0.05
    assert seen.sigma_px == pytest.approx((0.1**2 + target_sigma**2) ** 0.5)


async def test_each_target_is_searched_in_its_own_light_by_its_nominal_size(world: World) -> None:
    await _see(world, _target(world, "A"))
    await _see(world, _target(world, None))
    assert world.station.searches == [Search(BELOW_PX, 60.0, 250.0 / 12.0), CrossSearch(BELOW_PX, 60.0, 60.0)]
    assert world.station.measured == [True, True], "a tip carried from another picture is no ground for a calibration"


@pytest.mark.parametrize(("visible", "good"), [(MIN_VISIBLE, True), (MIN_VISIBLE - 0.01, False)])
async def test_a_pad_half_behind_the_needle_does_not_count(world: World, visible: float, good: bool) -> None:
    target = _target(world, "A")
    world.visible = visible
    seen = await _see(world, target)
    assert bool(seen) is good
    assert good or seen == NotSeen("the needle hides too much of it")


@pytest.mark.parametrize(("sigma_px", "good"), [(MAX_CROSS_SIGMA_PX, True), (MAX_CROSS_SIGMA_PX + 0.01, False)])
async def test_a_blurred_cross_does_not_count(world: World, sigma_px: float, good: bool) -> None:
    target = _target(world, None)
    world.cross_sigma_px = sigma_px
    seen = await _see(world, target)
    assert bool(seen) is good
    assert isinstance(seen, Sighting) or seen.why.startswith("its centre is known to 0.3 px only")


@pytest.mark.parametrize("name", ["A", None])
async def test_what_is_missing_is_named(world: World, name: str | None) -> None:
    target = _target(world, name)
    world.hidden = {"A", "control point"}
    gone = await _see(world, target)
    assert gone == NotSeen("it is no_test_point" if name else "it is no_control_point")
    no_tip = NotFound(Reason.BENT, "bent")
    world.station.always = lambda look: replace(look, tip=no_tip, seen=None, cross=None)
    assert await _see(world, target) == NotSeen("the tip was not found: bent")
    world.station.always = lambda look: replace(look, seen=None, cross=None)
    assert await _see(world, target) == NotSeen("it was not looked for")


def _scripted(tip: Reason | None, target: Reason | None) -> Any:
    def edit(look: Any) -> Any:
        changed = replace(look, tip=NotFound(tip, "as scripted")) if tip else look
        if target is None:
            return changed
        nothing = NotFound(target, "as scripted")
        if look.red is None:
            return replace(changed, cross=nothing)
        return replace(changed, seen=Seen(nothing, (), (), (), (0, 0, 9, 9)))

    return edit


@pytest.mark.parametrize(
    ("name", "tip", "target", "fault"),
    [
        ("A", Reason.TOO_DARK, None, True),
        ("A", None, Reason.TOO_DARK, True),
        ("A", None, Reason.OUT_OF_FRAME, False),
        ("A", Reason.OUT_OF_FRAME, None, False),
        (None, Reason.BLURRED, None, True),
        (None, None, Reason.TOO_DARK, False),
        (None, None, Reason.OUT_OF_FRAME, False),
        (None, Reason.SATURATED, Reason.SATURATED, True),
    ],
)
async def test_a_frame_no_good_anywhere_is_a_fault_but_a_dark_spot_beside_a_seen_tip_is_not(
    world: World, name: str | None, tip: Reason | None, target: Reason | None, fault: bool
) -> None:
    looked_at = _target(world, name)
    world.station.always = _scripted(tip, target)
    if not fault:
        assert isinstance(await _see(world, looked_at), NotSeen)
        return
    ran = begin({"op": "home"})
    with pytest.raises(Fault) as caught:
        await looked_at.see(ran.job, world.context, world.gantry.reported, BELOW_PX, 60.0)
    await ran.job.settle()
    assert caught.value.kind is FaultCode.FRAME_UNUSABLE
