"""Which error a drive's words stand for."""

from __future__ import annotations

import pytest

from drivers.errors import DriveFault, EmergencyStop, LimitHit, MotionError, MotionTimeout, Stalled
from drivers.l4118 import AxisHealth, PowerState
from drivers.l4118.diagnosis import Evidence, diagnose, stopped_by_program, untaken_step
from drivers.l4118.objects import Control

ENABLED, OFF, FAULT, VOLTAGE = 0x0227, 0x0240, 0x0208, 0x0010
FOLLOWING, BLOCKED, OVER_VOLTAGE = (0x8611, 0x0D008611), (0x7121, 0x0F007121), (0x3210, 0x01003210)


def _kind(seen: Evidence) -> type[MotionError] | None:
    error = diagnose("x", seen)
    return type(error) if error else None


@pytest.mark.parametrize("voltage", [0, VOLTAGE], ids=["held", "passed"])
@pytest.mark.parametrize(
    ("code", "entry"),
    [(0x3220, 0x03043220), (0x3220, 0), (0x3120, 0), (0x3100, 0x03043100), (0, 0x03043100)],
    ids=["both", "603Fh, intermediate circuit", "603Fh, mains", "1003h", "1003h alone"],
)
def test_under_voltage_is_an_emergency_stop_held_or_passed(voltage: int, code: int, entry: int) -> None:
    error = diagnose("x", Evidence(FAULT | voltage, code, entry))
    assert isinstance(error, EmergencyStop)
    assert (error.device, error.drive_code) == ("x", code or None)
    assert "motor supply was cut" in str(error)


def test_an_error_without_the_fault_state_counts_too() -> None:
    assert _kind(Evidence(OFF | VOLTAGE, 0x3220, 0x03043220)) is EmergencyStop
    assert _kind(Evidence(ENABLED | VOLTAGE, *OVER_VOLTAGE)) is DriveFault


@pytest.mark.parametrize("error", [FOLLOWING, BLOCKED])
def test_a_motor_that_does_not_follow_is_stopped_without_voltage_and_stalled_with_it(error: tuple[int, int]) -> None:
    assert _kind(Evidence(FAULT, *error)) is EmergencyStop
    assert _kind(Evidence(FAULT | VOLTAGE, *error)) is Stalled


@pytest.mark.parametrize("voltage", [0, VOLTAGE])
@pytest.mark.parametrize(
    ("code", "entry", "kind"),
    [(*OVER_VOLTAGE, DriveFault), (0x8612, 0x0A208612, LimitHit), (0x8612, 0x0B208612, LimitHit), (0, 0, DriveFault)],
)
def test_other_faults_keep_their_names_whatever_the_voltage(
    voltage: int, code: int, entry: int, kind: type[MotionError]
) -> None:
    error = diagnose("x", Evidence(FAULT | voltage, code, entry))
    assert type(error) is kind
    assert error.drive_code == (code or None)


def test_a_drive_that_left_operation_enabled_by_itself_was_stopped() -> None:
    assert _kind(Evidence(OFF | VOLTAGE, left_enabled=True)) is EmergencyStop
    assert _kind(Evidence(0x0207 | VOLTAGE, left_enabled=True)) is EmergencyStop
    assert _kind(Evidence(ENABLED | VOLTAGE, left_enabled=True)) is None


def test_a_lost_reference_is_a_stop_that_took_the_logic_supply_too() -> None:
    assert _kind(Evidence(OFF | VOLTAGE, reference_lost=True)) is EmergencyStop


@pytest.mark.parametrize("word", [OFF, OFF | VOLTAGE, ENABLED, 0x0221, 0x0201], ids="{:04X}".format)
def test_a_drive_found_as_it_was_left_shows_no_trouble_whatever_bit_4_says(word: int) -> None:
    assert _kind(Evidence(word)) is None


def test_a_step_that_is_not_taken_is_a_stop_without_voltage_and_a_time_out_with_it() -> None:
    stop = untaken_step("x", Control.SHUTDOWN, PowerState.READY, OFF)
    late = untaken_step("x", Control.SHUTDOWN, PowerState.READY, OFF | VOLTAGE)
    assert (type(stop), type(late)) == (EmergencyStop, MotionTimeout)
    assert late.in_words == "x: the drive does not do what it is told"
    told = "control word 0006h leads to 'switch on disabled', status 0250h, not 'ready to switch on'"
    assert str(late) == f"{late.in_words} ({told})"
    assert stop.in_words.count("no motor voltage") == 1


def test_a_stop_by_the_program_says_so() -> None:
    assert str(stopped_by_program("x")) == "x: stopped by the program"


def test_health_without_evidence_shows_no_trouble() -> None:
    health = AxisHealth("x", "switched on", True, 0.0, 0, "", False, False, False, None)
    assert health.trouble() is None
