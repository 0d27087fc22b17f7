"""The supervisor of the station: opens the devices, resets faults, and looks after the drives while nothing runs.

It alone says that a fault is over, and only after it has asked the devices. `reset` and every check hold the
station's lock: no job begins while they work, and none runs.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable
from typing import Any

import structlog

from daemon.config.current import CurrentSettings
from daemon.config.model import Config
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import BUSY, State
from daemon.jobs.context import StationContext
from daemon.jobs.fault_latch import AXES, FaultLatch
from daemon.jobs.station_lock import StationLock
from daemon.station.device_errors import as_fault
from daemon.station.devices import Hardware
from daemon.station.kinematics import Geometry
from daemon.station.safe_shutdown import UNSURE, shut_down
from daemon.station.station import Station
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal
from drivers.deadline import Deadline
from drivers.errors import DeadlinePassed, DeviceError, LinkTimeout

OPEN_WITHIN_S = 20.0
FRAME_WITHIN_S = 8.0
"""What a camera that was lost may take to come back, once its cause is gone."""
STOP_AGAIN_S = 0.1
"""Pause between two tries to stop what may still run."""
DOUBT = "reference_doubt"
"""Name under which the journal keeps the axes in doubt: a kill must not make anybody believe their drives."""
OpenDevices = Callable[[Config, Deadline], Awaitable[Hardware]]
log = structlog.get_logger(__name__)


class StationSupervisor:
    """The devices of one daemon, and what is known against working with them."""

    def __init__(
        self,
        settings: CurrentSettings,
        latch: FaultLatch,
        lock: StationLock,
        calibrations: Calibrations,
        journal: Journal,
        open_devices: OpenDevices,
    ) -> None:
        self._settings, self._latch, self._lock = settings, latch, lock
        self._calibrations, self._journal = calibrations, journal
        self._open_devices = open_devices
        self._hardware: Hardware | None = None
        self._context: StationContext | None = None

    @property
    def hardware(self) -> Hardware | None:
        """The open devices, None while there are none."""
        return self._hardware

    def context(self) -> StationContext | None:
        """Return what jobs work with at present, None while no device is open."""
        return self._context

    def refresh_context(self) -> None:
        """Lay out what jobs work with by the settings in force."""
        if self._hardware is None:
            return
        config, board = self._settings.config, self._settings.board
        geometry = Geometry(config, board, self._calibrations)
        self._context = StationContext(config, Station(config, self._hardware), board, self._calibrations, geometry)

    # --- opening and reset -----------------------------------------------------------------------------------

    async def open(self) -> None:
        """Open the devices for the first time; what keeps the station closed becomes its fault."""
        kept = await self._journal.kept(DOUBT)
        self._latch.doubt(axis for axis in AXES if kept is not None and axis in kept.get("axes", ()))
        await self.reset()
        self._latch.opened()

    async def reset(self) -> Fault | None:
        """Open what is not open, clear what the drives hold, and clear the faults latched so far if nothing is wrong.

        Returns what still speaks against work; then nothing was cleared. Raises `Fault` (busy) while a job runs.
        """
        if self._lock.holder == "job" or self._latch.state in BUSY:
            raise Fault(FaultCode.BUSY, "a job runs; cancel it first")
        async with self._lock.hold("reset"):
            taken = self._latch.causes
            try:
                await self._make_fit(taken)
            except Exception as exc:  # noqa: BLE001  # whatever keeps the station closed becomes its fault
                return self._still_in_fault(taken, exc)
            self._latch.clear(taken)
            return None

    def _still_in_fault(self, taken: tuple[Fault, ...], error: Exception) -> Fault:
        """Latch what was found in front of what was latched before, and return it."""
        found = _latched(as_fault(error))
        if found.kind is FaultCode.INTERNAL:
            log.error("opening_failed_internally", exc_info=error)
        if found.kind is FaultCode.NOT_HOMED:
            self._latch.replace(taken, found)  # asked for last: all else is known to be well
        else:
            self._latch.put_first(found)
        log.error("station_not_ready", error=found.message, advice=found.advice)
        return found

    async def _make_fit(self, taken: tuple[Fault, ...]) -> None:
        """Open the devices if need be, and see that they are fit to work; raise what is wrong.

        What needs a person is asked last: `not_homed` means that everything else is well.
        """
        deadline = Deadline.after(OPEN_WITHIN_S)
        if self._hardware is None:
            fit = await self._open(deadline)
        else:
            fit = False
            if await self._hardware.in_trouble(deadline):
                self._latch.doubt(AXES)
            await self._settle_doubts(self._hardware, deadline)
            await self._hardware.recover(deadline)
        hardware = self._hardware
        assert hardware is not None  # noqa: S101  # opened above
        await self._settle_doubts(hardware, deadline)
        if not fit:
            await hardware.check_health(deadline)
        for cause in taken:
            await self._check_cause(cause, hardware)
        if not await hardware.gantry.homed(deadline):
            raise Fault(FaultCode.NOT_HOMED)

    async def _open(self, deadline: Deadline) -> bool:
        """Open the devices; return whether the drives' self-test found them fit."""
        self._calibrations.load()
        self._hardware = hardware = await self._open_devices(self._settings.config, deadline)
        self.refresh_context()
        log.info("station_open", camera=dict(hardware.camera.settings()))
        return all(axis.fit for axis in hardware.found.values())

    async def _check_cause(self, cause: Fault, hardware: Hardware) -> None:
        """Raise if the cause of a fault is still there that the drives know nothing of."""
        match cause.kind:
            case FaultCode.CAMERA_FAILED:
                await hardware.camera.frame_after(time.monotonic(), Deadline.after(FRAME_WITHIN_S))
            case FaultCode.JOURNAL_FAILED:
                await self._journal.keep(DOUBT, {"axes": sorted(self._latch.doubtful)})
            case _:
                pass

    async def _settle_doubts(self, hardware: Hardware, deadline: Deadline) -> None:
        """Take the reference from every axis in doubt; one that is known to have lost it is in doubt no longer."""
        doubtful = sorted(self._latch.doubtful)
        errors: list[DeviceError] = []
        for axis in doubtful:
            try:
                await hardware.gantry.forget_homing(deadline, [axis])
                self._latch.settle(axis)
            except DeviceError as exc:
                errors.append(exc)
        if doubtful:
            await self._keep_doubts()
        if errors:
            raise errors[0]

    # --- while nothing runs ----------------------------------------------------------------------------------

    async def run(self) -> None:
        """Look after the drives until cancelled.

        An e-stop or a pulled cable is noticed before the next job, and what a lost stop left running is stopped as soon
        as its drive answers, in every state of the station.
        """
        async with asyncio.TaskGroup() as group:
            group.create_task(self._stop_what_may_run())
            group.create_task(self._look_after())

    async def _stop_what_may_run(self) -> None:
        """Repeat every stop that was not confirmed; a move that begins does that by itself."""
        while True:
            await asyncio.sleep(STOP_AGAIN_S)
            gantry = self._hardware.gantry if self._hardware is not None else None
            if gantry is None or gantry.moving or not gantry.unstopped:
                continue
            before = gantry.unstopped
            await gantry.stop_again()
            log.warning("stopped_late", axes=[axis for axis in before if axis not in gantry.unstopped])

    async def _look_after(self) -> None:
        while True:
            await self._rest()
            if self._hardware is None or self._lock.holder is not None:
                continue
            async with self._lock.hold("health check"):
                if self._latch.state is State.IDLE:
                    await self._check_health()
                elif self._latch.doubtful:
                    await self._forget_homing(self._hardware)

    async def _rest(self) -> None:
        """Wait for the next check, or for an axis that came into doubt: that is written down at once."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self._settings.config.maintenance.idle_check_s):
                await self._latch.doubt_changed.wait()
                self._latch.doubt_changed.clear()
                await asyncio.shield(self._keep_doubts())

    async def _check_health(self) -> None:
        """Ask the drives how they are; what they report becomes the station's fault. The lock is held."""
        hardware = self._hardware
        if hardware is None:
            return
        missing = hardware.missing_answers
        try:
            await hardware.check_health(self._check_deadline(hardware))
        except DeadlinePassed as exc:
            missing = hardware.missing_answers - missing
            if not missing:
                # Every answer came: what is slow is this computer, and the drives are asked again soon
                log.warning("idle_check_late", cause=str(exc))
                return
            self._lose(
                LinkTimeout(f"{missing} answers were missing, and no time was left to ask again", device=exc.device)
            )
        except Exception as exc:  # noqa: BLE001  # whatever the drives report becomes the station's fault
            self._lose(exc)

    def _check_deadline(self, hardware: Hardware) -> Deadline:
        """Return by when a check has to be over, on lines of this speed."""
        return Deadline.after(self._settings.config.maintenance.idle_check_within_s + hardware.check_line_s)

    def _lose(self, error: Exception) -> None:
        """Latch what a check found."""
        fault = _latched(as_fault(error))
        log.error("station_lost", error=fault.message)
        self._latch.latch(fault)

    async def first_check(self) -> None:
        """Ask the drives once all is up: what the self-test of the start left out is read now."""
        async with self._lock.hold("health check"):
            await self._check_health()

    async def _forget_homing(self, hardware: Hardware) -> None:
        """Write the doubt into the drives as soon as they answer."""
        try:
            await self._settle_doubts(hardware, self._check_deadline(hardware))
        except DeviceError as exc:
            log.debug("homing_not_forgotten_yet", error=str(exc))

    async def _keep_doubts(self) -> None:
        """Keep the axes in doubt in the journal, for a daemon that is killed."""
        try:
            await self._journal.keep(DOUBT, {"axes": sorted(self._latch.doubtful)})
        except Fault as exc:
            log.error("doubt_not_kept", error=exc.message)

    # --- the end ---------------------------------------------------------------------------------------------

    async def release(self) -> None:
        """Raise the needle where that is safe, darken, and let go of the devices."""
        if self._hardware is not None:
            station = self._context.station if self._context is not None else None
            await shut_down(self._hardware, station, self._unsure())

    def _unsure(self) -> Fault | None:
        """Return what speaks against a move by itself, before any other fault."""
        if self._latch.doubtful:
            return Fault(FaultCode.NOT_HOMED, "the reference of an axis is in doubt")
        return next((cause for cause in self._latch.causes if cause.kind in UNSURE), self._latch.fault)


def _latched(fault: Fault) -> Fault:
    """Keep what closes a station latched, whatever its kind."""
    if fault.kind.latched:
        return fault
    detail: dict[str, Any] = {**fault.detail, "was": fault.kind.wire_name}
    return Fault(FaultCode.INTERNAL, fault.message, **detail)
