"""The power machine of one drive (CiA 402), how it was left, and what is wrong when it is found otherwise."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

from drivers.deadline import Deadline
from drivers.errors import DeviceRefused, DriveFault, MotionError, MotionTimeout, NotHomed
from drivers.l4118 import objects as od
from drivers.l4118.access import DriveAccess
from drivers.l4118.contract import AxisStatus
from drivers.l4118.diagnosis import Evidence, diagnose, stopped_by_program, untaken_step
from drivers.l4118.objects import Control, Mode, PowerState
from drivers.l4118.stopping import bring_to_rest, switch_off

StopOthers = Callable[[], Awaitable[None]]
# Time given to a drive that does not run to say why, once all else stands
NAMED_WITHIN_S: Final = 1.0
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


class PowerMachine:
    """Switches one drive on and off and knows how it was left: what the drive shows later is judged by that."""

    def __init__(self, drive: DriveAccess) -> None:
        self.config = drive.config
        self.stopped = False
        """Set by a stop, which wins over a move under way: nothing starts the motor until it is cleared."""
        self.left_enabled = False
        self.left_homed = False
        self.may_run = False
        """Whether it may run for all that is known: it was told to, and no stop since then was confirmed."""
        self.proved = False
        """Whether the marker was seen while it ran: as long as it runs since then it has not restarted, and has it."""
        self.start_bit = True
        """Whether bit 4 of the controlword may be set: the next set-point needs its rising edge."""
        self.stop_others: StopOthers | None = None
        """What is done, while it is set, before a drive that does not run is asked why: to ask takes a while."""
        self._drive = drive
        # Keeps the order of control words: a repeated one must not overtake a stop
        self._commanding = asyncio.Lock()

    def found(self, *, homed: bool) -> None:
        """Take the drive as the self-test found it: switched off, with or without a reference."""
        self.left_enabled, self.left_homed, self.may_run, self.proved = False, homed, False, False

    async def halt(self) -> None:
        """Ramp down, wait until the axis stands, switch off; each step has its own deadline."""
        self.stopped = True
        await bring_to_rest(self._drive, self.command)
        self.may_run = False

    async def quick_stop(self) -> None:
        """Stop on the quick-stop ramp, then switch off."""
        self.stopped = True
        await switch_off(self._drive, self.command, Control.QUICK_STOP)
        self.may_run = False

    async def enable(self, mode: Mode, deadline: Deadline, status: AxisStatus | None = None) -> AxisStatus:
        """Bring the drive to operation enabled in `mode`, which 6061h must show before any start edge.

        `status`: a look at the drive just before; None: it is looked at.
        """
        status = status or await self._drive.status(deadline)
        if self.left_enabled or status.state in (PowerState.FAULT, PowerState.FAULT_REACTION):
            await self.must_run(status, deadline)
        if status.state is PowerState.OPERATION_ENABLED and status.mode == mode:
            self.left_enabled = True
            return status
        await self._step(Control.DISABLE_VOLTAGE, PowerState.SWITCH_ON_DISABLED, deadline)
        await self._drive.write(od.MODE, mode, deadline)
        await self._step(Control.SHUTDOWN, PowerState.READY, deadline)
        await self._step(Control.SWITCH_ON, PowerState.SWITCHED_ON, deadline)
        await self._step(Control.ENABLE, PowerState.OPERATION_ENABLED, deadline)
        self.left_enabled = True
        status = await self._drive.status(deadline)
        await self.until(lambda s: s.mode == mode, status, "the drive does not change what it is to do", deadline)
        if mode is Mode.PROFILE_POSITION:
            if not await self.marked(deadline):
                # It restarted on the way here; from now on a restart would end "operation enabled"
                unreferenced = NotHomed("no reference", device=self.config.name)
                raise await self.diagnosed(status.statusword, deadline, unreferenced)
            self.proved = True
        return status

    async def _step(self, control: Control, wanted: PowerState, deadline: Deadline) -> None:
        limit = deadline.within(self.config.state_timeout_s)
        await self.command(control, deadline)
        status = await self._drive.status(deadline)
        while status.state is not wanted:
            if status.state is PowerState.FAULT:
                raise await self.diagnosed(status.statusword, deadline)
            if limit.expired:
                otherwise = untaken_step(self.config.name, control, wanted, status.statusword)
                raise await self.diagnosed(status.statusword, deadline, otherwise)
            await asyncio.sleep(self.config.poll_s)
            status = await self._drive.status(deadline)

    async def command(self, control: Control, deadline: Deadline) -> None:
        """Write a control word, and remember what it leads to; after a stop nothing that could start the motor."""
        async with self._commanding:
            if self.stopped and control not in _HARMLESS:
                raise stopped_by_program(self.config.name)
            if control in _SWITCHES_OFF:
                self.left_enabled = self.proved = False
            self.may_run = self.may_run or control in _MAY_RUN
            self.start_bit = self.start_bit or control in (Control.START, Control.NEW_SET_POINT)
            await self._drive.command(control, deadline)
            self.start_bit = control in (Control.START, Control.NEW_SET_POINT)

    async def until(
        self, holds: Callable[[AxisStatus], bool], status: AxisStatus, otherwise: str, deadline: Deadline
    ) -> None:
        """Look again until `holds`, beginning with a look already made; the drive must keep running."""
        limit = deadline.within(self.config.state_timeout_s)
        while not holds(status):
            await self.must_run(status, deadline)
            if limit.expired:
                technical = f"status {status.statusword:04X}h"
                raise MotionTimeout(otherwise, device=self.config.name, technical=technical)
            await asyncio.sleep(self.config.poll_s)
            status = await self._drive.status(deadline)

    # ------------------------------------------------------------------ what went wrong
    async def must_run(self, status: AxisStatus, deadline: Deadline, stop_others: StopOthers | None = None) -> None:
        """Raise what happened when the drive is no longer in operation enabled.

        `stop_others`: done first, before the drive is asked why.
        """
        if status.state is PowerState.OPERATION_ENABLED:
            return
        raise await self.diagnosed(status.statusword, await self._others_stopped(deadline, stop_others))

    async def _others_stopped(self, deadline: Deadline, stop_others: StopOthers | None) -> Deadline:
        """Stop what else moves, if that is wanted; return the deadline of the question that comes next."""
        if stop_others is None:
            return deadline
        await stop_others()
        # Stopping took its time, and must not make a time-out of what the drive has met
        return max(deadline, Deadline.after(NAMED_WITHIN_S), key=lambda one: one.at_s)

    async def diagnosed(self, statusword: int, deadline: Deadline, otherwise: MotionError | None = None) -> MotionError:
        """Read what the drive says of itself and give the error it stands for, `otherwise` when it shows none."""
        name = self.config.name
        deadline = await self._others_stopped(deadline, self.stop_others)
        try:
            marked = await self.marked(deadline)
            evidence = await self.evidence(statusword, deadline, marked=marked, left_enabled=self.left_enabled)
        except DeviceRefused as exc:
            technical = f"status {statusword:04X}h; {exc.technical}"
            text = f"the drive does not run, and its error cannot be read: {exc.message}"
            unread = DriveFault(text, device=name, code=0, technical=technical)
            unread.object, unread.exception = exc.object, exc.exception
            return unread
        if otherwise is None:
            not_running = MotionError("does not run", device=name, technical=f"status {statusword:04X}h")
            otherwise = stopped_by_program(name) if self.stopped else not_running
        return diagnose(name, evidence) or otherwise

    async def evidence(self, statusword: int, deadline: Deadline, *, marked: bool, left_enabled: bool) -> Evidence:
        """Read what the drive's trouble is judged by."""
        return Evidence(
            statusword=statusword,
            error_code=await self._drive.read(od.ERROR_CODE, deadline),
            error_entry=await self._drive.read_if_there(od.ERROR_STACK_TOP, deadline) or 0,
            left_enabled=left_enabled,
            reference_lost=self.left_homed and not marked,
        )

    async def marked(self, deadline: Deadline) -> bool:
        """Read our marker; once seen, it is missed when it is gone."""
        marked = await self._drive.read(od.HOMED_MARKER, deadline) == self.config.homed_marker
        self.left_homed = self.left_homed or marked
        return marked
