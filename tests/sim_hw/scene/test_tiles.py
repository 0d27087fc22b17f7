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


def test_a_store_told_to_keep_more_keeps_more_and_one_told_less_keeps_less() -> None:
    every = [(i, j) for i in range(9) for j in range(9)]
    for most, kept, unasked in ((None, tiles.MOST_TILES, tiles.MOST_TILES), (60, 60, tiles.MOST_TILES), (3, 3, 3)):
        store = TileStore(9 * TILE, 9 * TILE, most)
        for count, tile in enumerate(every):
            assert store.full() == (count >= unasked), "as many are drawn unasked as ever, or fewer"
            store.hold(tile)
        store.forget_beyond(every[-1:])
        assert [tile for tile in every if store.holds(tile)] == every[-kept:]


def test_a_large_memory_is_filled_by_looking_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles, "MOST_TILES", 4)
    monkeypatch.setattr(tiles, "KEPT_WHOLE", 4)
    texture = BoardTexture(load_board(DEMO), seed=4, tiles=30)
    unasked = 0
    while texture.draw_one_more():
        unasked += 1
    assert unasked == 4
    texture.ensure(2 * TILE, 2 * TILE, 5 * TILE, 5 * TILE)
    assert not texture.draw_one_more()
    for i, j in ((0, 0), *((i, j) for i in range(2, 5) for j in range(2, 5))):
        assert texture.image[i * TILE : (i + 1) * TILE, j * TILE : (j + 1) * TILE].any()
    there = (5, 5, 9, 5 * TILE + 9)
    while texture.draw_one_more(there):
        pass
    assert texture.image[4 * TILE : 5 * TILE, :TILE].any(), "where the head goes is drawn all the same"
    assert not texture.image[:TILE, 5 * TILE :].any()
