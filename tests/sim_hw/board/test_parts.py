"""Parts of an assembled board: which have bodies, where they stand, what is soldered."""

from pathlib import Path

import numpy as np
import pytest

from sim_hw.board.board import Board, load_board
from sim_hw.board.nest import InNest
from sim_hw.board.surface import Surface
from tests.sim_hw.scene_double import DEMO, SHARED_BOARDS
from tests.sim_hw.small_board import write_board

COURTYARDS = ((2.3, 2.4, 5.1, 3.6), (12.0, 2.0, 14.0, 4.0), (2.0, 8.5, 11.0, 11.5))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_board(tmp_path_factory.mktemp("small"), courtyards=COURTYARDS)


@pytest.fixture(scope="module")
def assembled(folder: Path) -> Board:
    return load_board(folder, parts_seed=3)


def test_a_board_is_bare_unless_it_is_assembled(folder: Path) -> None:
    bare = load_board(folder)
    assert (bare.bodies, bare.layers.solder, bare.layers.leads) == ((), (), ())


def test_bodies_stand_within_their_courtyards_and_test_points_have_none(assembled: Board) -> None:
    bodies = {body.part: body for body in assembled.bodies}
    assert set(bodies) == {"R1", "U1", "J1"}
    assert bodies["R1"].box_mm == pytest.approx((2.55, 2.65, 4.85, 3.35), abs=1e-6)
    assert bodies["J1"].height_um > bodies["R1"].height_um > 300.0


def test_without_courtyards_a_body_stands_between_its_pads(tmp_path: Path) -> None:
    bodies = {body.part: body for body in load_board(write_board(tmp_path), parts_seed=3).bodies}
    x0, y0, x1, y1 = bodies["R1"].box_mm
    assert (x0 + x1) / 2.0 == pytest.approx(3.7)
    assert (y0 + y1) / 2.0 == pytest.approx(3.0)
    assert 3.0 <= x0 < x1 <= 4.4, "the outer halves of both pads are free"


def test_heights_and_levels_are_drawn_from_the_seed(folder: Path, assembled: Board) -> None:
    def looks(board: Board) -> list[tuple[float, int]]:
        return [(body.height_um, body.white) for body in board.bodies]

    assert looks(load_board(folder, parts_seed=3)) == looks(assembled)
    assert looks(load_board(folder, parts_seed=4)) != looks(assembled)


def test_a_soldered_pin_fills_its_hole_and_a_via_stays_open(assembled: Board) -> None:
    surface = Surface(assembled)
    spots = {name: surface.at(x, y) for name, x, y in (("lead", 4.0, 10.0), ("joint", 4.42, 10.0), ("via", 16.0, 10.0))}
    assert (spots["lead"].what, spots["lead"].pin) == ("lead", "J1.1")
    assert (spots["joint"].what, spots["joint"].pin) == ("metal", "J1.1")
    assert spots["via"].what == "hole"


def test_solder_lies_on_the_pads_of_parts_and_not_on_test_points(assembled: Board) -> None:
    middles = {
        tuple(np.round((np.array(s.box_mm[:2]) + s.box_mm[2:]) / 2.0, 2).tolist()) for s in assembled.layers.solder
    }
    assert {(3.0, 3.0), (4.4, 3.0), (9.5, 5.0), (4.0, 10.0)} <= middles
    assert (13.0, 3.0) not in middles


def test_drilled_parts_stand_on_top_and_show_leads_below(folder: Path) -> None:
    below = load_board(folder, "bottom", parts_seed=3)
    assert not below.bodies
    assert Surface(below).at(4.0, 10.0).what == "lead"


def test_the_nest_tells_how_high_parts_are(assembled: Board) -> None:
    nest = InNest.made(assembled)
    r1 = next(body for body in assembled.bodies if body.part == "R1")
    assert nest.relief_um(3.7, 3.0) == r1.height_um
    assert nest.relief_um(6.0, 3.0) == 0.0


def test_no_part_of_the_demo_board_stands_on_a_test_point() -> None:
    board = load_board(DEMO, parts_seed=1)
    assert {"J1", "R1", "C1"} <= {body.part for body in board.bodies}
    points = [target for target in board.targets if target.name.startswith("TP")]
    assert all(InNest.made(board).relief_um(point.x_mm, point.y_mm) == 0.0 for point in points)


@pytest.mark.skipif(not SHARED_BOARDS.is_dir(), reason="no real boards lie beside the project")
@pytest.mark.parametrize(("name", "least"), [("F1Tenth-powerboard", 50), ("glasgow-revC3", 150), ("bioreactor", 35)])
def test_real_boards_get_bodies_on_their_own_area(name: str, least: int) -> None:
    board = load_board(SHARED_BOARDS / name, parts_seed=1)
    assert len(board.bodies) >= least
    assert len({body.part for body in board.bodies}) == len(board.bodies)
    x0, y0, x1, y1 = board.outline_mm
    for body in board.bodies:
        low, high = body.outline_mm.min(axis=0), body.outline_mm.max(axis=0)
        assert high[0] > x0
        assert low[0] < x1
        assert high[1] > y0
        assert low[1] < y1
        assert float((high - low).max()) < 60.0
