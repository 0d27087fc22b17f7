"""Diagnosis of a drive that does not run: the error that status word, error code and homed marker stand for. Pure.

This is the only place that tells an emergency stop from other trouble. The button cuts the motor supply; what the
drive shows of that depends on the wiring and on how long the button was pressed:

- Under-voltage (1003h number 3, or 603Fh 3120h or 3220h). It stays until the fault is reset, so it tells of a stop
  that is held and of one that has passed.
- A motor that does not follow or is blocked, without motor voltage (bit 4 of the status word).
- A drive that was left in operation enabled and is not any more, with no error of its own.
- The homed marker gone, though nobody took it away: the stop cut the drive's logic supply too, and it has restarted.
- A step of the power machine that the drive does not take, without motor voltage.

Bit 4 alone is no evidence: the manual does not settle whether it also drops in a drive that is merely switched off.

A supply that fails or dips by itself, a fuse, a plug pulled and put back, and a drive that restarts by itself show
exactly the same. They are called an emergency stop too: in all of them the motors were without current, the axes may
have slipped, and the cure is the same (release or repair, reset, home).

The other way round, three stops go by another name or none. A drive without logic supply is silent, and silence is a
lost link until it answers again. A following error whose motor has its voltage back is a stalled axis. A stop that
passed while no program watched, on a drive that keeps its marker and shows no error, leaves no trace at all.
"""

from dataclasses import dataclass

from drivers.errors import DriveFault, EmergencyStop, LimitHit, MotionError, MotionTimeout, Stalled
from drivers.l4118 import objects as od
from drivers.l4118.objects import Control, PowerState

_FAULTED = frozenset({PowerState.FAULT, PowerState.FAULT_REACTION})


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a drive shows, and what of it contradicts how it was left."""

    statusword: int
    error_code: int = 0
    """603Fh, zero when there is none."""
    error_entry: int = 0
    """Newest entry of the error stack 1003h, zero when it is empty."""
    left_enabled: bool = False
    """Whether the drive was left in operation enabled and not switched off since."""
    reference_lost: bool = False
    """Whether the homed marker was there and is gone, though nobody took it away."""

    @property
    def state(self) -> PowerState | None:
        """Give the state of the power machine."""
        return od.decode_state(self.statusword)

    @property
    def voltage(self) -> bool:
        """Tell bit 4 of the status word: there is motor voltage."""
        return bool(self.statusword & od.SW_VOLTAGE)


NOTHING_SEEN = Evidence(statusword=0)


def diagnose(axis: str, seen: Evidence) -> MotionError | None:
    """Give the error that the evidence stands for, or None when it shows nothing wrong."""
    if seen.error_code or seen.state in _FAULTED:
        return _by_error(axis, seen)
    if seen.reference_lost:
        return EmergencyStop("lost power since it was homed: its reference is gone", device=axis)
    if seen.left_enabled and seen.state is not PowerState.OPERATION_ENABLED:
        return EmergencyStop("switched off from outside", device=axis, technical=_found(seen))
    return None


def untaken_step(axis: str, control: Control, wanted: PowerState, statusword: int) -> MotionError:
    """Give the error of a drive that does not go to the state `wanted` on a control word."""
    seen = Evidence(statusword)
    technical = f"control word {control:04X}h leads to {_found(seen)}, not '{wanted.value}'"
    if seen.voltage:
        return MotionTimeout("the drive does not do what it is told", device=axis, technical=technical)
    text = "the drive cannot be switched on, for it has no motor voltage"
    return EmergencyStop(text, device=axis, technical=technical)


def stopped_by_program(axis: str) -> EmergencyStop:
    """Give the error of a move that this program stopped."""
    return EmergencyStop("stopped by the program", device=axis)


def not_started(axis: str) -> MotionError:
    """Give the error of a drive that was asked to move before it was set up."""
    text, advice = "the drive was not set up since it was opened", "Reset, then home."
    return MotionError(text, device=axis, advice=advice, technical="start() has not run")


def _by_error(axis: str, seen: Evidence) -> MotionError:
    """Put the drive's own error into its class."""
    code, number = seen.error_code, seen.error_entry >> 24
    text = f"the drive reports {od.error_meaning(seen.error_entry) or 'a fault without a reason'}"
    technical = f"fault {code:04X}h{od.error_numbers(seen.error_entry)}"
    if _supply_cut(seen):
        cut = f"the emergency stop was pressed, or else the motor supply was cut: {text}"
        return EmergencyStop(cut, device=axis, drive_code=code, technical=technical)
    if number in od.LIMIT_NUMBERS:
        return LimitHit(text, device=axis, drive_code=code, technical=technical)
    if number in od.BLOCKED_NUMBERS:
        return Stalled(text, device=axis, drive_code=code, technical=technical)
    return DriveFault(text, device=axis, code=code, technical=technical)


def _supply_cut(seen: Evidence) -> bool:
    number = seen.error_entry >> 24
    if number == od.UNDER_VOLTAGE_NUMBER or seen.error_code in od.UNDER_VOLTAGE_CODES:
        return True
    return number in od.BLOCKED_NUMBERS and not seen.voltage


def _found(seen: Evidence) -> str:
    state = f"'{seen.state.value}'" if seen.state else "no known state"
    return f"{state}, status {seen.statusword:04X}h{'' if seen.voltage else '; no motor voltage'}"
