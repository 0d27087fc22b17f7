"""Limits learned from good boards hold what such boards read, and only that."""

from __future__ import annotations

import random

import pytest

from daemon.domain.plan import Plan
from daemon.domain.plan_learning import learn, limits_of
from daemon.domain.point_test import Limits, PointMethod, PointReading, PointRecord, PointTest, PointVerdict, Rung

GOOD = PointVerdict.PASS_FIRST


def record(
    point: str, value: float | None, method: PointMethod = "resistance", verdict: PointVerdict = GOOD
) -> PointRecord:
    reading = PointReading(
        rung=Rung.TOUCH, site_um=(0.0, 0.0), pressed_um=300.0, force_n=0.48, proof=True, value=value, unit="ohm"
    )
    return PointRecord(
        point=point, net=None, board_id="b", method=method, limits=None, verdict=verdict, readings=(reading,),
        touches=1, presses=1, seconds=1.0, at="2026-01-01T00:00:00.000+00:00",
    )  # fmt: skip


def _plan(*tests: PointTest) -> Plan:
    return Plan(name="base", board="demo", board_revision="r1", tests=tests)


def _resistance(point: str = "TP1") -> PointTest:
    return PointTest(point=point, method="resistance", limits=Limits(high=1e9, unit="ohm"))


def test_limits_lie_six_robust_scatters_from_the_median() -> None:
    values = [980.0, 990.0, 1000.0, 1010.0, 1020.0]  # median distance 10
    found = limits_of(values, "ohm", both=True)
    assert (found.low, found.high) == (900.0, 1100.0)  # a tenth of the middle is more than 6 x 14.8
    wide = limits_of([800.0, 900.0, 1000.0, 1100.0, 1200.0], "ohm", both=True)
    assert wide.low == pytest.approx(1000.0 - 6 * 148.26, rel=1e-3)


def test_one_odd_board_does_not_move_the_limits() -> None:
    values = [random.Random(1).gauss(1000.0, 5.0) for _ in range(9)]
    assert limits_of([*values, 50_000.0], "ohm", both=True).high == pytest.approx(1100.0, rel=0.01)


def test_few_boards_give_wider_limits_than_many() -> None:
    few, many = (limits_of([1000.0] * count, "ohm", both=True) for count in (2, 5))
    assert (few.low, few.high, many.low, many.high) == (750.0, 1250.0, 900.0, 1100.0)


def test_a_small_resistance_is_not_held_to_less_than_contact_and_leads_vary() -> None:
    found = limits_of([0.1, 0.11, 0.1, 0.09, 0.1], "ohm", both=False)
    assert (found.low, found.high) == (None, 0.6)


def test_every_good_board_is_within_the_limits_learned_from_others() -> None:
    rng = random.Random(3)
    for _ in range(50):
        limits = limits_of([rng.gauss(470.0, 8.0) for _ in range(6)], "ohm", both=True)
        assert all(limits.holds(rng.gauss(470.0, 8.0)) for _ in range(20))


def test_a_plan_is_learned_from_what_passed_and_says_from_which_runs() -> None:
    runs = {
        "run-1": [record("TP1", 1000.0), record("TP2", 5.0, verdict=PointVerdict.FAIL)],
        "run-2": [record("TP1", 1010.0)],
    }
    learned = learn("golden", _plan(_resistance(), _resistance("TP2")), runs)
    (test,) = learned.plan.tests
    assert (learned.plan.name, learned.plan.learned_from, learned.plan.learned) == ("golden", ("run-1", "run-2"), True)
    assert test.limits == limits_of([1000.0, 1010.0], "ohm", both=True)
    assert learned.left_out == {"TP2": "no run gave a value there that passed"}


def test_a_test_that_measures_nothing_stays_as_it_is() -> None:
    contact = PointTest(point="TP9", method="contact")
    assert learn("g", _plan(contact), {"r": [record("TP9", 0.3, "contact")]}).plan.tests == (contact,)


def test_nothing_is_learned_from_runs_without_a_value() -> None:
    with pytest.raises(ValueError, match="no run gave a value"):
        learn("g", _plan(_resistance()), {"r": [record("TP1", None)]})
