"""One axis: a CiA 402 drive over the bus."""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Awaitable
from contextlib import asynccontextmanager
from typing import Final

import structlog

from drivers.bus import ModbusBus
from drivers.deadline import Deadline
from drivers.errors import (
    DeadlinePassed,
    DeviceError,
    EnvelopeViolation,
    LinkError,
    LinkTimeout,
    MotionError,
    MotionTimeout,
    NotHomed,
)
from drivers.l4118 import homing
from drivers.l4118 import objects as od
from drivers.l4118.access import DriveAccess
from drivers.l4118.arrival import ArrivalWatch, TakenWatch, seen_to_go, travel_s
from drivers.l4118.contract import AxisConfig, AxisFindings, AxisHealth, AxisIdentity, AxisStatus
from drivers.l4118.diagnosis import not_started, stopped_by_program
from drivers.l4118.last_look import LastLook
from drivers.l4118.objects import Control, Mode, PowerState
from drivers.l4118.power import PowerMachine, StopOthers
from drivers.l4118.startup import prepare, quieten
from drivers.l4118.units import SpeedUnit
from drivers.shielded import finish

# Time given to a lost line to come back for a halt
RELINK_S: Final = 1.0


class Axis:
    """One axis, in its own unit (um or deg). Call `start` first; it moves nothing.

    Moves are absolute only: repeating one cannot double it. `halt` and `quick_stop` win over a move that is
    going on in another task: its next command raises EmergencyStop instead of starting the drive again.

    The axis remembers how it left its drive, enabled and with a reference. A drive found otherwise was switched off
    from outside, and whatever asks for it next raises EmergencyStop, until `start` takes the drive as it is.
    """

    def __init__(self, bus: ModbusBus, config: AxisConfig) -> None:
        self.config = config
        self._drive = DriveAccess(bus, config)
        self._power = PowerMachine(self._drive)
        self._speed: SpeedUnit | None = None
        self._watch: ArrivalWatch | None = None
        self._last = LastLook()
        self._under_way = False
        self._taken = True
        self._taking: TakenWatch | None = None
        self._taken_by = Deadline.after(0.0)
        self._begun_at_units = self._target_units = 0.0
        self._speed_units_s = config.speed_units_s
        self.due_s = 0.0
        """When a move begun before can be over, by its trapezoid and the monotonic clock: no use to look earlier."""
        self._log = structlog.get_logger().bind(device=config.name)

    # ------------------------------------------------------------------ start and looks
    async def start(self, deadline: Deadline) -> AxisFindings:
        """Identify the drive, settle its open points, set units, ramps and limits. Moves nothing."""
        self._last.forget(time.monotonic())
        findings, self._speed = await prepare(self._drive, deadline)
        self._power.found(homed=findings.homed)
        config, drive = self.config, self._drive
        ramp = self._counts(config.acceleration_units_s2)
        for entry in (od.PROFILE_ACCELERATION, od.PROFILE_DECELERATION, od.QUICK_STOP_DECELERATION):
            await drive.ensure(entry, ramp, deadline)
        if findings.homed:
            await self._write_limits(deadline)
        return findings

    async def rest(self, deadline: Deadline) -> None:
        """Stop a drive that somebody else may have left running; `start` is still to be called before it moves."""
        await quieten(self._drive, deadline)

    async def identity(self, deadline: Deadline) -> AxisIdentity:
        """Ask the drive who it is; a number it does not give is zero."""
        entries = (od.VENDOR_ID, od.PRODUCT_CODE, od.REVISION, od.SERIAL_NUMBER)
        return AxisIdentity(*[await self._drive.read_if_there(entry, deadline) or 0 for entry in entries])

    async def settings(self, deadline: Deadline) -> dict[str, int | None]:
        """Read motor, switch and stop settings as they are, by object ("605Ah:00"); None: no such object."""
        return {entry.place: await self._drive.read_if_there(entry, deadline) for entry in od.SETTINGS}

    async def statusword(self, deadline: Deadline) -> int:
        """Read 6041h by FC 43, the shortest question there is."""
        return await self._drive.statusword(deadline)

    async def status(self, deadline: Deadline) -> AxisStatus:
        """Look at the axis."""
        asked_s = time.monotonic()
        status = await self._drive.status(deadline)
        self._last.note(status, asked_s)
        return status

    @property
    def looked_at_s(self) -> float:
        """When it was last looked at, monotonic; minus infinity where it was told something since."""
        return self._last.at_s

    async def raw_input(self, number: int, deadline: Deadline) -> bool:
        """Tell whether an input of the drive, from 1, is high, whatever it is used for (60FDh from bit 16 on)."""
        return bool(await self._drive.read(od.DIGITAL_INPUTS, deadline) >> (od.DI_RAW_BIT + number - 1) & 1)

    async def position(self, deadline: Deadline, since_s: float = math.inf) -> float:
        """Give where the axis is, in its unit; where it stands, a look taken since `since_s` (monotonic) will do."""
        status = await self._running(deadline, since_s)
        if status is not None:
            return status.position_units
        # By FC 43: right even after a power cut has put the drive's own mapping back
        return self.config.to_units(await self._drive.read(od.POSITION_ACTUAL, deadline))

    async def homed(self, deadline: Deadline, since_s: float = math.inf) -> bool:
        """Ask the drive for our marker: it is gone once the drive has lost power or the settings changed.

        A drive that still runs since the marker was seen has it: a restart ends "operation enabled". A look taken since
        `since_s` (monotonic) tells whether it does; infinity: it is looked at. Raises EmergencyStop when the marker was
        there and nobody took it away.
        """
        if await self._running(deadline, since_s) is not None:
            return True
        if await self._power.marked(deadline):
            return True
        if self._power.left_homed:
            raise await self._power.diagnosed(await self._drive.read(od.STATUSWORD, deadline), deadline)
        return False

    async def _running(self, deadline: Deadline, since_s: float) -> AxisStatus | None:
        """Give a look at a drive that runs since its marker was seen, None where another question is to be asked.

        Of an axis that stands, a look taken since `since_s` (monotonic) will do.
        """
        if not self._power.proved:
            return None
        status = None if self._under_way else self._last.since(since_s)
        status = status or await self.status(deadline)
        # A stop may have come in between
        return status if self._power.proved and status.state is PowerState.OPERATION_ENABLED else None

    async def forget_homing(self, deadline: Deadline) -> None:
        """Take the marker away: after a fault, a stall or an emergency stop the axis may stand elsewhere."""
        self._power.left_homed = self._power.proved = False
        self._last.forget(time.monotonic())
        await self._drive.write_checked(od.HOMED_MARKER, 0, deadline)

    async def health(self, deadline: Deadline) -> AxisHealth:
        """Collect what the drive says of itself, by FC 43: right whatever the process image holds."""
        drive, left_enabled = self._drive, self._power.left_enabled
        status = AxisStatus(
            statusword=await drive.read(od.STATUSWORD, deadline),
            mode=await drive.read(od.MODE_DISPLAY, deadline),
            position_units=self.config.to_units(await drive.read(od.POSITION_ACTUAL, deadline)),
            inputs=await drive.read(od.DIGITAL_INPUTS, deadline),
        )
        following = await drive.read_if_there(od.FOLLOWING_ERROR, deadline)
        marked = await self._power.marked(deadline)
        # A job may have begun or ended between the two looks at the memory: what it switched itself is no trouble
        still = left_enabled and self._power.left_enabled
        evidence = await self._power.evidence(status.statusword, deadline, marked=marked, left_enabled=still)
        return AxisHealth(
            name=self.config.name,
            state=status.state.value if status.state else f"unknown ({status.statusword:04X}h)",
            homed=marked,
            position_units=status.position_units,
            error_code=evidence.error_code,
            error_meaning=od.error_meaning(evidence.error_entry),
            warning=bool(status.statusword & od.SW_WARNING),
            negative_limit=status.negative_limit,
            positive_limit=status.positive_limit,
            following_error_units=None if following is None else following / self.config.increments_per_unit,
            evidence=evidence,
        )

    # ------------------------------------------------------------------ moves
    def check(self, target_units: float) -> None:
        """Raise EnvelopeViolation when the target is outside of the axis' range."""
        low, high = self.config.min_units, self.config.max_units
        # What the drive reads back at an end of the range may be off by a rounded increment
        slack = self.config.increment_units
        if not low - slack <= target_units <= high + slack:
            text = f"target {target_units:.3f} is outside of {low:.3f}..{high:.3f}"
            raise EnvelopeViolation(text, device=self.config.name)

    def release(self) -> None:
        """Allow moves again after a stop or a failure; only the owner of the machine decides that."""
        self._power.stopped = False

    async def move_to(self, target_units: float, deadline: Deadline) -> AxisStatus:
        """Move to an absolute position and wait until it is there; any failure or cancellation halts the axis."""
        self.check(target_units)
        since_s = time.monotonic()
        if not await self.homed(deadline):
            raise NotHomed("no reference", device=self.config.name)
        async with self._halting(f"move to {target_units:.3f}"):
            await self.aim(target_units, deadline, since_s=since_s)
            await self.go(deadline)
            while not await self.arrived(deadline):
                await self.let_go(deadline)
                await asyncio.sleep(self.config.poll_s)
            await self.let_go(deadline)
        return self._last.since(since_s) or await self.status(deadline)

    async def begin_move(self, target_units: float, deadline: Deadline, speed_units_s: float | None = None) -> None:
        """Start an absolute move: `aim`, and at once `go`."""
        await self.aim(target_units, deadline, speed_units_s)
        await self.go(deadline)

    async def aim(
        self,
        target_units: float,
        deadline: Deadline,
        speed_units_s: float | None = None,
        since_s: float = math.inf,
    ) -> None:
        """Make the drive ready for an absolute move: it runs, and has target and speed. Nothing moves yet.

        `speed_units_s`: at most so fast (6081h), None: as fast as the axis may. It is written where it changes.
        `since_s`: a look taken since then (monotonic) tells whether it runs; infinity: it is looked at.
        """
        self.check(target_units)
        target_units = min(max(target_units, self.config.min_units), self.config.max_units)
        if self._speed is None:
            raise not_started(self.config.name)
        seen = self._last.since(since_s)
        if seen is not None and not self._goes_by(seen, target_units):
            seen = None  # what it showed is over, or is to be seen to be over; only a drive that runs may go unasked
        before = await self._power.enable(Mode.PROFILE_POSITION, deadline, seen or await self.status(deadline))
        old_stands = before.acknowledged or self._power.start_bit
        if self._power.start_bit or (before.acknowledged and seen is None):
            await self._power.command(Control.ENABLE, deadline)
        if old_stands and not seen_to_go(self.config, before, target_units):
            # Bit 12 of the former set-point must be gone, else it would be taken for ours
            before = await self.status(deadline)
            await self._power.until(lambda s: not s.acknowledged, before, "old set-point acknowledge stays", deadline)
            old_stands = False
        self._taking = TakenWatch(self.config, before, old_stands=old_stands)
        self._last.forget(time.monotonic())
        self._watch = None
        self._begun_at_units, self._target_units = before.position_units, target_units
        self._speed_units_s = min(speed_units_s or math.inf, self.config.speed_units_s)
        await self._drive.aim(self.config.to_increments(target_units), self._velocity_counts(speed_units_s), deadline)

    def aims_at_once(self, target_units: float, since_s: float) -> bool:
        """Tell whether by a look taken since then (monotonic) `aim` is writing alone: nothing is to be asked."""
        seen = self._last.since(since_s)
        return seen is not None and seen.mode == Mode.PROFILE_POSITION and self._goes_by(seen, target_units)

    def _goes_by(self, seen: AxisStatus, target_units: float) -> bool:
        """Tell whether a look that is there already will do to aim by."""
        over = not (seen.acknowledged or self._power.start_bit)
        return seen.state is PowerState.OPERATION_ENABLED and (over or seen_to_go(self.config, seen, target_units))

    async def go(self, deadline: Deadline) -> None:
        """Start the move that was aimed at; `arrived` sees that the drive has taken it."""
        self._under_way, self._taken = True, False
        await self._power.command(Control.NEW_SET_POINT, deadline)
        now_s, way = time.monotonic(), self._target_units - self._begun_at_units
        self.due_s = now_s + travel_s(way, self._speed_units_s, self.config.acceleration_units_s2)
        self._taken_by = Deadline.after(self.config.state_timeout_s)
        self._watch = ArrivalWatch(self.config, self._begun_at_units, self._target_units, now_s)

    async def arrived(self, deadline: Deadline, stop_others: StopOthers | None = None) -> bool:
        """Look at a move begun before; raise LimitHit, Stalled, DriveFault or EmergencyStop when it failed.

        `stop_others`: done as soon as the drive is seen not to run, before it is asked why.
        Nothing is believed before the drive has acknowledged the set-point (bit 12), which clears the bits of the one
        before; then bit 4 may fall (`let_go`), so that it can rise for the next.
        """
        watch = self._watch
        if watch is None:
            name = self.config.name
            raise stopped_by_program(name) if self._power.stopped else MotionError("no move", device=name)
        status = await self.status(deadline)
        await self._power.must_run(status, deadline, stop_others)
        if self._power.stopped:
            raise stopped_by_program(self.config.name)
        if not self._taken:
            if not self._take(status):
                return False
            watch.taken(time.monotonic())
        there = watch.arrived(status, time.monotonic())
        self._under_way = not there
        return there

    def _take(self, status: AxisStatus) -> bool:
        """Tell whether the set-point was acknowledged; raise MotionTimeout when it was not in time."""
        if self._taking is not None and self._taking.taken(status):
            self._taken = True
        elif self._taken_by.expired:
            technical = f"set-point was not acknowledged, status {status.statusword:04X}h"
            raise MotionTimeout("the drive did not take its target", device=self.config.name, technical=technical)
        return self._taken

    @property
    def holds_start(self) -> bool:
        """Whether bit 4 still stands of a set-point that the drive has taken: it has to fall before it can rise."""
        return self._watch is not None and self._taken and self._power.start_bit

    async def let_go(self, deadline: Deadline) -> None:
        """Let bit 4 fall, where it stands of a set-point that the drive has taken."""
        if self.holds_start:
            await self._power.command(Control.ENABLE, deadline)

    async def check_standing(self, deadline: Deadline, stop_others: StopOthers | None = None) -> None:
        """Look at an axis that stands while others move; raise DriveFault or EmergencyStop when it lost its power.

        `stop_others`: done as soon as that is seen, before the drive is asked why.
        """
        status = await self.status(deadline)
        if self._power.left_enabled or status.state in (PowerState.FAULT, PowerState.FAULT_REACTION):
            await self._power.must_run(status, deadline, stop_others)

    async def home(self, deadline: Deadline, stop_others: StopOthers | None = None) -> None:
        """Find the reference; leaves the marker in the drive. Any failure or cancellation halts the axis.

        `stop_others`: done when the run fails, beside this axis' own halt and before its drive is asked why.
        """
        self._power.stop_others = stop_others
        try:
            await self._home(deadline, stop_others)
        finally:
            self._power.stop_others = None

    async def _home(self, deadline: Deadline, stop_others: StopOthers | None) -> None:
        limit = deadline.within(self.config.homing.timeout_s)
        async with self._halting("homing", stop_others):
            await self.start(limit)
            self._watch = None
            await homing.must_heed_switch(self._drive, limit)
            # From here on the old reference is not to be trusted, whatever comes
            await self.forget_homing(limit)
            await homing.set_up(self._drive, self._counts, limit)
            await homing.run(self._drive, self._power, limit)
        await self._write_limits(deadline)
        await self._drive.write_checked(od.HOMED_MARKER, self.config.homed_marker, deadline)
        self._power.left_homed = True
        self._last.forget(time.monotonic())  # what stood aside was looked at before it homed
        await self._still_referenced(deadline)
        self._log.info("axis.homed")

    async def _still_referenced(self, deadline: Deadline) -> None:
        """Take the marker back from a drive that restarted while it was written: its count begins at any place."""
        statusword = await self._drive.statusword(deadline)
        if od.decode_state(statusword) is PowerState.OPERATION_ENABLED:
            return
        error = await self._power.diagnosed(statusword, deadline)
        await self.forget_homing(deadline)
        raise error

    # ------------------------------------------------------------------ stops
    @asynccontextmanager
    async def _halting(self, doing: str, stop_others: StopOthers | None = None) -> AsyncIterator[None]:
        """Halt the axis before any failure or cancellation goes on; after a failure stop the others beside it."""
        try:
            yield
        except BaseException as exc:
            others = [stop_others()] if stop_others is not None and isinstance(exc, Exception) else []
            await finish(_together(self.halt_if_possible(), *others))
            if isinstance(exc, DeadlinePassed):
                text = f"{doing} was not over by its deadline"
                raise MotionTimeout(text, device=self.config.name) from exc
            raise

    async def halt(self) -> None:
        """Ramp down, wait until the axis stands, switch off; by FC 43, whatever lies in the image.

        Each step has its own deadline. Raises what the link or the drive raises; then `unstopped` is true.
        """
        self._watch = None
        self._last.forget(time.monotonic())
        try:
            await self._power.halt()
        finally:
            self._last.forget(time.monotonic())  # also what was seen on the ramp

    @property
    def unstopped(self) -> bool:
        """Tell whether a stop was ordered that could not be confirmed: the motor may still run."""
        return self._power.stopped and self._power.may_run

    async def halt_if_possible(self) -> None:
        """Halt as the answer to another failure, which must not be hidden: what goes wrong here is only logged.

        A line that is lost gets a second to come back: a motor may be running at its other end.
        """
        limit = Deadline.after(RELINK_S)
        while True:
            try:
                await self.halt()
                return
            except DeviceError as exc:
                link_lost = isinstance(exc, LinkError) and not isinstance(exc, LinkTimeout)
                if limit.expired or not link_lost:
                    self._log.error("axis.halt_failed", cause=str(exc))
                    return
            await asyncio.sleep(RELINK_S / 10)

    async def quick_stop(self) -> None:
        """Stop on the quick-stop ramp (6085h). Has its own deadlines; homing is kept.

        Raises what the link or the drive raises; then `unstopped` is true.
        """
        self._watch = None
        self._last.forget(time.monotonic())
        try:
            await self._power.quick_stop()
        finally:
            self._last.forget(time.monotonic())  # also what was seen on the ramp

    async def reset_fault(self, deadline: Deadline) -> None:
        """Clear a fault by the rising edge of bit 7; raise what it is, such as DriveFault, when its cause remains."""
        status = await self.status(deadline)
        if status.state not in (PowerState.FAULT, PowerState.FAULT_REACTION):
            return
        limit = deadline.within(self.config.state_timeout_s)
        self._last.forget(time.monotonic())
        await self._power.command(Control.DISABLE_VOLTAGE, deadline)
        await self._power.command(Control.FAULT_RESET, deadline)
        while (status := await self.status(deadline)).state in (PowerState.FAULT, PowerState.FAULT_REACTION):
            if limit.expired:
                raise await self._power.diagnosed(status.statusword, deadline)
            await asyncio.sleep(self.config.poll_s)
        await self._power.command(Control.DISABLE_VOLTAGE, deadline)
        self._last.forget(time.monotonic())

    # ------------------------------------------------------------------ small things
    def _counts(self, units_s: float) -> int:
        if self._speed is None:
            raise not_started(self.config.name)
        wanted = units_s * abs(self.config.increments_per_unit)
        counts = self._speed.counts(wanted)
        real = counts * self._speed.increments_s
        if abs(real - wanted) > 0.25 * wanted:
            self._log.warning("axis.coarse_speed_unit", wanted_increments_s=wanted, set_increments_s=real)
        return counts

    def _velocity_counts(self, speed_units_s: float | None) -> int:
        """Give the profile speed as the drive counts it; a limit is rounded down, for faster is what must not be."""
        own = self._counts(self.config.speed_units_s)
        if speed_units_s is None or self._speed is None:
            return own
        limit = speed_units_s * abs(self.config.increments_per_unit) / self._speed.increments_s
        return min(own, max(1, math.floor(limit + 1e-6)))

    async def _write_limits(self, deadline: Deadline) -> None:
        """Give the drive the axis' range as 607Dh, so that it guards it too."""
        ends = sorted(map(self.config.to_increments, (self.config.min_units, self.config.max_units)))
        await self._drive.ensure(od.SOFTWARE_LIMIT_MIN, ends[0], deadline)
        await self._drive.ensure(od.SOFTWARE_LIMIT_MAX, ends[1], deadline)


async def _together(*work: Awaitable[None]) -> None:
    await asyncio.gather(*work)
