"""One stepper drive behind its object dictionary: power states, profile position, homing, faults (CiA 402).

Time is an argument: `update(t)` works off everything that happened up to `t`, each thing at its own time, so the
result does not depend on how often the drive is asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from sim_hw.axis import INCREMENTS_PER_REV, AxisSpec
from sim_hw.cia402 import TRANSITIONS, Command, PowerState, command_of
from sim_hw.homing import SUPPORTED, HomingStatus, Search, Stage, searches
from sim_hw.motion import Ramps
from sim_hw.motor import SWITCH_BITS, Motor, Switch
from sim_hw.objects import ABORT_RANGE, ObjectAbort, ObjectDictionary
from sim_hw.plant import Plant
from sim_hw.units import Units, known, units_for

PROFILE_POSITION, HOMING = 1, 6

#: The drive looks at a new controlword or mode once per cycle.
CYCLE_S = 0.001

# Controlword bits.
_SET_POINT, _AT_ONCE, _RELATIVE, _HALT, _FAULT_RESET = 1 << 4, 1 << 5, 1 << 6, 1 << 8, 1 << 7
_QUICK_STOP_BIT = 1 << 2


@dataclass(frozen=True)
class DriveError:
    """One error of the drive manual's list: number, class bit of 1001h, 16-bit code of 603Fh."""

    number: int
    register: int
    code: int

    @property
    def entry(self) -> int:
        """Return the 1003h entry: number, class, code."""
        return self.number << 24 | self.register << 16 | self.code


UNDER_VOLTAGE = DriveError(3, 0x04, 0x3220)
NEGATIVE_LIMIT = DriveError(10, 0x20, 0x8612)
POSITIVE_LIMIT = DriveError(11, 0x20, 0x8612)
BLOCKED = DriveError(15, 0x80, 0x7121)

Handler = Callable[[], None]


class Drive:
    """Hold a drive from one power-up to the next."""

    def __init__(self, spec: AxisSpec, plant: Plant, objects: ObjectDictionary, t_s: float) -> None:
        self._plant = plant
        self._objects = objects
        self.motor = Motor(spec, plant, t_s)
        self.now_s = t_s
        self.state = PowerState.SWITCH_ON_DISABLED
        self.errors: list[DriveError] = []
        self._units = self._configured_units()
        self._controlword = 0
        self._mode = 0
        self._mode_due_s: float | None = None
        self._after_stop: Handler | None = None
        self._forget_motion()
        self._connect()

    # --- time

    def update(self, t_s: float) -> None:
        """Work off all that happened up to a time, then what is broken at that time."""
        while True:
            due = [event for event in self._events() if event[0] <= t_s]
            if not due:
                break
            self.now_s, handler = min(due, key=lambda event: event[0])
            handler()
        self.now_s = max(t_s, self.now_s)
        self._heed_faults()

    def next_event_s(self) -> float | None:
        """Return when something is going to happen by itself, or None."""
        return min((when_s for when_s, _ in self._events()), default=None)

    def _events(self) -> Iterator[tuple[float, Handler]]:
        end_s = max(self.now_s, self.motor.demand.end_s)
        if self._mode_due_s is not None:
            moving = self.state is PowerState.ENABLED and self.motor.moving(self.now_s)
            yield (max(self._mode_due_s, end_s) if moving else self._mode_due_s), self._change_mode
        if self._set_point_due_s is not None:
            yield self._set_point_due_s, self._take_set_point
        if self._searches:
            yield from self._search_events(end_s)
        elif self.motor.moving(self.now_s) and self._after_stop is None:
            yield from self._limit_events()
        if self._after_stop is not None:
            yield end_s, self._stopped
        elif self._travelling:
            yield end_s, self._arrived

    # --- power states

    def _control(self, word: int) -> None:
        """Act on a new controlword."""
        rising, self._controlword = word & ~self._controlword, word
        if self.state is PowerState.FAULT:
            if rising & _FAULT_RESET and not self._cut_off():
                self._objects.values[0x603F, 0] = 0
                self.state = PowerState.SWITCH_ON_DISABLED
            return
        was = self.state
        command = command_of(word)
        if command is not None:
            self._obey(command, rising)
        if self.state is was is PowerState.ENABLED:
            self._operate(word, rising)

    def _obey(self, command: Command, rising: int) -> None:
        new = TRANSITIONS[self.state].get(command)
        stays = self.state is PowerState.QUICK_STOP and command is Command.ENABLE
        if new is None or (stays and not rising & _QUICK_STOP_BIT) or (stays and self._after_stop is not None):
            return
        was, self.state = self.state, new
        if was in (PowerState.ENABLED, PowerState.QUICK_STOP):
            self._leave(command)
        elif new is PowerState.ENABLED:
            self._units = self._configured_units()
        if new is PowerState.ENABLED:
            self._target_reached = True

    def _leave(self, command: Command) -> None:
        """Bring the motor to rest the way the command says."""
        self._forget_motion()
        if command is Command.DISABLE_VOLTAGE:
            self._after_stop = None
            self.motor.cut(self.now_s)
        elif command is Command.QUICK_STOP:
            self._quick_stop(self._objects.get(0x605A))
        elif self.motor.moving(self.now_s):
            self.motor.stop(self.now_s, self._rate(0x6084))

    def _quick_stop(self, option: int) -> None:
        """Stop as 605Ah says: 0 cuts, 1 and 5 brake with 6084h, 2 and 6 with 6085h; 5 and 6 stay in quick stop."""
        if option == 0:
            self.motor.cut(self.now_s)
        else:
            self.motor.stop(self.now_s, self._rate(0x6084 if option in (1, 5) else 0x6085))
        if option not in (5, 6):
            self._after_stop = self._switch_off

    def _switch_off(self) -> None:
        self.state = PowerState.SWITCH_ON_DISABLED

    def _stopped(self) -> None:
        handler, self._after_stop = self._after_stop, None
        if handler is not None:
            handler()

    # --- faults

    def _fail(self, error: DriveError) -> None:
        """Enter the fault; a motor under power is braked first."""
        self.errors = [error, *self.errors][:8]
        self._objects.values[0x603F, 0] = error.code
        self._plant.note(self.now_s, "drive_fault", {"axis": self.motor.spec.name, "number": error.number})
        self._forget_motion()
        if error is UNDER_VOLTAGE or self.state not in (PowerState.ENABLED, PowerState.QUICK_STOP):
            self.motor.cut(self.now_s)
            self._after_stop = None
            self._enter_fault()
            return
        self.state = PowerState.FAULT_REACTION
        self.motor.stop(self.now_s, self._rate(0x6085))
        self._after_stop = self._enter_fault

    def _enter_fault(self) -> None:
        self.state = PowerState.FAULT

    def _cut_off(self) -> bool:
        return self._plant.faults.on("estop")

    def _heed_faults(self) -> None:
        """Act on what is broken now."""
        if self._cut_off():
            if self.state is not PowerState.FAULT or self.motor.moving(self.now_s):
                self._fail(UNDER_VOLTAGE)
            return
        stalled = self.motor.heed_stall(self.now_s)
        if stalled and self._plant.faults.get("stall")["detected"]:
            self._fail(BLOCKED)
        elif self.state is PowerState.ENABLED and not self._searches and self.motor.moving(self.now_s):
            self._check_limit_ahead()

    # --- limits

    def _ahead(self) -> Switch:
        return "positive" if self.motor.direction() > 0.0 else "negative"

    def _watched(self, switch: Switch) -> bool:
        """Tell whether an input acts as this switch (3240h:01)."""
        return bool(self._objects.get(0x3240, 1) >> SWITCH_BITS[switch] & 1)

    def _active(self, switch: Switch) -> bool:
        return self._watched(switch) and self.motor.active(switch, self.now_s)

    def _limit_events(self) -> Iterator[tuple[float, Handler]]:
        if self.state is not PowerState.ENABLED:
            return
        ahead = self._ahead()
        when_s = self.motor.crossing(ahead, self.now_s, upwards=ahead == "positive") if self._watched(ahead) else None
        if when_s is not None:
            yield when_s, self._hit_limit

    def _hit_limit(self) -> None:
        self._fail(POSITIVE_LIMIT if self._ahead() == "positive" else NEGATIVE_LIMIT)

    def _check_limit_ahead(self) -> None:
        if self._active(self._ahead()):
            self._hit_limit()

    # --- modes of operation

    def _change_mode(self) -> None:
        self._mode_due_s = None
        self._mode = self._objects.get(0x6060)
        self._forget_motion()
        self._target_reached = True

    def _forget_motion(self) -> None:
        """Drop every order of the present mode; what turns keeps turning until it is stopped."""
        self._set_point_due_s: float | None = None
        self._acknowledged = False
        self._buffer: float | None = None
        self._target: float | None = None
        self._target_reached = False
        self._refused = False
        self._travelling = False
        self._searches: tuple[Search, ...] = ()
        self._stage = Stage.SEARCH
        self._homing = HomingStatus.INTERRUPTED

    def _operate(self, word: int, rising: int) -> None:
        if self._mode == PROFILE_POSITION:
            self._operate_position(word, rising)
        elif self._mode == HOMING:
            if rising & _SET_POINT:
                self._start_homing()
            elif self._searches and (rising & _HALT or not word & _SET_POINT):
                self._forget_motion()
                self.motor.stop(self.now_s, self._rate(0x609A))

    # --- profile position

    def _operate_position(self, word: int, rising: int) -> None:
        if rising & _SET_POINT and not self._acknowledged and self._set_point_due_s is None:
            self._set_point_due_s = self.now_s + CYCLE_S
        elif not word & _SET_POINT and self._buffer is None:
            self._acknowledged = False
        if rising & _HALT and self.motor.moving(self.now_s):
            self._travelling = False
            self.motor.stop(self.now_s, self._rate(0x6084))
        elif not word & _HALT and self._target is not None and not self._travelling and not self._target_reached:
            self._travel(self._target)

    def _take_set_point(self) -> None:
        """Take 607Ah over, one cycle after the edge of bit 4; this also withdraws the last move's "reached"."""
        self._set_point_due_s = None
        self._acknowledged = bool(self._controlword & _SET_POINT)
        target = self._checked_target(self._wanted())
        if target is None:
            self._target_reached = False
            self._target = self._target if self._travelling else None
            return
        if self._travelling and not self._controlword & _AT_ONCE:
            self._buffer, self._acknowledged = target, True
            return
        self._target_reached = False
        self._target = target
        if not self._controlword & _HALT:
            self._travel(target)

    def _wanted(self) -> float:
        """Return the position ordered by 607Ah, in machine units."""
        position = self._objects.get(0x607A) / self._units.position
        if not self._controlword & _RELATIVE:
            return position
        base = self._target if self._objects.get(0x60F2) & 3 == 0 else None
        return position + (self.motor.position(self.now_s) if base is None else base)

    def _checked_target(self, target: float) -> float | None:
        """Hold a target against 607Dh (0/0 is no limit): None if refused."""
        low, high = (self._objects.get(0x607D, sub) / self._units.position for sub in (1, 2))
        self._refused = (low, high) != (0.0, 0.0) and not low <= target <= high
        if not self._refused:
            return target
        return None if self._plant.knobs.outside_limits == "refuse" else min(max(target, low), high)

    def _travel(self, target: float) -> None:
        speed = self._objects.get(0x6081) / self._units.speed
        if speed <= 0.0:
            return
        self._travelling = True
        self.motor.go(self.now_s, target, Ramps(speed, self._rate(0x6083), self._rate(0x6084)))
        if self.motor.moving(self.now_s):
            self._check_limit_ahead()

    def _arrived(self) -> None:
        self._travelling = False
        if self._buffer is None:
            self._target_reached = True
            return
        self._target, self._buffer = self._buffer, None
        self._acknowledged = bool(self._controlword & _SET_POINT)
        self._travel(self._target)

    def _rate(self, index: int) -> float:
        return max(1, self._objects.get(index)) / self._units.acceleration

    # --- homing

    def _start_homing(self) -> None:
        self._forget_motion()
        self._searches = searches(self._objects.get(0x6098), self._active)
        if not self._searches:
            self._set_home(found=False)
            return
        self._homing = HomingStatus.RUNNING
        self._start_search()

    def _start_search(self) -> None:
        """Set out for farther than the axis is long."""
        search, spec = self._searches[0], self.motor.spec
        self._stage = Stage.SEARCH
        reach = 1.5 * (spec.hard_max - spec.hard_min) * (1.0 if search.upwards else -1.0)
        speed = max(1, self._objects.get(0x6099, 1 if search.fast else 2)) / self._units.speed
        rate = self._rate(0x609A)
        self.motor.go(self.now_s, self.motor.position(self.now_s) + reach, Ramps(speed, rate, rate))
        limit: Switch = "positive" if search.upwards else "negative"
        if limit != search.switch and self._active(limit):
            self._fail_homing()

    def _search_events(self, end_s: float) -> Iterator[tuple[float, Handler]]:
        if self._stage is Stage.BRAKE:
            yield end_s, self._next_search
            return
        search, after_s = self._searches[0], self.motor.demand.start_s
        if self._watched(search.switch):
            edge_s = self.motor.crossing(search.switch, after_s, upwards=search.upwards)
            if edge_s is not None:
                yield edge_s, self._found_edge
        limit: Switch = "positive" if search.upwards else "negative"
        if limit != search.switch and self._watched(limit):
            limit_s = self.motor.crossing(limit, after_s, upwards=search.upwards)
            if limit_s is not None:
                yield limit_s, self._fail_homing
        yield end_s, self._fail_homing

    def _found_edge(self) -> None:
        self._stage = Stage.BRAKE
        if len(self._searches) == 1:
            self._set_home(found=True)
        self.motor.stop(self.now_s, self._rate(0x609A))

    def _next_search(self) -> None:
        self._searches = self._searches[1:]
        if self._searches:
            self._start_search()
        else:
            self._homing = HomingStatus.DONE

    def _set_home(self, *, found: bool) -> None:
        offset = self._plant.knobs.home_offset_sign * self._objects.get(0x607C) / self._units.position
        self.motor.set_position(self.now_s, offset, found=found)
        if not found:
            self._homing = HomingStatus.DONE

    def _fail_homing(self) -> None:
        self._forget_motion()
        self._homing = HomingStatus.ERROR_STOPPED
        self.motor.stop(self.now_s, self._rate(0x609A))

    # --- objects

    def _connect(self) -> None:
        """Hang the drive's behaviour on its dictionary."""
        getters, setters = self._objects.getters, self._objects.setters
        revs_per_minute = self.motor.spec.increments_per_unit / INCREMENTS_PER_REV * 60.0
        getters[0x6041, 0] = self.statusword
        getters[0x6061, 0] = lambda: self._mode
        getters[0x6062, 0] = getters[0x6064, 0] = self._position
        getters[0x606C, 0] = lambda: round(self.motor.velocity(self.now_s) * self._units.speed)
        getters[0x6044, 0] = lambda: round(self.motor.velocity(self.now_s) * revs_per_minute)
        getters[0x60FD, 0] = self._inputs
        getters[0x3240, 5] = lambda: self._inputs() >> 16
        getters[0x1001, 0] = lambda: self.errors[0].register | 1 if self._in_fault() and self.errors else 0
        setters[0x6040, 0] = self._control
        setters[0x6060, 0] = self._order_mode
        setters[0x6098, 0] = lambda method: _require(method in SUPPORTED)
        setters[0x60A8, 0] = lambda code: _require(known(code, timed=False))
        setters[0x60A9, 0] = lambda code: _require(known(code, timed=True))

    def statusword(self) -> int:
        """Return 6041h."""
        word = self.state.value | 1 << 9
        if not self._cut_off():
            word |= 1 << 4
        if self.state is PowerState.ENABLED:
            word |= self._mode_bits()
        if self._refused or self._active("negative") or self._active("positive"):
            word |= 1 << 11
        return word

    def _mode_bits(self) -> int:
        if self._mode == HOMING:
            bit13, bit12, bit10 = self._homing.value
            return bit13 << 13 | bit12 << 12 | bit10 << 10
        if self._mode != PROFILE_POSITION:
            return 0
        halted = bool(self._controlword & _HALT)
        reached = not self.motor.moving(self.now_s) if halted else self._target_reached
        return self._acknowledged << 12 | reached << 10

    def _position(self) -> int:
        self._refresh_units()
        return round(self.motor.position(self.now_s) * self._units.position)

    def _inputs(self) -> int:
        raw = sum(self.motor.active(switch, self.now_s) << bit for switch, bit in SWITCH_BITS.items())
        return raw << 16 | raw & self._objects.get(0x3240, 1)

    def _in_fault(self) -> bool:
        return self.state in (PowerState.FAULT, PowerState.FAULT_REACTION)

    def _order_mode(self, mode: int) -> None:
        _require(mode in (0, PROFILE_POSITION, HOMING))
        self._mode_due_s = self.now_s + CYCLE_S

    def _refresh_units(self) -> None:
        """Take changed unit objects over; in "operation enabled" they wait."""
        if self.state is not PowerState.ENABLED:
            self._units = self._configured_units()

    def _configured_units(self) -> Units:
        return units_for(self.motor.spec, self._objects.get(0x60A8), self._objects.get(0x60A9))


def _require(fits: bool) -> None:  # noqa: FBT001 - reads as a sentence at its three uses
    if not fits:
        raise ObjectAbort(ABORT_RANGE)
