"""The image of a board keeps no more tiles than it may, and draws again what it gave up."""

import numpy as np
import pytest

from sim_hw.board.board import load_board
from sim_hw.scene import tiles
from sim_hw.scene.texture import TILE, BoardTexture
from sim_hw.scene.tiles import TileStore
from tests.sim_hw.scene_double import DEMO


def test_what_is_given_up_is_zero_again_and_the_rest_is_kept() -> None:
    store = TileStore(2 * TILE + 5, TILE + 300)
    store.image[...] = 7
    store.hold((0, 1))
    store.forget((0, 1))
    assert not store.image[:TILE, TILE : 2 * TILE].any()
    assert (store.image[TILE:] == 7).all()
    assert (store.image[:TILE, :TILE] == 7).all()
    assert (store.image[:TILE, 2 * TILE :] == 7).all()


def test_a_large_board_keeps_what_was_looked_at_last(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles, "MOST_TILES", 6)
    monkeypatch.setattr(tiles, "KEPT_WHOLE", 6)
    board = load_board(DEMO)
    texture, fresh = BoardTexture(board, seed=4), BoardTexture(board, seed=4)
    while texture.draw_one_more():
        pass
    first = np.s_[:TILE, :TILE]
    drawn = texture.image[first].copy()
    texture.ensure(2 * TILE, 2 * TILE, 5 * TILE, 5 * TILE)  # nine tiles at once: all are needed
    assert not texture.image[first].any()
    fresh.ensure(4 * TILE, 4 * TILE, 4 * TILE + 9, 4 * TILE + 9)
    last = np.s_[4 * TILE : 5 * TILE, 4 * TILE : 5 * TILE]
    assert np.array_equal(texture.image[last], fresh.image[last])
    texture.ensure(0, 0, 9, 9)
    assert np.array_equal(texture.image[first], drawn)


def test_what_the_head_goes_to_is_drawn_first() -> None:
    texture = BoardTexture(load_board(DEMO), seed=4)
    there = (3 * TILE + 5, 2 * TILE + 5, 3 * TILE + 9, 2 * TILE + 9)
    assert texture.draw_one_more(there)
    assert texture.image[2 * TILE : 3 * TILE, 3 * TILE : 4 * TILE].any()
    assert not texture.image[:TILE].any()
