"""The pin's force."""

import pytest

from sim_hw.electric.pin import STIFF_N_PER_MM, Pin

PIN = Pin(preload_n=0.3, rate_n_per_mm=0.6, travel_um=1000.0, friction_n=0.02)


def test_force_is_preload_and_rate_times_push_and_friction_is_a_loop() -> None:
    assert PIN.force_n(300.0, inwards=True, stuck=False) == pytest.approx(0.3 + 0.18 + 0.02)
    assert PIN.force_n(300.0, inwards=False, stuck=False) == pytest.approx(0.3 + 0.18 - 0.02)


def test_a_pin_that_does_not_touch_does_not_press() -> None:
    assert PIN.force_n(0.0, inwards=True, stuck=False) == PIN.force_n(-50.0, inwards=True, stuck=True) == 0.0


def test_at_the_end_of_its_travel_it_is_a_rod() -> None:
    ends = PIN.force_n(1000.0, inwards=True, stuck=False)
    assert PIN.force_n(1100.0, inwards=True, stuck=False) == pytest.approx(ends + STIFF_N_PER_MM * 0.1)


def test_a_plunger_that_sticks_presses_with_the_whole_pin() -> None:
    assert PIN.force_n(100.0, inwards=True, stuck=True) == pytest.approx(STIFF_N_PER_MM * 0.1)
