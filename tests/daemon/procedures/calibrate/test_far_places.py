"""A far place of the map's walk is one where the head may stand and the whole target is in the picture."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.config.sections.motion import ClearanceSection
from daemon.config.sections.touching import BrushSection, ReferenceSection
from daemon.domain.board import Board
from daemon.domain.board_layers import Body
from daemon.procedures.calibrate.far_places import FAR_COUNT, FAR_REACH_PX, FAR_UM, far_places, in_picture, may_stand
from drivers.gantry import Position
from tests.daemon.procedures.cad_board import cad_board, cad_pad, rectangle
from tests.daemon.procedures.fake_station import World, a_board

PLAIN = a_board(("A", 10_000.0, 5_000.0))
SIZE_UM = 600.0
REACH_UM = 1_500.0 + 700.0
"""The barrel's radius, and how far off a board may lie."""


def _place(world: World, dx_um: float = 0.0, dy_um: float = 0.0) -> Position:
    over = world.geometry.position_over((10_000.0, 5_000.0), 0.0)
    at = replace(over, x_um=over.x_um + dx_um, y_um=over.y_um + dy_um)
    return replace(at, z_um=world.config.gantry.work_z_um)


def _with_part(x_um: float, y_um: float) -> Board:
    """Return a board with one square part of 1 mm."""
    board = cad_board(cad_pad("A", 10_000.0, 5_000.0))
    assert board.layers is not None
    part = Body(outline=rectangle(x_um, y_um, 1_000.0, 1_000.0))
    side = board.layers.top.model_copy(update={"bodies": (part,)})
    return board.model_copy(update={"layers": board.layers.model_copy(update={"top": side})})


def test_far_places_are_a_ring() -> None:
    centre = Position(50_000.0, 40_000.0, 5_200.0, 30.0)
    places = far_places(centre)
    assert len({(round(p.x_um), round(p.y_um)) for p in places}) == FAR_COUNT
    assert [math.dist((p.x_um, p.y_um), (centre.x_um, centre.y_um)) for p in places] == pytest.approx([FAR_UM] * 8)
    assert {(p.z_um, p.theta_deg) for p in places} == {(5_200.0, 30.0)}


def test_the_whole_target_and_the_reach_round_it_are_in_the_picture(tmp_path: Path) -> None:
    context = World(tmp_path, PLAIN, {}).context
    camera = context.camera
    margin = FAR_REACH_PX + SIZE_UM / camera.pitch_um
    right, below = camera.width - margin, camera.height - margin
    for inside in ((margin, margin), (right, margin), (margin, below), (right, below)):
        assert in_picture(context, SIZE_UM, np.array(inside))
    for outside in ((margin - 1, 500.0), (500.0, margin - 1), (right + 1, 500.0), (500.0, below + 1)):
        assert not in_picture(context, SIZE_UM, np.array(outside))
    assert not in_picture(context, SIZE_UM, np.array((math.nan, 500.0)))


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize(("room_um", "good"), [(1.0, True), (-1.0, False)])
async def test_the_axes_need_room_to_come_from_below(tmp_path: Path, axis: str, room_um: float, good: bool) -> None:
    free = World(tmp_path / "free", PLAIN, {})
    at_um = getattr(_place(free), f"{axis}_um") - free.config.gantry.approach_um - room_um
    section = getattr(free.config.axes, axis).model_copy(update={"minimum": at_um})
    world = World(tmp_path / "tight", PLAIN, {"axes": {axis: section}})
    assert await may_stand(world.context, _place(world)) is good


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize(("room_um", "good"), [(1.0, True), (-1.0, False)])
async def test_above_it_they_need_none(tmp_path: Path, axis: str, room_um: float, good: bool) -> None:
    free = World(tmp_path / "free", PLAIN, {})
    section = getattr(free.config.axes, axis).model_copy(
        update={"maximum": getattr(_place(free), f"{axis}_um") + room_um}
    )
    world = World(tmp_path / "tight", PLAIN, {"axes": {axis: section}})
    assert await may_stand(world.context, _place(world)) is good


@pytest.mark.parametrize(("room_um", "good"), [(10.0, True), (-10.0, False)])
@pytest.mark.parametrize("way", [(1, 0), (-1, 0), (0, 1), (0, -1)])
async def test_a_part_is_kept_away_from(tmp_path: Path, way: tuple[int, int], room_um: float, good: bool) -> None:
    away_um = REACH_UM + 500.0 + room_um
    world = World(tmp_path, _with_part(10_000.0 + way[0] * away_um, 5_000.0 + way[1] * away_um), {})
    assert await may_stand(world.context, _place(world)) is good


async def test_the_head_of_the_configuration_says_how_far(tmp_path: Path) -> None:
    part = _with_part(10_000.0 + REACH_UM + 550.0, 5_000.0)
    wide: dict[str, Any] = {"clearance": ClearanceSection(barrel_radius_um=1_600.0)}
    assert not await may_stand((world := World(tmp_path, part, wide)).context, _place(world))


@pytest.mark.parametrize("section", [ReferenceSection, BrushSection])
@pytest.mark.parametrize(("higher_um", "good"), [(0.0, True), (90.0, True), (110.0, False), (None, True)])
async def test_a_reference_pad_or_brush_that_stands_higher_is_kept_away_from(
    tmp_path: Path, section: type[ReferenceSection | BrushSection], higher_um: float | None, good: bool
) -> None:
    """Between the surface and the hovering tip are 200 um; half of that may be taken."""
    free = World(tmp_path / "free", PLAIN, {})
    x_um, y_um = (float(v) for v in free.pad_um("A"))
    z_um = None if higher_um is None else free.config.gantry.touch_z_um + higher_um
    name = "reference" if section is ReferenceSection else "brush"
    world = World(tmp_path / "world", PLAIN, {name: section(x_um=x_um + 5_000.0, y_um=y_um, z_um=z_um)})
    assert await may_stand(world.context, _place(world)) is good
