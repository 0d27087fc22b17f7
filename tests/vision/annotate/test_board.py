"""CAD over the picture: edges are drawn as confirmed where the board lies, and as contradicted where it does not."""

from __future__ import annotations

import numpy as np

from tests.vision.registration.drawn import Lie, Shot, shoot, some_board
from vision.annotate import BoardLook, draw_board
from vision.annotate.sheet import THROWN, USED
from vision.registration import (
    NotRegistered,
    Refusal,
    Registration,
    SideLayers,
    Target,
    index_side,
    mark_edges,
    prepare,
    register,
)


def _registered() -> tuple[SideLayers, Target, Shot, Registration]:
    layers, targets = some_board(3)
    target = targets[4]
    shot = shoot(layers, target, Lie(150.0, -90.0), np.random.default_rng(5), needle=True)
    found = register(prepare(layers, (target.x_um, target.y_um)), shot.frame, shot.assumed, target, shot.hidden_px)
    assert isinstance(found, Registration), found
    return layers, target, shot, found


def test_edges_of_a_registered_board_are_confirmed() -> None:
    layers, target, shot, found = _registered()
    about, hidden = (target.x_um, target.y_um), tuple(shot.hidden_px)
    marks = mark_edges(index_side(layers), shot.frame, shot.assumed, about, found, hidden)
    assert len(marks.confirmed) > 0.9 * (len(marks.confirmed) + len(marks.contradicted) + len(marks.weak))
    assert len(marks.hidden)


def test_edges_laid_beside_the_board_are_contradicted() -> None:
    layers, target, shot, _ = _registered()
    nothing = NotRegistered(Refusal.NOT_THIS_BOARD, "tried beside it")
    aside = shot.assumed @ np.array([[1.0, 0.0, 900.0], [0.0, 1.0, 700.0], [0.0, 0.0, 1.0]])
    marks = mark_edges(index_side(layers), shot.frame, aside, (target.x_um, target.y_um), nothing)
    assert len(marks.contradicted) > 2 * len(marks.confirmed)


def test_the_page_shows_both_and_the_verdict() -> None:
    layers, target, shot, found = _registered()
    look = BoardLook(index_side(layers), (target.x_um, target.y_um), shot.assumed, found, target, tuple(shot.hidden_px))
    good = draw_board(shot.frame, look)
    nothing = NotRegistered(Refusal.NO_BOARD, "nothing is seen")
    aside = shot.assumed @ np.array([[1.0, 0.0, 900.0], [0.0, 1.0, 700.0], [0.0, 0.0, 1.0]])
    bad = draw_board(shot.frame, BoardLook(look.side, look.about_um, aside, nothing, None, ()))

    def count(page: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], colour: tuple[int, int, int]) -> int:
        return int((np.abs(page.astype(int) - colour).max(axis=2) < 40).sum())

    assert count(good, USED) > 4 * count(bad, USED)
    assert count(bad, THROWN) > 4 * count(good, THROWN)
