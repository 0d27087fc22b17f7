"""However a board lies it is found; and what is not that board, lying so, is refused with its most likely name."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vision.geometry.board_alignment import align
from vision.geometry.frames import Rigid2, rotation
from vision.geometry.similarity import fit_similarity

CALM = settings(max_examples=100, deadline=None, derandomize=True)
FOUR = np.array([(3000.0, 3000.0), (57000.0, 4000.0), (55000.0, 37000.0), (5000.0, 36000.0)])
THREE = FOUR[:3]
NAMES = ("F1", "F2", "F3", "F4", "F5", "F6", "F7", "F8")
NOMINAL = Rigid2(0.0, 80000.0, 60000.0)


def _lying(board: np.ndarray, theta_deg: float = 0.1, tx: float = 80100.0, ty: float = 59950.0) -> np.ndarray:
    return Rigid2(theta_deg, tx, ty).apply(board)


@CALM
@given(
    st.floats(-180, 180),
    st.floats(-1e5, 1e5),
    st.floats(-1e5, 1e5),
    st.lists(st.tuples(st.floats(0, 6e4), st.floats(0, 4e4)), min_size=0, max_size=4),
)
def test_any_rigid_pose_is_recovered(theta_deg: float, tx: float, ty: float, more: list[tuple[float, float]]) -> None:
    board = np.vstack([THREE, *more]) if more else THREE
    found = align(board, _lying(board, theta_deg, tx, ty), names=NAMES[: len(board)])
    places = np.array([(0.0, 0.0), (60000.0, 40000.0)])
    assert found.pose.apply(places) == pytest.approx(_lying(places, theta_deg, tx, ty), abs=1e-4)
    assert found.pose.scale == pytest.approx(1.0, abs=1e-9)
    assert math.cos(math.radians(found.pose.theta_deg - theta_deg)) == pytest.approx(1.0)
    assert found.pose.inverse().apply(found.pose.apply(places)) == pytest.approx(places, abs=1e-4)
    assert np.abs(found.residuals_um).max() < 1e-4


@pytest.mark.parametrize("quarter", [0, 90, 180, 270])
@pytest.mark.parametrize("side", ["top", "bottom"])
def test_a_board_may_lie_in_any_quarter_turn_on_either_side(quarter: float, side: str) -> None:
    """The bottom's file is in the coordinates of who looks at the bottom, so it is a board like any other."""
    board = FOUR if side == "top" else FOUR * (-1.0, 1.0) + (60000.0, 0.0)
    seen = _lying(board, quarter + 0.15) + np.random.default_rng(1).normal(0.0, 6.0, board.shape)
    found = align(
        board, seen, names=NAMES[:4], nominal=Rigid2(quarter, 80000.0, 60000.0), max_shift_um=400.0, max_turn_deg=0.5
    )
    assert (found.pose.theta_deg - quarter + 180.0) % 360.0 - 180.0 == pytest.approx(0.15, abs=0.03)
    assert found.rms_um < 15.0
    assert found.names == ("F1", "F2", "F3", "F4")


def test_its_sigma_is_honest_within_a_tenth_and_grows_with_the_way_from_the_fiducials() -> None:
    rng = np.random.default_rng(2)
    for place in ((30000.0, 20000.0), (150000.0, 20000.0)):
        errors, variances = [], []
        for _ in range(800):
            found = align(FOUR, _lying(FOUR) + rng.normal(0.0, 6.0, FOUR.shape), names=NAMES[:4])
            errors.append(np.sum((found.pose.apply(place) - _lying(np.array(place))) ** 2))
            variances.append(found.sigma_um(place) ** 2)
        assert math.sqrt(np.mean(variances)) == pytest.approx(math.sqrt(np.mean(errors)), rel=0.1)
    assert found.sigma_um((150000.0, 20000.0)) > 2 * found.sigma_um((30000.0, 20000.0))


def test_three_lucky_fiducials_claim_no_more_than_the_station_can() -> None:
    found = align(THREE, _lying(THREE), names=NAMES[:3], least_scatter_um=6.0)
    assert found.rms_um < 1e-6
    assert found.sigma_um(tuple(THREE.mean(axis=0))) == pytest.approx(6.0 * math.sqrt(2 / 3))


def test_fewer_than_three_or_unpaired_or_not_finite_fiducials_are_refused() -> None:
    with pytest.raises(ValueError, match="needs 3"):
        align(FOUR[:2], _lying(FOUR[:2]), names=NAMES[:2])
    with pytest.raises(ValueError, match="pair up"):
        align(FOUR, _lying(FOUR)[:3], names=NAMES[:4])
    with pytest.raises(ValueError, match="pair up"):
        align(FOUR, _lying(FOUR), names=NAMES[:3])
    with pytest.raises(ValueError, match="named twice"):
        align(FOUR, _lying(FOUR), names=("F1", "F2", "F2", "F4"))
    with pytest.raises(ValueError, match="finite"):
        align(FOUR, _lying(FOUR) * (1.0, math.nan), names=NAMES[:4])
    with pytest.raises(ValueError, match="greater than 0"):
        align(FOUR, _lying(FOUR), names=NAMES[:4], max_residual_um=math.nan)


def test_fiducials_on_a_line_or_too_near_together_are_refused() -> None:
    line = np.array([(0.0, 0.0), (20000.0, 100.0), (50000.0, -80.0)])
    with pytest.raises(ValueError, match="on a line"):
        align(line, _lying(line), names=NAMES[:3])
    near = np.array([(0.0, 0.0), (1500.0, 0.0), (0.0, 1500.0)])
    with pytest.raises(ValueError, match="near together"):
        align(near, _lying(near), names=NAMES[:3])
    # Residuals of 5 um can be told on it.
    align(near, _lying(near), names=NAMES[:3], max_residual_um=5.0)


@pytest.mark.parametrize("count", [3, 4])
def test_a_board_with_its_other_side_up_is_named(count: int) -> None:
    board = FOUR[:count]
    with pytest.raises(ValueError, match="other side up"):
        align(board, _lying(board * (-1.0, 1.0)), names=NAMES[:count])


@pytest.mark.parametrize("pair", [(0, 1), (1, 3), (2, 3)])
def test_two_swapped_fiducials_are_named(pair: tuple[int, int]) -> None:
    seen = _lying(FOUR) + np.random.default_rng(3).normal(0.0, 6.0, FOUR.shape)
    seen[list(pair)] = seen[list(pair[::-1])]
    with pytest.raises(ValueError, match=f"F{pair[0] + 1} and F{pair[1] + 1} are swapped") as refused:
        align(FOUR, seen, names=NAMES[:4])
    assert "other side" not in str(refused.value)


def test_two_swapped_of_eight_and_three_in_a_ring_of_four_are_named() -> None:
    board = np.vstack([FOUR, [(20000.0, 9000.0), (41000.0, 30000.0), (33000.0, 2000.0), (9000.0, 21000.0)]])
    seen = _lying(board)
    seen[[4, 6]] = seen[[6, 4]]
    with pytest.raises(ValueError, match="F5 and F7 are swapped"):
        align(board, seen, names=NAMES)
    with pytest.raises(ValueError, match="F1, F2, F3 are really F2, F3, F1"):
        align(FOUR, _lying(FOUR)[[1, 2, 0, 3]], names=NAMES[:4])


def test_where_the_other_side_and_a_swap_look_alike_both_are_named() -> None:
    """An isosceles triangle: from the other side it is itself with the base's ends exchanged."""
    board = np.array([(0.0, 0.0), (40000.0, 0.0), (20000.0, 30000.0)])
    with pytest.raises(ValueError, match=r"other side up.*; or F1 and F2 are swapped"):
        align(board, _lying(board * (-1.0, 1.0)), names=NAMES[:3])


def test_another_scale_is_named() -> None:
    with pytest.raises(ValueError, match=r"1\.00500 times"):
        align(FOUR, _lying(FOUR) * 1.005, names=NAMES[:4])
    with pytest.raises(ValueError, match="unit of the board file"):
        align(FOUR / 25.4, _lying(FOUR), names=NAMES[:4], max_residual_um=10.0)
    stretched = align(FOUR, _lying(FOUR) * 1.0005, names=NAMES[:4])
    assert stretched.pose.scale == pytest.approx(1.0005)


@pytest.mark.parametrize("wrong", [0, 1, 2, 3, 4])
def test_one_wrong_fiducial_of_five_is_named_with_its_distance(wrong: int) -> None:
    board = np.vstack([FOUR, [(31000.0, 20000.0)]])
    seen = _lying(board) + np.random.default_rng(4).normal(0.0, 4.0, board.shape)
    seen[wrong] += (180.0, -240.0)
    with pytest.raises(ValueError, match=rf"^F{wrong + 1} is (29|30|31)\d um from where the others put it; find"):
        align(board, seen, names=NAMES[:5])


def test_one_wrong_fiducial_of_four_is_named() -> None:
    seen = _lying(FOUR) + np.random.default_rng(5).normal(0.0, 4.0, FOUR.shape)
    seen[2] += (0.0, 400.0)
    with pytest.raises(ValueError, match=r"^F3 is \d+ um from where the others put it"):
        align(FOUR, seen, names=NAMES[:4])


def test_with_three_fiducials_no_single_one_is_blamed() -> None:
    seen = _lying(THREE)
    seen[1] += (60.0, 400.0)
    with pytest.raises(ValueError, match="cannot be told"):
        align(THREE, seen, names=NAMES[:3])


def test_another_board_altogether_is_no_single_fiducial_s_fault() -> None:
    with pytest.raises(ValueError, match="no single one"):
        align(FOUR, _lying(FOUR + np.array([(0, 0), (2000, 0), (-3000, 4000), (5000, -1500)])), names=NAMES[:4])


def test_a_board_beyond_the_fixture_s_play_is_refused() -> None:
    kept = {"names": NAMES[:4], "nominal": NOMINAL, "max_shift_um": 300.0, "max_turn_deg": 0.3}
    found = align(FOUR, _lying(FOUR), **kept)
    assert found.pose.theta_deg == pytest.approx(0.1)
    with pytest.raises(ValueError, match=r"shifted by 5\d\d um"):
        align(FOUR, _lying(FOUR, 0.0, 80500.0, 60000.0), **kept)
    with pytest.raises(ValueError, match=r"turned by -0\.50 deg"):
        align(FOUR, _lying(FOUR, -0.5), **kept)
    with pytest.raises(ValueError, match=r"turned by -180\.00|turned by 180\.00"):
        align(FOUR, _lying(FOUR, 180.0), **kept)


def test_a_turn_is_measured_the_short_way_round() -> None:
    seen = Rigid2(-179.9, 80000.0, 60000.0).apply(FOUR)
    found = align(FOUR, seen, names=NAMES[:4], nominal=Rigid2(179.9, 80000.0, 60000.0), max_turn_deg=0.3)
    assert rotation(found.pose.theta_deg) == pytest.approx(rotation(180.1), abs=1e-6)


@CALM
@given(st.lists(st.tuples(*[st.floats()] * 4), max_size=6))
def test_any_numbers_give_a_value_error_or_a_pose(rows: list[tuple[float, float, float, float]]) -> None:
    table = np.array(rows, dtype=float).reshape(-1, 4)
    try:
        found = align(table[:, :2], table[:, 2:], names=NAMES[: len(table)])
    except ValueError:
        return
    assert np.isfinite(found.residuals_um).all()


def test_a_similarity_has_a_way_back_unless_it_made_all_one() -> None:
    fit = fit_similarity(FOUR, _lying(FOUR, 33.0) * 2.5)
    assert fit.inverse().apply(fit.apply(FOUR)) == pytest.approx(FOUR, abs=1e-6)
    assert fit.inverse().scale == pytest.approx(0.4)
    with pytest.raises(ValueError, match="no way back"):
        fit_similarity(FOUR, np.zeros((4, 2))).inverse()
