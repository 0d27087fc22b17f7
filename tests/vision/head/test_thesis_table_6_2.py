"""Table 6.2 of the thesis (6.3): image error to robot error, nine landings, with its misprints named."""

import math
from typing import NamedTuple

import pytest


class Row(NamedTuple):
    """A line of the table: tip and target px; d_im px, omega rad, d_w in controller units, gamma rad, as printed."""

    tip: tuple[int, int]
    target: tuple[int, int]
    d_im: float
    omega: float
    d_w: float
    gamma: float


TABLE = {
    "a": Row((426, 624), (412, 638), 19.80, -0.78, 6233, 0.79),
    "b": Row((442, 621), (434, 636), 17.00, -0.49, 5577, 1.08),
    "c": Row((421, 613), (416, 626), 13.92, -0.36, 4566, 1.02),
    "d": Row((424, 628), (428, 638), 10.77, 0.38, 3533, 1.95),
    "e": Row((429, 626), (408, 638), 24.18, -1.05, 7874, 0.52),
    "f": Row((435, 616), (434, 628), 12.04, -0.08, 3950, 1.49),
    "g": Row((435, 607), (430, 624), 17.72, -0.28, 5813, 1.28),
    "h": Row((433, 630), (428, 642), 13.00, -0.39, 4265, 1.17),
    "i": Row((430, 635), (434, 640), 6.04, -0.67, 2099, 0.89),
}
ROUNDED = 0.0101  # printed to two places, some cut off instead of rounded


def _distance(row: Row) -> float:
    return math.dist(row.tip, row.target)


def _omega(row: Row) -> float:
    return math.atan((row.tip[0] - row.target[0]) / (row.tip[1] - row.target[1]))


@pytest.mark.parametrize("name", "abcdefgh")
def test_distance_and_omega_follow_from_the_pixels(name: str) -> None:
    row = TABLE[name]
    assert row.d_im == pytest.approx(_distance(row), abs=ROUNDED)
    assert row.omega == pytest.approx(_omega(row), abs=ROUNDED)


@pytest.mark.parametrize("name", "abdefgh")
def test_gamma_is_omega_and_a_quarter_turn(name: str) -> None:
    row = TABLE[name]
    assert row.gamma == pytest.approx(_omega(row) + math.pi / 2, abs=ROUNDED)


@pytest.mark.parametrize("name", "bcdfgh")
def test_robot_distance_is_328_per_pixel_in_six_rows(name: str) -> None:
    row = TABLE[name]
    assert row.d_w / row.d_im == pytest.approx(328.06, abs=0.1)


@pytest.mark.parametrize(("name", "per_pixel"), [("a", 314.8), ("e", 325.6)])
def test_rows_a_and_e_have_another_scale(name: str, per_pixel: float) -> None:
    row = TABLE[name]
    assert row.d_w / _distance(row) == pytest.approx(per_pixel, abs=0.1)


def test_row_c_prints_gamma_1_02_for_1_20() -> None:
    row = TABLE["c"]
    assert row.gamma == 1.02
    assert row.omega + math.pi / 2 == pytest.approx(1.20, abs=0.015)


def test_row_i_prints_6_04_for_6_40_and_a_minus_too_many() -> None:
    row = TABLE["i"]
    assert _distance(row) == pytest.approx(6.40, abs=0.005)
    assert _omega(row) == pytest.approx(+0.67, abs=ROUNDED)
    assert row.d_w / _distance(row) == pytest.approx(327.8, abs=0.1)
    assert row.gamma == pytest.approx(math.pi / 2 - _omega(row), abs=ROUNDED)  # gamma was made from the wrong sign


def test_the_robot_distance_cannot_be_micrometres() -> None:
    """At 12 um a pixel it would be 27 times too far: a controller unit, so no constant of it is used anywhere."""
    assert all(row.d_w / _distance(row) > 25 * 12.0 for row in TABLE.values())
