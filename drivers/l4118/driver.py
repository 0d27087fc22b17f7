"""One axis: a CiA 402 drive over the bus."""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Final

import structlog

from drivers.bus import ModbusBus
from drivers.deadline import Deadline
from drivers.errors import (
    DeadlinePassed,
    DeviceError,
    DeviceRefused,
    DriveFault,
    EnvelopeViolation,
    LinkError,
    LinkTimeout,
    MotionError,
    MotionTimeout,
    NotHomed,
)
from drivers.l4118 import objects as od
from drivers.l4118.access import DriveAccess
from drivers.l4118.arrival import ArrivalWatch
from drivers.l4118.contract import AxisConfig, AxisFindings, AxisHealth, AxisIdentity, AxisStatus
from drivers.l4118.diagnosis import Evidence, diagnose, stopped_by_program, untaken_step
from drivers.l4118.objects import Control, Mode, PowerState
from drivers.l4118.startup import prepare
from drivers.l4118.stopping import bring_to_rest, switch_off
from drivers.l4118.travel import TravelWatch
from drivers.l4118.units import SpeedUnit
from drivers.shielded import finish

# Time given to a lost line to come back for a halt
RELINK_S: Final = 1.0
# Homing where the axis stands: nothing turns, so the status never shows it under way
_HOMING_IN_PLACE = frozenset({35, 37})
# What may still be commanded after a stop: nothing of it starts a motor
_HARMLESS = frozenset(
    {Control.DISABLE_VOLTAGE, Control.QUICK_STOP, Control.SHUTDOWN, Control.HALT, Control.FAULT_RESET}
)
# What may set a motor in motion, at once or by what follows
_MAY_RUN = frozenset({Control.ENABLE, Control.START, Control.NEW_SET_POINT})
# What takes the drive out of operation enabled
_SWITCHES_OFF = frozenset(
    {Control.DISABLE_VOLTAGE, Control.QUICK_STOP, Control.SHUTDOWN, Control.SWITCH_ON, Control.FAULT_RESET}
)


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
        self._speed: SpeedUnit | None = None
        self._watch: ArrivalWatch | None = None
        self._stopped = False
        # How the drive was left: what it shows later is judged by that
        self._left_enabled = False
        self._left_homed = False
        # Whether the drive may run for all that is known: it was told to, and no stop since then was confirmed
        self._may_run = False
        # Whether bit 4 of the controlword may be set: the next set-point needs its rising edge
        self._start_bit = True
        # Keeps the order of control words: a repeated one must not overtake a stop
        self._commanding = asyncio.Lock()
        self._log = structlog.get_logger().bind(device=config.name)

    # ------------------------------------------------------------------ start and looks
    async def start(self, deadline: Deadline) -> AxisFindings:
        """Identify the drive, settle its open points, set units, ramps and limits. Moves nothing."""
        findings, self._speed = await prepare(self._drive, deadline)
        self._left_enabled, self._left_homed, self._may_run = False, findings.homed, False
        config, drive = self.config, self._drive
        ramp = self._counts(config.acceleration_units_s2)
        for entry in (od.PROFILE_ACCELERATION, od.PROFILE_DECELERATION, od.QUICK_STOP_DECELERATION):
            await drive.write_checked(entry, ramp, deadline)
        drive.velocity_counts = self._counts(config.speed_units_s)
        if findings.homed:
            await self._write_limits(deadline)
        return findings

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
        return await self._drive.status(deadline)

    async def position(self, deadline: Deadline) -> float:
        """Give where the axis is, in its unit."""
        # By FC 43: right even after a power cut has put the drive's own mapping back
        return self.config.to_units(await self._drive.read(od.POSITION_ACTUAL, deadline))

    async def homed(self, deadline: Deadline) -> bool:
        """Ask the drive for our marker: it is gone once the drive has lost power or the settings changed.

        Raises EmergencyStop when the marker was there and nobody took it away.
        """
        if await self._marked(deadline):
            return True
        if self._left_homed:
            raise await self._diagnosed(await self._drive.read(od.STATUSWORD, deadline), deadline)
        return False

    async def forget_homing(self, deadline: Deadline) -> None:
        """Take the marker away: after a fault, a stall or an emergency stop the axis may stand elsewhere."""
        self._left_homed = False
        await self._drive.write_checked(od.HOMED_MARKER, 0, deadline)

    async def health(self, deadline: Deadline) -> AxisHealth:
        """Collect what the drive says of itself, by FC 43: right whatever the process image holds."""
        drive, left_enabled = self._drive, self._left_enabled
        status = AxisStatus(
            statusword=await drive.read(od.STATUSWORD, deadline),
            mode=await drive.read(od.MODE_DISPLAY, deadline),
            position_units=await self.position(deadline),
            inputs=await drive.read(od.DIGITAL_INPUTS, deadline),
        )
        following = await drive.read_if_there(od.FOLLOWING_ERROR, deadline)
        marked = await self._marked(deadline)
        # A job may have begun or ended between the two looks at the memory: what it switched itself is no trouble
        still = left_enabled and self._left_enabled
        evidence = await self._evidence(status.statusword, deadline, marked=marked, left_enabled=still)
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
        self._stopped = False

    async def move_to(self, target_units: float, deadline: Deadline) -> AxisStatus:
        """Move to an absolute position and wait until it is there; any failure or cancellation halts the axis."""
        self.check(target_units)
        if not await self.homed(deadline):
            raise NotHomed("no reference", device=self.config.name)
        async with self._halting(f"move to {target_units:.3f}"):
            await self.begin_move(target_units, deadline)
            while not await self.arrived(deadline):  # noqa: ASYNC110 - each turn asks the drive
                await asyncio.sleep(self.config.poll_s)
        return await self.status(deadline)

    async def begin_move(self, target_units: float, deadline: Deadline, speed_units_s: float | None = None) -> None:
        """Start an absolute move: returns when the drive has acknowledged the set-point.

        `speed_units_s`: at most so fast (6081h), None: as fast as the axis may. It goes with the target, in one frame.
        """
        self.check(target_units)
        target_units = min(max(target_units, self.config.min_units), self.config.max_units)
        before = await self._enable(Mode.PROFILE_POSITION, deadline)
        if before.acknowledged or self._start_bit:
            # Bit 12 of the former set-point must be gone, else it would be taken for ours
            await self._command(Control.ENABLE, deadline)
            before = await self.status(deadline)
            await self._until(lambda s: not s.acknowledged, before, "old set-point acknowledge stays", deadline)
        self._drive.velocity_counts = self._velocity_counts(speed_units_s)
        self._drive.target_increments = self.config.to_increments(target_units)
        await self._command(Control.NEW_SET_POINT, deadline)
        status = await self.status(deadline)
        await self._until(lambda s: s.acknowledged, status, "set-point was not acknowledged", deadline)
        await self._command(Control.ENABLE, deadline)
        self._watch = ArrivalWatch(self.config, before.position_units, target_units, time.monotonic())

    async def arrived(self, deadline: Deadline) -> bool:
        """Look at a move begun before; raise LimitHit, Stalled, DriveFault or EmergencyStop when it failed."""
        watch = self._watch
        if watch is None:
            name = self.config.name
            raise stopped_by_program(name) if self._stopped else MotionError("no move", device=name)
        status = await self.status(deadline)
        await self._must_run(status, deadline)
        if self._stopped:
            raise stopped_by_program(self.config.name)
        return watch.arrived(status, time.monotonic())

    async def check_standing(self, deadline: Deadline) -> None:
        """Look at an axis that stands while others move; raise DriveFault or EmergencyStop when it lost its power."""
        status = await self.status(deadline)
        if self._left_enabled or status.state in (PowerState.FAULT, PowerState.FAULT_REACTION):
            await self._must_run(status, deadline)

    async def home(self, deadline: Deadline) -> None:
        """Find the reference; leaves the marker in the drive. Any failure or cancellation halts the axis."""
        limit = deadline.within(self.config.homing.timeout_s)
        async with self._halting("homing"):
            await self.start(limit)
            await self._prepare_homing(limit)
            await self._run_homing(limit)
        await self._write_limits(deadline)
        await self._drive.write_checked(od.HOMED_MARKER, self.config.homed_marker, deadline)
        self._left_homed = True
        await self._still_referenced(deadline)
        self._log.info("axis.homed")

    async def _still_referenced(self, deadline: Deadline) -> None:
        """Take the marker back from a drive that restarted while it was written: its count begins at any place."""
        statusword = await self._drive.statusword(deadline)
        if od.decode_state(statusword) is PowerState.OPERATION_ENABLED:
            return
        error = await self._diagnosed(statusword, deadline)
        await self.forget_homing(deadline)
        raise error

    async def _prepare_homing(self, deadline: Deadline) -> None:
        drive, homing = self._drive, self.config.homing
        await self._must_heed_switch(deadline)
        # From here on the old reference is not to be trusted, whatever comes
        await self.forget_homing(deadline)
        for entry, value in (
            (od.SOFTWARE_LIMIT_MIN, 0),
            (od.SOFTWARE_LIMIT_MAX, 0),
            (od.HOME_OFFSET, 0),
            (od.HOMING_METHOD, homing.method),
            (od.HOMING_SPEED_SWITCH, self._counts(homing.switch_speed_units_s)),
            (od.HOMING_SPEED_ZERO, self._counts(homing.zero_speed_units_s)),
            (od.HOMING_ACCELERATION, self._counts(homing.acceleration_units_s2)),
        ):
            await drive.write_checked(entry, value, deadline)

    async def _must_heed_switch(self, deadline: Deadline) -> None:
        """Raise MotionError when the drive is not told to heed the switch that the homing method looks for."""
        needs = self.config.homing_switch
        heeds = await self._drive.read_if_there(od.SWITCH_INPUTS, deadline) if needs else None
        if heeds is None or heeds & needs:
            return
        method = self.config.homing.method
        text = (
            f"homing method {method} would pass its switch: 3240h:01 = {heeds:X}h, without bit {needs.bit_length() - 1}"
        )
        advice = (
            "Set switch_inputs of this axis in the configuration (7: both limits and home), or 3240h:01 in the drive."
        )
        error = MotionError(text, device=self.config.name, advice=advice)
        error.object = od.SWITCH_INPUTS.place
        raise error

    async def _run_homing(self, deadline: Deadline) -> None:
        await self._enable(Mode.HOMING, deadline)
        await self._command(Control.ENABLE, deadline)
        status = await self.status(deadline)
        stale, travel = status.acknowledged, TravelWatch(self.config, status.position_units, time.monotonic())
        await self._command(Control.START, deadline)
        status = await self.status(deadline)
        if stale and self.config.homing.method not in _HOMING_IN_PLACE:
            await self._until(lambda s: not s.acknowledged, status, "homing did not start", deadline)
        status = await self.status(deadline)
        while not (status.acknowledged and status.target_reached):
            # First of all: a drive in fault may show any of the mode's bits
            await self._must_run(status, deadline)
            if status.mode_error:
                text = f"homing method {self.config.homing.method} failed (status {status.statusword:04X}h)"
                raise MotionError(text, device=self.config.name, advice="Check the home and limit switches.")
            travel.look(status.position_units, time.monotonic())
            await asyncio.sleep(self.config.poll_s)
            status = await self.status(deadline)
        await self._must_run(status, deadline)
        await self._command(Control.ENABLE, deadline)

    # ------------------------------------------------------------------ stops
    @asynccontextmanager
    async def _halting(self, doing: str) -> AsyncIterator[None]:
        """Halt the axis before any failure or cancellation goes on."""
        try:
            yield
        except BaseException as exc:
            await finish(self.halt_if_possible())
            if isinstance(exc, DeadlinePassed):
                text = f"{doing} was not over by its deadline"
                raise MotionTimeout(text, device=self.config.name) from exc
            raise

    async def halt(self) -> None:
        """Ramp down, wait until the axis stands, switch off; by FC 43, whatever lies in the image.

        Each step has its own deadline. Raises what the link or the drive raises; then `unstopped` is true.
        """
        self._stopped, self._watch = True, None
        await bring_to_rest(self._drive, self._command)
        self._may_run = False

    @property
    def unstopped(self) -> bool:
        """Tell whether a stop was ordered that could not be confirmed: the motor may still run."""
        return self._stopped and self._may_run

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
        self._stopped, self._watch = True, None
        await switch_off(self._drive, self._command, Control.QUICK_STOP)
        self._may_run = False

    async def reset_fault(self, deadline: Deadline) -> None:
        """Clear a fault by the rising edge of bit 7; raise what it is, such as DriveFault, when its cause remains."""
        status = await self.status(deadline)
        if status.state not in (PowerState.FAULT, PowerState.FAULT_REACTION):
            return
        limit = deadline.within(self.config.state_timeout_s)
        await self._command(Control.DISABLE_VOLTAGE, deadline)
        await self._command(Control.FAULT_RESET, deadline)
        while (status := await self.status(deadline)).state in (PowerState.FAULT, PowerState.FAULT_REACTION):
            if limit.expired:
                raise await self._diagnosed(status.statusword, deadline)
            await asyncio.sleep(self.config.poll_s)
        await self._command(Control.DISABLE_VOLTAGE, deadline)

    # ------------------------------------------------------------------ the power machine
    async def _enable(self, mode: Mode, deadline: Deadline) -> AxisStatus:
        """Bring the drive to operation enabled in `mode`, which 6061h must show before any start edge."""
        if self._speed is None:
            raise MotionError("start() has not run", device=self.config.name, advice="Call start first.")
        status = await self.status(deadline)
        if self._left_enabled or status.state in (PowerState.FAULT, PowerState.FAULT_REACTION):
            await self._must_run(status, deadline)
        if status.state is PowerState.OPERATION_ENABLED and status.mode == mode:
            self._left_enabled = True
            return status
        await self._step(Control.DISABLE_VOLTAGE, PowerState.SWITCH_ON_DISABLED, deadline)
        await self._drive.write(od.MODE, mode, deadline)
        await self._step(Control.SHUTDOWN, PowerState.READY, deadline)
        await self._step(Control.SWITCH_ON, PowerState.SWITCHED_ON, deadline)
        await self._step(Control.ENABLE, PowerState.OPERATION_ENABLED, deadline)
        self._left_enabled = True
        status = await self.status(deadline)
        await self._until(lambda s: s.mode == mode, status, f"6061h does not show mode {mode.value}", deadline)
        if mode is Mode.PROFILE_POSITION and not await self._marked(deadline):
            # It restarted on the way here; from now on a restart would end "operation enabled"
            unreferenced = NotHomed("no reference", device=self.config.name)
            raise await self._diagnosed(status.statusword, deadline, unreferenced)
        return status

    async def _step(self, control: Control, wanted: PowerState, deadline: Deadline) -> None:
        limit = deadline.within(self.config.state_timeout_s)
        await self._command(control, deadline)
        status = await self.status(deadline)
        while status.state is not wanted:
            if status.state is PowerState.FAULT:
                raise await self._diagnosed(status.statusword, deadline)
            if limit.expired:
                otherwise = untaken_step(self.config.name, control, wanted, status.statusword)
                raise await self._diagnosed(status.statusword, deadline, otherwise)
            await asyncio.sleep(self.config.poll_s)
            status = await self.status(deadline)

    async def _command(self, control: Control, deadline: Deadline) -> None:
        async with self._commanding:
            if self._stopped and control not in _HARMLESS:
                raise stopped_by_program(self.config.name)
            if control in _SWITCHES_OFF:
                self._left_enabled = False
            self._may_run = self._may_run or control in _MAY_RUN
            self._start_bit = self._start_bit or control in (Control.START, Control.NEW_SET_POINT)
            await self._drive.command(control, deadline)
            self._start_bit = control in (Control.START, Control.NEW_SET_POINT)

    async def _until(
        self, holds: Callable[[AxisStatus], bool], status: AxisStatus, otherwise: str, deadline: Deadline
    ) -> None:
        """Look again until `holds`, beginning with a look already made; the drive must keep running."""
        limit = deadline.within(self.config.state_timeout_s)
        while not holds(status):
            await self._must_run(status, deadline)
            if limit.expired:
                text = f"{otherwise} (status {status.statusword:04X}h)"
                raise MotionTimeout(text, device=self.config.name)
            await asyncio.sleep(self.config.poll_s)
            status = await self.status(deadline)

    # ------------------------------------------------------------------ what went wrong
    async def _must_run(self, status: AxisStatus, deadline: Deadline) -> None:
        """Raise what happened when the drive is no longer in operation enabled."""
        if status.state is PowerState.OPERATION_ENABLED:
            return
        raise await self._diagnosed(status.statusword, deadline)

    async def _diagnosed(
        self, statusword: int, deadline: Deadline, otherwise: MotionError | None = None
    ) -> MotionError:
        """Read what the drive says of itself and give the error it stands for, `otherwise` when it shows none."""
        name = self.config.name
        try:
            marked = await self._marked(deadline)
            evidence = await self._evidence(statusword, deadline, marked=marked, left_enabled=self._left_enabled)
        except DeviceRefused as exc:
            unread = DriveFault(f"status {statusword:04X}h; its error cannot be read: {exc}", device=name, code=0)
            unread.object, unread.exception = exc.object, exc.exception
            return unread
        if otherwise is None:
            not_running = MotionError(f"does not run (status {statusword:04X}h)", device=name)
            otherwise = stopped_by_program(name) if self._stopped else not_running
        return diagnose(name, evidence) or otherwise

    async def _evidence(self, statusword: int, deadline: Deadline, *, marked: bool, left_enabled: bool) -> Evidence:
        return Evidence(
            statusword=statusword,
            error_code=await self._drive.read(od.ERROR_CODE, deadline),
            error_entry=await self._drive.read_if_there(od.ERROR_STACK_TOP, deadline) or 0,
            left_enabled=left_enabled,
            reference_lost=self._left_homed and not marked,
        )

    async def _marked(self, deadline: Deadline) -> bool:
        """Read our marker; once seen, it is missed when it is gone."""
        marked = await self._drive.read(od.HOMED_MARKER, deadline) == self.config.homed_marker
        self._left_homed = self._left_homed or marked
        return marked

    # ------------------------------------------------------------------ small things
    def _counts(self, units_s: float) -> int:
        if self._speed is None:
            raise MotionError("start() has not run", device=self.config.name, advice="Call start first.")
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
        await self._drive.write_checked(od.SOFTWARE_LIMIT_MIN, ends[0], deadline)
        await self._drive.write_checked(od.SOFTWARE_LIMIT_MAX, ends[1], deadline)
