"""The board's edge among what else an outline layer draws."""

from pathlib import Path

import pytest

from sim_hw.board.board import Board, load_board
from sim_hw.board.surface import Surface
from sim_hw.board.writer import GerberText
from tests.sim_hw.small_board import SIZE_MM, write_board

Box = tuple[float, float, float, float]
EDGE: Box = (0.0, 0.0, *SIZE_MM)


def drawn(folder: Path, *boxes: Box) -> Board:
    write_board(folder)
    outline = GerberText("Profile,NP")
    for x0, y0, x1, y1 in boxes:
        outline.line(outline.circle(0.1), [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])
    (folder / "b-Edge_Cuts.gm1").write_text(outline.text())
    return load_board(folder)


def test_a_drawings_frame_is_not_the_edge(tmp_path: Path) -> None:
    board = drawn(tmp_path, (-30.0, -40.0, 100.0, 60.0), EDGE)
    assert board.outline_mm == pytest.approx(EDGE)


def test_what_is_cut_out_of_a_board_is_no_board(tmp_path: Path) -> None:
    board = drawn(tmp_path, EDGE, (17.0, 5.0, 19.0, 8.0))
    surface = Surface(board)
    assert board.outline_mm == pytest.approx(EDGE)
    assert (surface.at(18.0, 6.0).what, surface.at(16.0, 6.0).what) == ("off_board", "mask")


def test_a_filled_outline_is_an_edge(tmp_path: Path) -> None:
    write_board(tmp_path)
    outline = GerberText("Profile,NP")
    outline.region([(0.0, 0.0), (20.0, 0.0), (20.0, 15.0), (0.0, 15.0)])
    (tmp_path / "b-Edge_Cuts.gm1").write_text(outline.text())
    board = load_board(tmp_path)
    assert board.outline_mm == pytest.approx(EDGE)
    assert Surface(board).at(1.0, 1.0).what == "mask"


def test_a_board_without_an_outline_reaches_as_far_as_its_copper_and_openings(tmp_path: Path) -> None:
    write_board(tmp_path)
    (tmp_path / "b-Edge_Cuts.gm1").unlink()
    board = load_board(tmp_path)
    assert board.outline_mm == pytest.approx((0.9, 2.45, 19.1, 13.1), abs=0.01)
    assert Surface(board).at(3.0, 3.0).pin == "R1.1"
