"""The limits of an alignment: what lies at each is taken, what lies beyond is refused and named."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from vision.geometry.board_alignment import (
    FARTHEST_UM,
    LEAST_ACROSS,
    LEAST_ACROSS_RESIDUALS,
    LEAST_BASELINE_RESIDUALS,
    Alignment,
    align,
)
from vision.geometry.frames import Rigid2

NAMES = tuple(f"F{n}" for n in range(1, 9))
FOUR = np.array([(3000.0, 3000.0), (57000.0, 4000.0), (55000.0, 37000.0), (5000.0, 36000.0)])
FIVE = np.vstack([FOUR, [(31000.0, 20000.0)]])
SIX = np.vstack([FIVE, [(20000.0, 9000.0)]])
NOMINAL = Rigid2(10.0, 80000.0, 60000.0)
SCATTERED = NOMINAL.apply(FOUR) + np.random.default_rng(1).normal(0.0, 6.0, FOUR.shape)


def _align(board: np.ndarray, seen: np.ndarray, **limits: Any) -> Alignment:
    return align(board, seen, names=NAMES[: len(board)], **limits)


def less(value: float) -> float:
    return math.nextafter(value, -math.inf)


def test_a_residual_as_large_as_the_limit_is_taken_and_a_larger_one_is_not() -> None:
    limit = float(np.linalg.norm(_align(FOUR, SCATTERED).residuals_um, axis=1).max())
    assert _align(FOUR, SCATTERED, max_residual_um=limit).rms_um > 0.0
    with pytest.raises(ValueError, match="from where"):
        _align(FOUR, SCATTERED, max_residual_um=less(limit))


def test_without_a_limit_told_a_residual_may_be_40_um() -> None:
    # Neither turn nor scale nor shift explains it, and all four are as far off: which one is named is left open.
    aside = np.array([(1.0, 0.0), (-1.0, 0.0), (1.0, 0.0), (-1.0, 0.0)])
    board = np.array([(0.0, 0.0), (40000.0, 0.0), (40000.0, 40000.0), (0.0, 40000.0)])
    assert np.linalg.norm(_align(board, board + 39.5 * aside).residuals_um, axis=1) == pytest.approx([39.5] * 4)
    with pytest.raises(ValueError, match=r"F\d is left 4\d um off \(limit 40 um\)"):
        _align(board, board + 40.5 * aside)


@pytest.mark.parametrize("scale", [1.001, 0.999])
def test_a_scale_as_far_off_as_the_limit_is_taken_and_one_farther_off_is_not(scale: float) -> None:
    limit = abs(_align(FOUR, FOUR * scale).pose.scale - 1.0)
    assert _align(FOUR, FOUR * scale, max_scale_error=limit).pose.scale == pytest.approx(scale)
    with pytest.raises(ValueError, match=f"{scale:.5f} times as large"):
        _align(FOUR, FOUR * scale, max_scale_error=less(limit))


def test_another_scale_is_told_as_one_where_the_residuals_are_as_large_as_the_limit() -> None:
    seen = SCATTERED * 1.005
    limit = float(np.linalg.norm(_align(FOUR, seen, max_scale_error=1.0).residuals_um, axis=1).max())
    with pytest.raises(ValueError, match=r"1\.00\d+ times as large"):
        _align(FOUR, seen, max_residual_um=limit)
    with pytest.raises(ValueError, match="no single one is to blame"):
        _align(FOUR, seen, max_residual_um=less(limit))


def test_another_scale_and_a_wrong_fiducial_are_not_told_as_a_scale() -> None:
    seen = FOUR * 1.005
    seen[2] += (0.0, 900.0)
    with pytest.raises(ValueError, match="no single one is to blame"):
        _align(FOUR, seen)


def test_a_turn_as_large_as_the_fixture_s_play_is_taken_and_a_larger_one_is_not() -> None:
    seen = Rigid2(10.3, 80000.0, 60000.0).apply(FOUR)
    found = _align(FOUR, seen)
    limit = abs((found.pose.theta_deg - NOMINAL.theta_deg + 180.0) % 360.0 - 180.0)
    assert limit == pytest.approx(0.3)
    _align(FOUR, seen, nominal=NOMINAL, max_turn_deg=limit)
    with pytest.raises(ValueError, match=r"turned by 0\.30 deg"):
        _align(FOUR, seen, nominal=NOMINAL, max_turn_deg=less(limit))


def test_a_shift_as_large_as_the_fixture_s_play_is_taken_and_a_larger_one_is_not() -> None:
    seen = Rigid2(10.0, 80300.0, 60400.0).apply(FOUR)
    centre = FOUR.mean(axis=0)
    limit = math.dist(_align(FOUR, seen).pose.apply(centre), NOMINAL.apply(centre))
    assert limit == pytest.approx(500.0)
    _align(FOUR, seen, nominal=NOMINAL, max_shift_um=limit)
    with pytest.raises(ValueError, match="shifted by 500 um"):
        _align(FOUR, seen, nominal=NOMINAL, max_shift_um=less(limit))


def test_fiducials_as_far_apart_as_the_limit_are_taken_and_nearer_ones_are_not() -> None:
    far = LEAST_BASELINE_RESIDUALS * 40.0
    board = np.array([(0.0, 0.0), (far, 0.0), (far / 2, far / 2)])
    _align(board, board)
    board[1, 0] = less(far)
    with pytest.raises(ValueError, match=r"near together.* at least 4 mm apart"):
        _align(board, board)


def _beside_the_line(along: float, aside: float) -> np.ndarray:
    """Return four fiducials whose spread is `along` and `aside`."""
    return np.array([(along, aside), (along, -aside), (-along, aside), (-along, -aside)])


@pytest.mark.parametrize(
    ("along", "residual", "limit"),
    [(50000.0, 40.0, LEAST_ACROSS * 50000.0), (5000.0, 40.0, LEAST_ACROSS_RESIDUALS * 40.0)],
    ids=["of the line's length", "of the residual"],
)
def test_a_fiducial_is_beside_the_line_by_a_share_of_its_length_and_of_the_residual(
    along: float, residual: float, limit: float
) -> None:
    board = _beside_the_line(along, limit * 1.001)
    _align(board, board, max_residual_um=residual)
    board = _beside_the_line(along, limit * 0.999)
    with pytest.raises(ValueError, match="on a line"):
        _align(board, board, max_residual_um=residual)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("column", [0, 1])
def test_a_coordinate_at_the_end_of_all_bounds_is_taken_and_one_beyond_is_not(sign: float, column: int) -> None:
    away = np.zeros(2)
    away[column] = sign * FARTHEST_UM - (FOUR[:, column].max() if sign > 0 else FOUR[:, column].min())
    far = FOUR + away
    assert np.abs(far).max() == FARTHEST_UM
    assert _align(far, FOUR).rms_um < 1.0
    assert _align(FOUR, far).rms_um < 1.0
    for board, seen in ((far * 1.000001, FOUR), (FOUR, far * 1.000001)):
        with pytest.raises(ValueError, match="beyond all bounds"):
            _align(board, seen)


@pytest.mark.parametrize(
    "limits",
    [
        {"max_residual_um": 0.0},
        {"max_residual_um": -1.0},
        {"max_scale_error": 0.0},
        {"max_scale_error": -0.001},
        {"least_scatter_um": -0.5},
        {"least_scatter_um": math.inf},
        {"least_scatter_um": math.nan},
    ],
    ids=str,
)
def test_limits_that_are_none_are_refused(limits: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="greater than 0"):
        _align(FOUR, FOUR, **limits)


def test_small_limits_are_limits() -> None:
    found = _align(FOUR, FOUR, max_residual_um=0.5, max_scale_error=1e-6, least_scatter_um=0.5)
    assert found.scatter_um == 0.5
    assert _align(FOUR, FOUR).scatter_um < 1e-6


def test_a_single_pair_is_no_pairs() -> None:
    with pytest.raises(ValueError, match="pair up"):
        align((1.0, 2.0), (1.0, 2.0), names=("F1", "F2"))
    with pytest.raises(ValueError, match="pair up"):
        align(FOUR, FOUR[:, :1].repeat(2, axis=1)[:3], names=NAMES[:4])


def test_it_tells_centre_and_spread_of_the_fiducials_and_what_each_was_off() -> None:
    found = _align(FOUR, SCATTERED)
    assert found.centre_um == (30000.0, 20000.0)
    assert found.spread_um == pytest.approx(math.sqrt(((FOUR - (30000.0, 20000.0)) ** 2).sum()))
    assert found.residuals_um == pytest.approx(SCATTERED - found.pose.apply(FOUR))
    assert found.rms_um == pytest.approx(math.sqrt((found.residuals_um**2).sum() / 4))
    assert found.scatter_um == pytest.approx(math.sqrt((found.residuals_um**2).sum() / 4))


def test_three_in_a_ring_are_named_among_five_and_not_looked_for_among_six() -> None:
    ring = NOMINAL.apply(FIVE)[[1, 2, 0, 3, 4]]
    with pytest.raises(ValueError, match="F1, F2, F3 are really F2, F3, F1"):
        _align(FIVE, ring)
    ring = NOMINAL.apply(SIX)[[1, 2, 0, 3, 4, 5]]
    with pytest.raises(ValueError, match="no single one is to blame"):
        _align(SIX, ring)


def test_of_several_orders_that_fit_the_one_with_the_fewest_exchanged_is_named() -> None:
    """A square is itself after each quarter turn, so two swapped corners are also three or four in a ring."""
    square = np.array([(0.0, 0.0), (30000.0, 0.0), (30000.0, 30000.0), (0.0, 30000.0)])
    with pytest.raises(ValueError, match="board: F1 and F2 are swapped; put"):
        _align(square, square[[1, 0, 2, 3]])


def test_three_fiducials_tell_the_worst_one_but_not_the_wrong_one() -> None:
    seen = FOUR[:3].copy()
    seen[1] += (60.0, 400.0)
    with pytest.raises(ValueError, match=r"F\d .* which of three fiducials is wrong cannot be told"):
        _align(FOUR[:3], seen)


def test_where_others_may_be_the_wrong_one_too_they_are_named_behind_the_most_likely() -> None:
    """Of four fiducials three always fit fairly: without another one the rest may be within a generous limit."""
    seen = FOUR.copy()
    seen[2] += (40.0, 40.0)
    told = "F3 is 57 um from where the others put it"
    for limit, doubt in [(25.0, r" \(or it is F2 or F4\)"), (20.0, r" \(or it is F2\)"), (5.0, "")]:
        with pytest.raises(ValueError, match=f"^{told}{doubt}; find it again"):
            _align(FOUR, seen, max_residual_um=limit)
