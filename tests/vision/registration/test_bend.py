"""What a map leaves open far from the tip is learned from the board in one look."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vision.registration.drawn import TIP_PX, Lie, shoot, some_board
from vision.registration import Registration, find_bend, index_side, prepare, register


def _crooked(px_per_px: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return a perspective that leaves the tip and its scale alone and grows with the square of the way from it."""
    to_tip = np.array([[1.0, 0.0, -TIP_PX[0]], [0.0, 1.0, -TIP_PX[1]], [0.0, 0.0, 1.0]])
    bend = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [px_per_px, -0.7 * px_per_px, 1.0]])
    return np.asarray(np.linalg.inv(to_tip) @ bend @ to_tip)


@pytest.mark.parametrize("seed", [3, 4])
def test_the_far_parts_are_where_the_board_shows_them(seed: int) -> None:
    layers, targets = some_board(seed)
    side, rng = index_side(layers), np.random.default_rng(seed)
    about = min(((t.x_um, t.y_um) for t in targets), key=lambda p: np.hypot(p[0] - 18_000, p[1] - 14_000))
    target = next(t for t in targets if (t.x_um, t.y_um) == about)
    shot = shoot(layers, target, Lie(40.0, -30.0), rng)
    crooked = _crooked(6e-5) @ shot.assumed
    first = register(prepare(side, about), shot.frame, crooked, None, shot.hidden_px)
    start = first if isinstance(first, Registration) else first.best
    assert start is not None
    bend = find_bend(side, shot.frame, crooked, (about, start), shot.hidden_px)
    assert bend is not None
    found = register(prepare(side, about), shot.frame, bend @ crooked, None, shot.hidden_px)
    assert isinstance(found, Registration)
    assert found.agreement > start.agreement + 0.05
    far = [t for t in targets if 4000 < np.hypot(t.x_um - about[0], t.y_um - about[1]) < 7000]

    def off_px(to_px: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
        """Return how far off the far targets are, the board's own shift taken out, px."""
        ways = []
        for one in far:
            x, y, w = to_px @ (one.x_um + found.shift_um[0], one.y_um + found.shift_um[1], 1.0)
            ways.append(np.hypot(x / w - shot.truth_px(one)[0], y / w - shot.truth_px(one)[1]))
        return float(np.median(ways))

    assert off_px(crooked) > 5.0
    assert off_px(bend @ crooked) < 1.5


def test_a_board_that_is_not_there_teaches_nothing() -> None:
    layers, targets = some_board(3)
    other, _ = some_board(8)
    rng = np.random.default_rng(1)
    target = targets[5]
    about = (target.x_um, target.y_um)
    shot = shoot(layers, target, Lie(), rng)
    found = register(prepare(index_side(layers), about), shot.frame, shot.assumed, None, shot.hidden_px)
    assert isinstance(found, Registration)
    assert find_bend(index_side(other), shot.frame, shot.assumed, (about, found), shot.hidden_px) is None
