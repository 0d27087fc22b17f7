import numpy as np
import pytest

from sim_hw.board.board import Board, load_board
from sim_hw.scene.texture import TILE, BoardTexture
from tests.sim_hw.scene_double import DEMO


@pytest.fixture(scope="module")
def board() -> Board:
    return load_board(DEMO, "top")


@pytest.fixture(scope="module")
def texture(board: Board) -> BoardTexture:
    texture = BoardTexture(board, seed=4)
    texture.ensure(0, 0, texture.width, texture.height)
    return texture


def _at(texture: BoardTexture, board: Board, x_mm: float, y_mm: float) -> tuple[int, int]:
    """Return the texel (row, column) of a CAD place."""
    x, y, _ = texture.from_mm(board) @ (x_mm - board.outline_mm[0], y_mm - board.outline_mm[1], 1.0)
    return round(float(y)), round(float(x))


def test_bare_pads_are_bright_and_holes_dark_in_both_lights(texture: BoardTexture, board: Board) -> None:
    for target in board.targets:
        row, column = _at(texture, board, target.x_mm, target.y_mm)
        aside = _at(texture, board, target.x_mm + 0.38 * target.pad_diameter_mm, target.y_mm)
        assert 130 <= int(texture.red[aside]) <= 250
        assert 110 <= float(texture.white[aside].mean()) <= 240
        if target.hole_diameter_mm is not None:
            assert texture.red[row, column] < 40
        else:
            assert texture.red[row, column] > 130


def test_mask_silkscreen_and_bench_look_as_they_should(texture: BoardTexture, board: Board) -> None:
    mask = texture.red[_at(texture, board, 42.0, 32.0)]
    pour = np.mean([texture.red[_at(texture, board, 46.0 + 0.1 * k, 20.0)] for k in range(9)])
    silk = texture.red[_at(texture, board, 24.0, 19.5)]
    bench = texture.red[_at(texture, board, 9.5, 9.5)]
    assert 20 <= mask <= 50
    assert 3 <= pour - mask <= 20
    assert 85 <= silk <= 145
    assert bench < 20


def test_nothing_is_flat(texture: BoardTexture, board: Board) -> None:
    row, column = _at(texture, board, 42.0, 32.0)
    patch = texture.white[row - 150 : row + 150, column - 150 : column + 150, 1].astype(float)
    assert 1.0 < patch.std() < 8.0


def test_tiles_are_the_same_in_whichever_order_they_are_drawn(texture: BoardTexture, board: Board) -> None:
    other = BoardTexture(board, seed=4)
    other.ensure(TILE + 5, 2 * TILE + 5, TILE + 20, 2 * TILE + 20)
    tile = np.s_[2 * TILE : 3 * TILE, TILE : 2 * TILE]
    assert np.array_equal(other.red[tile], texture.red[tile])
    assert not other.red[:TILE, :TILE].any()  # what nobody looked at was not drawn


def test_the_bottom_is_seen_from_below(board: Board) -> None:
    bottom = load_board(DEMO, "bottom")
    texture = BoardTexture(bottom, seed=4)
    x_mm = bottom.outline_mm[2] - bottom.target("TP1").x_mm + bottom.outline_mm[0]
    row, column = _at(texture, bottom, x_mm, bottom.target("TP1").y_mm)
    texture.ensure(column - 20, row - 20, column + 20, row + 20)
    assert texture.red[row, column + 9] > 130
    assert texture.red[row, column] < 40


def test_it_can_be_drawn_ahead_tile_by_tile(texture: BoardTexture, board: Board) -> None:
    other = BoardTexture(board, seed=4)
    steps = 0
    while other.draw_one_more():
        steps += 1
    assert steps == 7 * 6
    assert np.array_equal(other.image, texture.image)
