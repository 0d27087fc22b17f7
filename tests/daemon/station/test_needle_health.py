"""A needle is suspected by two points in a row without a pass, and cleared by the reference pad or by a pass."""

from __future__ import annotations

import pytest

from daemon.station.needle_health import NeedleHealth, Tare
from tests.daemon.clock import Clock


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def health(clock: Clock) -> NeedleHealth:
    return NeedleHealth(clock)


def test_nobody_suspects_it_for_one_point(health: NeedleHealth) -> None:
    health.gave_no_pass("A")
    assert not health.suspected_at("A")
    assert health.suspected_at("B")


def test_a_pass_clears_it(health: NeedleHealth) -> None:
    health.gave_no_pass("A")
    health.passed()
    assert not health.suspected_at("B")


def test_the_reference_pad_clears_it_if_it_is_good_and_was_asked_afterwards(health: NeedleHealth, clock: Clock) -> None:
    health.read(0.2, good=True)
    clock.now_s += 1.0
    health.gave_no_pass("A")
    assert health.suspected_at("B")
    clock.now_s += 1.0
    health.read(5e3, good=False)
    assert health.suspected_at("B")
    health.read(0.2, good=True)
    assert not health.suspected_at("B")


def test_it_was_good_no_longer_ago_than_is_asked(health: NeedleHealth, clock: Clock) -> None:
    assert not health.good_within(60.0)
    health.read(0.2, good=True)
    clock.now_s += 59.0
    assert health.good_within(60.0)
    clock.now_s += 2.0
    assert not health.good_within(60.0)


def test_a_bad_reading_is_no_tare(health: NeedleHealth) -> None:
    assert health.tare_ohm == 0.0
    health.read(0.2, good=True)
    assert health.tare_ohm == 0.2
    health.read(5e3, good=False)
    assert (health.tare_ohm, health.first_ohm, health.last_ohm, health.checks) == (0.0, 0.2, 5e3, 2)


def test_a_tare_is_of_what_it_was_read_with_and_ages(health: NeedleHealth, clock: Clock) -> None:
    assert health.tare("needle 1", 900.0) is None
    health.read(0.2, good=True, of="needle 1")
    clock.now_s += 899.0
    assert health.tare("needle 1", 900.0) == Tare(0.2, 899.0)
    assert health.good_within(900.0, "needle 1")
    assert health.tare("needle 2", 900.0) is None
    assert not health.good_within(900.0, "needle 2")
    clock.now_s += 2.0
    assert health.tare("needle 1", 900.0) is None
    health.read(5e3, good=False, of="needle 1")
    assert health.tare("needle 1", 900.0) is None
