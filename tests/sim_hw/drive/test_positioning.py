"""The set-point handshake of profile position mode."""

import pytest

from tests.sim_hw.rig import Rig

TARGET, ACK, LIMIT = 1 << 10, 1 << 12, 1 << 11


def ready_rig(**knobs: object) -> Rig:
    rig = Rig(x_start_um=10_000.0, repeatability_um=0.0, **knobs)
    rig.ramps()
    rig.enable(1)
    return rig


def test_an_old_reached_bit_stands_until_the_acknowledge() -> None:
    rig = ready_rig()
    assert rig.status() & TARGET
    rig.write(0x607A, rig.units(5_000.0), kind="i")
    assert rig.control(0x1F, after_s=0.0) & (TARGET | ACK) == TARGET, "before the drive's cycle: still the old bit"
    rig.t_s += 0.002
    assert rig.status() & (TARGET | ACK) == ACK
    assert not rig.control(0x0F) & ACK
    rig.run_until(TARGET)
    assert rig.read(0x6064) == rig.units(5_000.0)
    assert rig.true_place() == pytest.approx(15_000.0)


def test_a_new_set_point_needs_a_new_edge() -> None:
    rig = ready_rig()
    rig.order(1_000.0)
    rig.run_until(TARGET)
    rig.write(0x607A, rig.units(2_000.0), kind="i")
    rig.control(0x1F)
    rig.t_s += 2.0
    assert rig.read(0x6064) == rig.units(1_000.0)


def test_without_bit_5_a_set_point_waits_for_its_turn() -> None:
    rig = ready_rig()
    rig.order(20_000.0)
    rig.order(5_000.0)
    assert rig.control(0x0F) & ACK, "the buffer is full"
    places = []
    while not rig.status() & TARGET:
        rig.t_s += 0.01
        places.append(rig.read(0x6064))
    assert max(places) == pytest.approx(rig.units(20_000.0), rel=1e-3)
    assert places[-1] == rig.units(5_000.0)
    assert not rig.status() & ACK


def test_with_bit_5_it_changes_at_once() -> None:
    rig = ready_rig()
    rig.order(50_000.0)
    rig.t_s += 0.3
    rig.order(1_000.0, word=0x3F)
    places = []
    while not rig.status() & TARGET:
        rig.t_s += 0.01
        places.append(rig.read(0x6064))
    assert max(places) < rig.units(40_000.0)
    assert places[-1] == rig.units(1_000.0)


def test_relative_moves_count_from_the_demand_and_double_when_repeated() -> None:
    rig = ready_rig()
    for expected in (3_000.0, 6_000.0):
        rig.order(3_000.0, word=0x5F)
        rig.run_until(TARGET)
        assert rig.read(0x6064) == rig.units(3_000.0) * round(expected / 3_000.0)


def test_halt_stops_and_its_release_goes_on() -> None:
    rig = ready_rig()
    rig.order(50_000.0)
    rig.t_s += 0.2
    rig.control(0x010F)
    rig.run_until(TARGET)
    held = rig.read(0x6064)
    assert 0 < held < rig.units(50_000.0)
    rig.control(0x0F)
    rig.run_until(TARGET)
    assert rig.read(0x6064) == rig.units(50_000.0)


@pytest.mark.parametrize(("policy", "ends_at"), [("refuse", 0.0), ("clamp", 8_000.0)])
def test_a_target_outside_607dh_raises_the_limit_bit(policy: str, ends_at: float) -> None:
    rig = ready_rig(outside_limits=policy)
    rig.write(0x607D, rig.units(-1_000.0), sub=1, kind="i")
    rig.write(0x607D, rig.units(8_000.0), sub=2, kind="i")
    status = rig.order(9_000.0)
    assert status & LIMIT
    rig.t_s += 3.0
    assert rig.read(0x6064) == rig.units(ends_at)
    assert bool(rig.status() & TARGET) is (policy == "clamp")
    assert not rig.order(7_000.0) & LIMIT


def test_the_mode_must_be_shown_before_the_edge_counts() -> None:
    rig = Rig()
    rig.ramps()
    for word in (0x06, 0x07, 0x0F):
        rig.control(word)
    rig.write(0x6060, 1, kind="b")
    assert rig.read(0x6061, kind="b") == 0
    rig.write(0x607A, rig.units(1_000.0), kind="i")
    rig.control(0x1F)
    rig.t_s += 1.0
    assert rig.read(0x6061, kind="b") == 1
    assert rig.read(0x6064) == 0


def test_speed_and_acceleration_are_in_the_units_of_60a9h() -> None:
    rig = ready_rig()
    start_s = rig.t_s
    rig.order(50_000.0)
    rig.run_until(TARGET, step_s=0.001)
    # 600 rpm = 50 mm/s, 6000 rpm/s = 500 mm/s^2: 1 s for 50 mm and one ramp of 0.1 s more.
    assert rig.t_s - start_s == pytest.approx(1.1, abs=0.012)
    rig.order(100_000.0)
    rig.t_s += 0.5
    assert rig.read(0x606C) == 600
    assert rig.read(0x6044, kind="h") == 600
