"""A pad that stands above the board is hovered over and met at its own height, and what nobody has told is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.board import Board
from daemon.procedures.registry import PROCEDURES
from daemon.station.needle import NeedlePlace
from daemon.station.raised_pads import RaisedPads
from tests.daemon.procedures.cad_board import cad_board, cad_pad
from tests.daemon.procedures.fake_station import WORK_Z_UM, World, a_board, run
from tests.daemon.procedures.test_touch import PRESS_UM, Holder, _over, _surface, _surface_z_um, _touch

STANDS_UM = 600.0
PLACES = (("A", 20_000.0, 15_000.0), ("B", 25_000.0, 15_000.0))


def _board(**changes: Any) -> Board:
    board = a_board(*PLACES)
    points = tuple(p.model_copy(update=changes) if p.name == "A" else p for p in board.points)
    return board.model_copy(update={"points": points})


@pytest.fixture
def world(tmp_path: Path) -> World:
    """A station whose board's point A stands up, with the tip over it."""
    world = World(tmp_path, _board(stands_um=STANDS_UM), {})
    world.teach().with_map().calibrations.store(_surface(world))
    world.height_um = lambda x, y: world.geometry.height_um((x, y)) + world.geometry.stands_um((x, y))
    _over(world, "A")
    return world


def test_the_needle_hovers_as_high_above_a_raised_pad_as_above_the_board(world: World) -> None:
    for name, stands_um in (("A", STANDS_UM), ("B", 0.0)):
        at = world.geometry.position_over(world.board.point(name).place_um, 0.0)
        surface_um = world.geometry.height_um(world.geometry.tip_um(at))
        assert at.z_um == pytest.approx(WORK_Z_UM + surface_um + stands_um)
        assert world.geometry.surface_z_um(at) == pytest.approx(at.z_um - 200.0)
        assert world.geometry.slow_z_um(at) >= at.z_um - 200.0


def test_a_needle_that_is_pressed_on_a_raised_pad_is_down(world: World) -> None:
    at, needle = world.gantry.reported, world.station.needle
    needle.reported(at)
    assert needle.is_up
    pressed = replace(at, z_um=at.z_um - 300.0)
    assert pressed.z_um > WORK_Z_UM, "over the board beside it that would be up"
    needle.reported(pressed)
    assert needle.place is NeedlePlace.DOWN


async def test_a_raised_pad_is_pressed_from_its_own_height(world: World) -> None:
    ran = await _touch(world, Holder())
    lowest = min(move.z_um for move, _ in world.gantry.moves)
    assert lowest == pytest.approx(_surface_z_um(world) + STANDS_UM - PRESS_UM)
    assert ran.got.detail["contact"]["pressed_um"] == pytest.approx(PRESS_UM)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"stands_um": STANDS_UM, "kind": "pin"}, {"pad_stands_um": STANDS_UM}),
        ({"kind": "pin"}, {"pad_height": "unknown"}),
        ({"kind": "pad", "stands_um": 0.0}, {}),
        ({"kind": "site"}, {}),
    ],
)
async def test_the_answer_says_what_is_known_of_the_pads_height(
    tmp_path: Path, changes: dict[str, Any], told: dict[str, Any]
) -> None:
    world = World(tmp_path, _board(**changes), {})
    world.teach().with_map().calibrations.store(_surface(world))
    world.height_um = lambda x, y: world.geometry.height_um((x, y)) + world.geometry.stands_um((x, y))
    world.put_tip(world.pad_um("B"), z_um=world.gantry.config.gantry.safe_z_um)
    world.station.needle.reported(world.gantry.reported)
    detail = (await run(world, PROCEDURES["place"], {"op": "place", "test_point": "A"})).got.detail
    assert {name: detail[name] for name in ("pad_stands_um", "pad_height") if name in detail} == told


def test_over_a_pad_of_which_nobody_knows_how_high_it_is_the_way_down_is_slow_from_the_highest(tmp_path: Path) -> None:
    worlds = [World(tmp_path / kind, _board(kind=kind), {}).teach() for kind in ("pin", "site")]
    for world in worlds:
        world.with_map().calibrations.store(_surface(world))
        world.station.needle.board.seen_free()
    pin, site = (w.geometry.slow_z_um(w.geometry.position_over(PLACES[0][1:], 0.0)) for w in worlds)
    assert pin == worlds[0].config.gantry.highest_surface_um
    assert site < pin


def test_a_bare_boards_pads_lie_as_flat_as_the_board() -> None:
    bare = cad_board(cad_pad("A", 5_000.0, 5_000.0, 600.0, 600.0))
    assert bare.points[0].kind == "pad"
    assert RaisedPads(bare).is_flat
    assert not RaisedPads(bare.model_copy(update={"layers": None})).is_flat


def test_a_board_file_without_heights_keeps_its_fingerprint_and_one_with_them_keeps_them(tmp_path: Path) -> None:
    board = a_board(*PLACES)
    assert "stands_um" not in board.model_dump_json()
    raised = _board(stands_um=STANDS_UM)
    assert raised.revision != board.revision
    raised.save(tmp_path / "board.json")
    again = Board.load(tmp_path / "board.json")
    assert (again.point("A").stands_um, again.point("B").stands_um) == (STANDS_UM, None)
    assert again.revision == raised.revision
