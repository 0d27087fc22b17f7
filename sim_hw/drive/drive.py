"""Stepper drive behind its object dictionary: power states, faults, limits, modes of operation (CiA 402).

Time is an argument: `update(t)` works off everything that happened up to `t`, each thing at its own time, so the
result does not depend on how often the drive is asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from sim_hw.drive.cia402 import TRANSITIONS, Command, PowerState, command_of
from sim_hw.drive.error import FOLLOWING, NEGATIVE_LIMIT, POSITIVE_LIMIT, UNDER_VOLTAGE, DriveError
from sim_hw.drive.homing import METHODS, Homing
from sim_hw.drive.objects import ABORT_RANGE, ObjectAbort, ObjectDictionary
from sim_hw.drive.positioning import Positioning
from sim_hw.drive.stage import CYCLE_S, Due, Stage
from sim_hw.drive.units import known
from sim_hw.plant.axis import INCREMENTS_PER_REV, AxisSpec
from sim_hw.plant.plant import Plant

PROFILE_POSITION, HOMING = 1, 6

_QUICK_STOP_BIT, _FAULT_RESET = 1 << 2, 1 << 7

_NO_WINDOW = 0xFFFF_FFFF
"""6065h: no following error."""

_CUT, _SLOW, _QUICK, _SLOW_STAY, _STAY = 0, 1, 2, 5, (5, 6)
"""605Ah (and 3701h up to 2): brake with 6084h or 6085h; the last two stay in "quick stop active"."""


class Drive:
    """Hold a drive from one power-up to the next."""

    def __init__(self, spec: AxisSpec, plant: Plant, objects: ObjectDictionary, t_s: float) -> None:
        self._stage = Stage(spec, plant, objects, t_s)
        self._positioning = Positioning(self._stage, self._check_limit_ahead)
        self._homing = Homing(self._stage)
        self.motor = self._stage.motor
        self.state = PowerState.SWITCH_ON_DISABLED
        self.errors: list[DriveError] = []
        self._mode = 0
        self._mode_due_s: float | None = None
        self._after_stop: Callable[[], None] | None = None
        self._connect(objects)

    # --- time

    @property
    def now_s(self) -> float:
        """Return the time up to which the drive has worked."""
        return self._stage.now_s

    def update(self, t_s: float) -> None:
        """Work off all that happened up to a time, then what is broken at that time."""
        while True:
            due = [event for event in self._due() if event[0] <= t_s]
            if not due:
                break
            self._stage.now_s, handler = min(due, key=lambda event: event[0])
            handler()
        self._stage.now_s = max(t_s, self._stage.now_s)
        self._heed_faults()

    def next_event_s(self) -> float | None:
        """Return when something is going to happen by itself, or None."""
        return min((when_s for when_s, _ in self._due()), default=None)

    def _due(self) -> Iterator[Due]:
        end_s = max(self.now_s, self.motor.demand.end_s)
        if self._mode_due_s is not None:
            # In motion a change of mode waits.
            waits = self.state is PowerState.ENABLED and self._stage.moving()
            yield max(self._mode_due_s, end_s if waits else 0.0), self._change_mode
        if self._after_stop is not None:
            yield end_s, self._stopped
            return
        yield from self._positioning.due()
        yield from self._homing.due()
        yield from self._limit_due()
        yield from self._lag_due()

    # --- power states

    def _control(self, word: int) -> None:
        """Act on a new controlword."""
        rising, self._stage.controlword = word & ~self._stage.controlword, word
        if self.state is PowerState.FAULT:
            if rising & _FAULT_RESET and not self._cut_off():
                self._stage.objects.values[0x603F, 0] = 0
                self.state = PowerState.SWITCH_ON_DISABLED
            return
        was, command = self.state, command_of(word)
        if command is not None:
            self._obey(command, rising)
        if self.state is was is PowerState.ENABLED:
            self._operate(word, rising)
        # What was ordered may fall due although nobody asks again.
        self._stage.plant.changed()

    def _operate(self, word: int, rising: int) -> None:
        if self._mode == PROFILE_POSITION:
            self._positioning.operate(word, rising)
        elif self._mode == HOMING:
            self._homing.operate(word, rising)

    def _obey(self, command: Command, rising: int) -> None:
        was, new = self.state, TRANSITIONS[self.state].get(command)
        if new is None or (was is PowerState.QUICK_STOP and not self._may_resume(command, rising)):
            return
        if was not in (PowerState.ENABLED, PowerState.QUICK_STOP):
            self._stage.refresh_units()
        self.state = new
        if was in (PowerState.ENABLED, PowerState.QUICK_STOP):
            self._leave(command)
        if new is PowerState.ENABLED:
            self._positioning.reset(reached=True)

    def _may_resume(self, command: Command, rising: int) -> bool:
        """Tell whether "quick stop active" may be left: transition 16 needs an edge, and a drive that stays there."""
        return command is not Command.ENABLE or (bool(rising & _QUICK_STOP_BIT) and self._after_stop is None)

    def _leave(self, command: Command) -> None:
        """Bring the motor to rest the way the command says."""
        self._forget_motion()
        if command is Command.DISABLE_VOLTAGE:
            self._after_stop = None
            self.motor.cut(self.now_s)
        elif command is Command.QUICK_STOP:
            self._quick_stop(self._stage.objects.get(0x605A))
        elif self._stage.moving():
            self._stage.stop(0x6084)

    def _quick_stop(self, option: int) -> None:
        """Stop as 605Ah says and, for most options, switch off at rest."""
        if option == _CUT:
            self.motor.cut(self.now_s)
        else:
            self._stage.stop(0x6084 if option in (_SLOW, _SLOW_STAY) else 0x6085)
        if option not in _STAY:
            self._after_stop = self._switch_off

    def _switch_off(self) -> None:
        self.state = PowerState.SWITCH_ON_DISABLED

    def _stopped(self) -> None:
        handler, self._after_stop = self._after_stop, None
        if handler is not None:
            handler()

    # --- faults and limits

    def _fail(self, error: DriveError, reaction: int = _QUICK) -> None:
        """Enter the fault; a motor under power is braked first, or cut, as the reaction says."""
        self.errors = [error, *self.errors][:8]
        self._stage.objects.values[0x603F, 0] = error.code
        self._stage.plant.note(self.now_s, "drive_fault", {"axis": self.motor.spec.name, "number": error.number})
        self._forget_motion()
        unpowered = self.state not in (PowerState.ENABLED, PowerState.QUICK_STOP)
        if error is UNDER_VOLTAGE or reaction == _CUT or unpowered:
            self.motor.cut(self.now_s)
            self._after_stop = None
            self._enter_fault()
            return
        self.state = PowerState.FAULT_REACTION
        self._stage.stop(0x6084 if reaction == _SLOW else 0x6085)
        self._after_stop = self._enter_fault

    def _enter_fault(self) -> None:
        self.state = PowerState.FAULT

    def _cut_off(self) -> bool:
        return self._stage.plant.faults.on("estop")

    def _heed_faults(self) -> None:
        """Act on what is broken now."""
        self.motor.heed_slip(self.now_s)
        if self._cut_off():
            if self.state is not PowerState.FAULT or self._stage.moving():
                self._fail(UNDER_VOLTAGE)
            return
        self.motor.heed_stall(self.now_s)
        if self._minds_limits():
            self._check_limit_ahead()

    def _minds_limits(self) -> bool:
        """Tell whether a limit switch ahead is a fault (3701h): homing deals with them itself."""
        if self._stage.objects.get(0x3701) < 0:
            return False
        return self.state is PowerState.ENABLED and self._mode == PROFILE_POSITION and self._stage.moving()

    def _lag_due(self) -> Iterator[Due]:
        """Yield when a rotor that fell behind becomes a following error: beyond 6065h for 6066h."""
        window = self._stage.objects.get(0x6065)
        if self.state is not PowerState.ENABLED or not self._stage.watches_rotor() or window == _NO_WINDOW:
            return
        since_s = self.motor.behind_since(self._stage.position(0x6065))
        if since_s is not None:
            yield max(self.now_s, since_s + self._stage.objects.get(0x6066) / 1000.0), self._lose_rotor

    def _lose_rotor(self) -> None:
        self._fail(FOLLOWING)

    def _limit_due(self) -> Iterator[Due]:
        ahead = self._stage.ahead()
        if self._minds_limits() and self._stage.watched(ahead):
            when_s = self.motor.crossing(ahead, self.now_s, upwards=ahead == "positive")
            if when_s is not None:
                yield when_s, self._hit_limit

    def _hit_limit(self) -> None:
        error = POSITIVE_LIMIT if self._stage.ahead() == "positive" else NEGATIVE_LIMIT
        self._fail(error, self._stage.objects.get(0x3701))

    def _check_limit_ahead(self) -> None:
        if self._minds_limits() and self._stage.active(self._stage.ahead()):
            self._hit_limit()

    # --- modes of operation

    def _order_mode(self, mode: int) -> None:
        _require(mode in (0, PROFILE_POSITION, HOMING))
        self._mode_due_s = self.now_s + CYCLE_S
        self._stage.plant.changed()

    def _change_mode(self) -> None:
        self._mode_due_s = None
        ordered = self._stage.objects.get(0x6060)
        if ordered == self._mode:
            # A mapped 6060h comes with every write of the image and means nothing new.
            return
        self._mode = ordered
        self._homing.reset()
        self._positioning.reset(reached=True)

    def _forget_motion(self) -> None:
        """Drop every order of the present mode; what turns keeps turning until it is stopped."""
        self._homing.reset()
        self._positioning.reset(reached=False)

    # --- objects

    def _connect(self, objects: ObjectDictionary) -> None:
        """Hang the drive's behaviour on its dictionary."""
        getters, setters, stage = objects.getters, objects.setters, self._stage
        revs_per_minute = self.motor.spec.increments_per_unit / INCREMENTS_PER_REV * 60.0
        getters[0x6041, 0] = self._statusword
        getters[0x6061, 0] = lambda: self._mode
        getters[0x6062, 0] = getters[0x6064, 0] = self._position
        getters[0x60F4, 0] = lambda: round(stage.lag() * stage.units.position)
        getters[0x606C, 0] = lambda: round(self.motor.velocity(self.now_s) * stage.units.speed)
        getters[0x6044, 0] = lambda: round(self.motor.velocity(self.now_s) * revs_per_minute)
        getters[0x60FD, 0] = stage.inputs
        getters[0x3240, 5] = lambda: stage.inputs() >> 16
        getters[0x1001, 0] = self._error_register
        setters[0x6040, 0] = self._control
        setters[0x6060, 0] = self._order_mode
        setters[0x6098, 0] = lambda method: _require(method in METHODS)
        setters[0x60A8, 0] = lambda code: _require(known(code, timed=False))
        setters[0x60A9, 0] = lambda code: _require(known(code, timed=True))

    def _statusword(self) -> int:
        word = self.state.value | 1 << 9
        if not self._cut_off():
            word |= 1 << 4
        if self.state is PowerState.ENABLED and self._mode == HOMING:
            word |= self._homing.status_bits()
        elif self.state is PowerState.ENABLED and self._mode == PROFILE_POSITION:
            word |= self._positioning.status_bits()
        if self._positioning.refused or self._stage.active("negative") or self._stage.active("positive"):
            word |= 1 << 11
        return word

    def _position(self) -> int:
        """Return 6064h: the count (open loop); changed units count once "operation enabled" is left."""
        if self.state is not PowerState.ENABLED:
            self._stage.refresh_units()
        return round(self.motor.position(self.now_s) * self._stage.units.position)

    def _error_register(self) -> int:
        in_fault = self.state in (PowerState.FAULT, PowerState.FAULT_REACTION)
        return self.errors[0].register | 1 if in_fault and self.errors else 0


def _require(fits: bool) -> None:  # noqa: FBT001 - reads as a sentence where it is used
    if not fits:
        raise ObjectAbort(ABORT_RANGE)
