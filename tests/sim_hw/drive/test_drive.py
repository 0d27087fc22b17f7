"""The drive's power states, faults and limits, over its own wire format."""

from itertools import product

import pytest

from sim_hw.drive.cia402 import TRANSITIONS, Command, PowerState, command_of
from tests.sim_hw.rig import Refused, Rig

TARGET, ACK, LIMIT, VOLTAGE = 1 << 10, 1 << 12, 1 << 11, 1 << 4


def state(word: int) -> int:
    return word & 0x6F


def moving_rig(**knobs: object) -> Rig:
    """Return an X axis half way through a long move."""
    rig = Rig(**knobs)
    rig.ramps()
    rig.enable(1)
    rig.order(100_000.0)
    rig.t_s += 0.5
    assert rig.plant.state_at(rig.t_s).moving
    return rig


def test_power_up_ends_in_switch_on_disabled() -> None:
    assert Rig().status() & 0x4F == 0x40


def test_the_walk_to_operation_enabled_and_back() -> None:
    rig = Rig()
    walk = [(0x00, 0x40), (0x06, 0x21), (0x07, 0x23), (0x0F, 0x27), (0x07, 0x23), (0x06, 0x21), (0x00, 0x40)]
    for word, expected in walk:
        status = rig.control(word)
        assert status & (0x4F if expected == 0x40 else 0x6F) == expected, f"after {word:02X}h"
        assert status & (1 << 9)
        assert status & VOLTAGE


def test_every_unlisted_command_changes_nothing() -> None:
    words = {0x06: Command.SHUTDOWN, 0x07: Command.SWITCH_ON, 0x0F: Command.ENABLE, 0x00: Command.DISABLE_VOLTAGE}
    words[0x02] = Command.QUICK_STOP
    ways = {PowerState.SWITCH_ON_DISABLED: (), PowerState.READY: (6,), PowerState.SWITCHED_ON: (6, 7)}
    for (start, way), (word, command) in product(ways.items(), words.items()):
        rig = Rig()
        for step in way:
            rig.control(step)
        rig.control(word)
        assert rig.drive.drive.state is TRANSITIONS[start].get(command, start)


def test_controlword_patterns_ignore_the_mode_bits() -> None:
    assert command_of(0x1F) is command_of(0x013F) is Command.ENABLE
    assert command_of(0x0B) is Command.QUICK_STOP
    assert command_of(0x80 | 0x06) is None


def test_quick_stop_brakes_with_6085h_and_switches_off() -> None:
    rig = moving_rig()
    rig.write(0x6085, 12_000)
    speed = 600 / 60 * 5000.0
    before = rig.true_place()
    assert state(rig.control(0x02, after_s=0.0)) == 0x07
    rig.t_s += 0.5
    assert rig.status() & 0x4F == 0x40
    braking = speed**2 / (2.0 * 12_000 / 60 * 5000.0)
    assert rig.true_place() - before == pytest.approx(braking, abs=50.0)


def test_quick_stop_option_6_stays_and_leaves_on_an_edge_of_bit_2() -> None:
    rig = moving_rig(quick_stop_option=6)
    rig.control(0x02, after_s=1.0)
    assert state(rig.status()) == 0x07
    assert state(rig.control(0x0F)) == 0x27
    rig.t_s += 1.0
    assert rig.read(0x606C) == 0


def test_disable_voltage_in_motion_slips_unseen() -> None:
    rig = moving_rig(estop_slip_um=100.0)
    offset = rig.true_place() - rig.read(0x6064) / 655.36
    rig.control(0x00)
    assert rig.true_place() - rig.read(0x6064) / 655.36 != pytest.approx(offset, abs=5.0)


def test_estop_faults_every_drive_and_holds_the_reset_back() -> None:
    rig = moving_rig()
    rig.faults.switch("estop", on=True)
    status = rig.status()
    assert status & 0x4F == 0x08
    assert not status & VOLTAGE
    assert rig.read(0x603F, kind="H") == 0x3220
    assert not rig.plant.state_at(rig.t_s).moving
    rig.control(0x00)
    assert rig.control(0x80) & 0x4F == 0x08, "no reset while the emergency stop is pressed"
    rig.faults.switch("estop", on=False)
    assert rig.status() & 0x4F == 0x08, "released is not reset"
    assert rig.control(0x80) & 0x4F == 0x08, "bit 7 was up already: no edge"
    rig.control(0x00)
    assert rig.control(0x80) & 0x4F == 0x40


def test_the_error_stack_is_newest_first_and_empties_by_writing_0() -> None:
    rig = Rig()
    with pytest.raises(Refused, match="08000024"):
        rig.read(0x1003, 1, "I")
    rig.faults.switch("estop", on=True)
    assert rig.read(0x1003, kind="B") == 1
    assert rig.read(0x1003, 1, "I") == 0x03043220
    assert rig.read(0x1001, kind="B") & 1
    with pytest.raises(Refused, match="06090030"):
        rig.write(0x1003, 1, kind="B")
    rig.write(0x1003, 0, kind="B")
    assert rig.read(0x1003, kind="B") == 0


def test_a_limit_switch_ahead_stops_the_move_with_error_11() -> None:
    rig = Rig(x_start_um=195_000.0)
    rig.ramps()
    rig.enable(1)
    rig.order(50_000.0)
    rig.run_until(1 << 3)
    status = rig.run_until(LIMIT)
    rig.t_s += 1.0
    assert rig.status() & 0x4F == 0x08
    assert status & LIMIT
    assert rig.read(0x1003, 1, "I") >> 24 == 11
    assert rig.read(0x60FD, kind="I") & 0b111 == 0b010
    assert 203_000.0 < rig.true_place() < 205_000.0
    rig.control(0x80)
    rig.enable(1)
    rig.order(0.0)
    rig.run_until(TARGET)
    assert not rig.status() & LIMIT, "away from the switch is allowed"


def test_a_limit_input_that_is_not_enabled_does_not_act() -> None:
    rig = Rig(x_start_um=195_000.0, special_function_enable=0)
    rig.ramps()
    rig.enable(1)
    rig.order(9_000.0)
    rig.run_until(TARGET)
    assert rig.read(0x60FD, kind="I") == 0b010 << 16


def test_the_limit_fault_stops_its_own_axis_in_motion() -> None:
    rig = moving_rig()
    rig.faults.switch("limit", on=True, axis="y")
    assert state(rig.status()) == 0x27
    rig.faults.switch("limit", on=True, axis="x", side="negative")
    assert state(rig.status()) == 0x27, "the switch behind does not matter"
    rig.faults.switch("limit", on=True, axis="x", side="positive")
    assert state(rig.status()) == 0x2F & 0x0F
    rig.t_s += 1.0
    assert rig.status() & 0x4F == 0x08


def test_a_stall_is_invisible_to_an_open_loop_drive() -> None:
    rig = moving_rig()
    place = rig.true_place()
    rig.faults.switch("stall", on=True, axis="x")
    status = rig.run_until(TARGET)
    assert state(status) == 0x27
    assert rig.read(0x6064) == rig.units(100_000.0)
    assert rig.true_place() == pytest.approx(place, abs=1.0)


def test_a_stall_that_the_drive_sees_is_a_following_error_after_its_time() -> None:
    rig = moving_rig()
    rig.write(0x6066, 200, kind="H")
    rig.faults.switch("stall", on=True, axis="all", detected=True)
    rig.status()
    rig.t_s += 0.15
    assert state(rig.status()) == 0x27, "6066h is not over"
    assert rig.read(0x60F4) > rig.read(0x6065, kind="I")
    rig.t_s += 0.1
    assert state(rig.status()) != 0x27
    assert rig.read(0x1003, 1, "I") >> 24 == 13


def test_the_following_error_can_be_switched_off_and_then_the_target_is_not_reached() -> None:
    rig = moving_rig()
    rig.write(0x6065, 0xFFFFFFFF)
    rig.faults.switch("stall", on=True, axis="all", detected=True)
    rig.status()
    rig.t_s += 60.0
    status = rig.status()
    assert state(status) == 0x27
    assert not status & TARGET, "6067h: it is not near its target"


def test_the_target_is_reached_after_the_time_of_its_window() -> None:
    rig = Rig()
    rig.ramps()
    rig.write(0x6068, 300, kind="H")
    rig.enable(1)
    rig.order(11_000.0)
    while rig.plant.state_at(rig.t_s).moving:
        rig.t_s += 0.01
    assert not rig.status() & TARGET
    rig.t_s += 0.31
    assert rig.status() & TARGET


@pytest.mark.parametrize(("reaction", "stops"), [(-1, False), (0, True), (1, True), (2, True)])
def test_3701h_says_what_a_limit_switch_does(reaction: int, stops: bool) -> None:
    rig = Rig(x_start_um=195_000.0, limit_reaction=reaction)
    rig.ramps(rpm=300)
    rig.enable(1)
    rig.order(50_000.0)
    rig.t_s += 20.0
    status = rig.status()
    assert (status & 0x4F == 0x08) == stops
    assert (rig.true_place() < 204_900.0) == stops, "without a reaction only the hard stop ends it"


def test_a_power_cycle_forgets_homing_marker_and_mapping_and_takes_its_time() -> None:
    rig = Rig()
    rig.home(21)
    rig.write(0x2400, 0x484F4D45, sub=0x20)
    rig.write(0x3602, 0, kind="B")
    rig.t_s = 20.0
    rig.drive.power_cycle(rig.t_s)
    rig.t_s += 0.4
    assert rig.exchange(bytes.fromhex("0313880002")) is None
    rig.t_s += 0.2
    assert rig.read(0x2400, 0x20) == 0
    assert rig.read(0x6064) == 0
    assert rig.read(0x3602, kind="B") == 6
    assert rig.status() & 0x4F == 0x40


def test_what_was_saved_survives_and_saving_takes_time() -> None:
    rig = Rig()
    rig.write(0x6081, 123)
    rig.write(0x6083, 321)
    with pytest.raises(Refused, match="08000020"):
        rig.write(0x1010, 1, sub=1)
    rig.write(0x1010, 0x65766173, sub=1)
    assert rig.read(0x1010, 1, "I") == 0
    rig.t_s += 3.0
    assert rig.read(0x1010, 1, "I") == 1
    rig.write(0x6083, 999)
    rig.write(0x2800, 0x746F6F62, sub=1)
    rig.t_s += 1.0
    assert (rig.read(0x6081, kind="I"), rig.read(0x6083, kind="I")) == (123, 321)


def test_units_of_a_tenth_degree_are_the_factory_default_of_the_motor_shaft() -> None:
    rig = Rig(position_unit=0xFF410000)
    rig.ramps()
    rig.enable(1)
    before = rig.true_place()
    rig.write(0x607A, 3600, kind="i")
    rig.control(0x1F)
    rig.run_until(TARGET)
    assert rig.true_place() - before == pytest.approx(5000.0, abs=40.0)


def test_changed_units_wait_until_operation_enabled_is_left() -> None:
    rig = Rig()
    rig.home(21)
    rig.ramps()
    rig.enable(1)
    rig.order(10_000.0)
    rig.run_until(TARGET)
    increments = rig.read(0x6064)
    rig.write(0x60A8, 0x00B40000)
    assert rig.read(0x6064) == increments
    rig.control(0x06)
    assert rig.read(0x6064) == 2
    with pytest.raises(Refused, match="06090030"):
        rig.write(0x60A8, 0x00FF0000)
