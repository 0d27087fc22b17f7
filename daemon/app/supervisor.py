"""The supervisor of the station: opens the devices, resets faults, and looks after the drives while nothing runs.

It alone says that a fault is over, and only after it has asked the devices. `reset` and every check hold the
station's lock: no job begins while they work, and none runs.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable, Iterable
from functools import partial
from typing import Any

import structlog

from daemon.config.current import CurrentSettings
from daemon.config.model import Config
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import BUSY, State
from daemon.jobs.context import StationContext
from daemon.jobs.fault_latch import AXES, FaultLatch
from daemon.jobs.runner import EXCLUSIVE_WITHIN_S
from daemon.jobs.station_lock import StationLock
from daemon.jobs.watchdog import Watchdog
from daemon.station.approach import approach_of
from daemon.station.conditions import conditions_of
from daemon.station.darkness import require_dark
from daemon.station.device_errors import as_fault
from daemon.station.devices import Hardware
from daemon.station.free_pin import FreePin
from daemon.station.kinematics import Geometry
from daemon.station.needle import Needle, NeedlePlace
from daemon.station.safe_shutdown import UNSURE, raise_needle, shut_down
from daemon.station.sinking import sunk
from daemon.station.station import Station
from daemon.station.unopened import bring_to_rest
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal
from drivers.deadline import Deadline
from drivers.errors import CameraError, DeadlinePassed, DeviceError, LinkTimeout
from drivers.gantry import Approach, Position
from vision import ProbeModel
from vision.geometry import PoseMap

OPEN_WITHIN_S = 20.0
FRAME_WITHIN_S = 8.0
"""What a camera that is opened again may take until its first picture."""
FRESH_WITHIN_S = 1.5
"""What a camera that is well may take at most for a picture."""
LOOK_EVERY_S = 20.0
"""At rest a picture is looked at this often, and soon after every work: both lamps are off."""
LEFT_ALONE_S = 0.2
"""How long the station is left alone after work until that picture: a job that follows at once has the camera alone."""
ASK_AGAIN_S = 0.1
"""How often a reset that waits looks whether a job has begun before it."""
STOP_AGAIN_S, ASK_UNOPENED_S = 0.1, 1.0
"""Pause between two tries to stop what may still run, and to ask drives that could not be opened."""
DOUBT = "reference_doubt"
"""Name under which the journal keeps the axes in doubt: a kill must not make anybody believe their drives."""
StopUnopened = Callable[[Config, Iterable[str]], Awaitable[frozenset[str]]]
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
        on_touch: Callable[[], None] = lambda: None,
        stop_unopened: StopUnopened = bring_to_rest,
    ) -> None:
        self._settings, self._latch, self._lock = settings, latch, lock
        self._calibrations, self._journal = calibrations, journal
        self._open_devices, self._stop_unopened = open_devices, stop_unopened
        self._unasked: frozenset[str] = frozenset()
        """Axes that may run for all that is known: opening failed, and nobody has asked their drives since."""
        self.needle = Needle(lambda: "z" in latch.doubtful, on_touch)
        """Where the needle is, as far as the drives have told since the daemon started."""
        self._hardware: Hardware | None = None
        self._context: StationContext | None = None
        self._dark_after = -1
        """How much work had been done when it was last looked whether it is dark."""
        self._look_again_s = 0.0

    @property
    def hardware(self) -> Hardware | None:
        """The open devices, None while there are none."""
        return self._hardware

    def context(self) -> StationContext | None:
        """Return what jobs work with at present, None while no device is open."""
        return self._context

    def forget_drawings(self) -> None:
        """Give up what was drawn of the board: it takes memory at rest, and is drawn again when it is wanted."""
        if self._context is not None:
            self._context.references.forget()

    def refresh_context(self) -> None:
        """Lay out what jobs work with by the settings in force."""
        self._fit_calibrations()
        self.needle.board.end()
        if self._hardware is not None:
            self._lay_out(self._hardware)

    def _lay_out(self, hardware: Hardware) -> None:
        config, board = self._settings.config, self._settings.board
        geometry = Geometry(config, board, self._calibrations, self.needle.board)
        station = Station(config, hardware, self.needle, self._approach)
        self.needle.adopt(geometry.up_z_um, geometry.surface_z_um)
        self.needle.taught_free = partial(self._taught_free, FreePin.where_no_board_is, config.gantry.safe_z_um)
        self._context = StationContext(config, station, board, self._calibrations, geometry)

    def _approach(self) -> Approach:
        """Return from how far X, Y and theta come to their targets, by what is calibrated at present."""
        config = self._settings.config
        return approach_of(config.gantry, self._calibrations.in_force, config.servo.calibration_days)

    def _fit_calibrations(self) -> None:
        """Read what was measured for just these settings; of the rest it is said why it is not used."""
        self._calibrations.fit_to(conditions_of(self._settings.config, self._settings.board))

    # --- opening and reset -----------------------------------------------------------------------------------

    async def open(self) -> None:
        """Open the devices for the first time; what keeps the station closed becomes its fault."""
        self._latch.doubt(await self._kept_doubts())
        await self.reset()
        self._latch.opened()

    async def _kept_doubts(self) -> list[str]:
        """Return the axes that were in doubt when the daemon before this one ended; all, if nobody can read that."""
        try:
            kept = await self._journal.kept(DOUBT) or {}
        except Fault as exc:
            log.error("doubts_not_read", error=exc.message)
            return list(AXES)
        return [axis for axis in AXES if axis in kept.get("axes", ())]

    async def reset(self) -> Fault | None:
        """Open what is not open, clear what the drives hold, and clear the faults latched so far if nothing is wrong.

        Returns what still speaks against work; then nothing was cleared. Raises `Fault` (busy) while a job runs.
        """
        self._refuse_beside_job()
        async with self._lock.hold("reset", every_s=ASK_AGAIN_S, still_waiting=self._refuse_beside_job):
            taken = self._latch.causes
            try:
                await self._make_fit(taken)
            except Exception as exc:  # noqa: BLE001  # whatever keeps the station closed becomes its fault
                return self._still_in_fault(taken, exc)
            self._latch.clear(taken)
            return None

    def _refuse_beside_job(self) -> None:
        """Refuse a reset while a job runs, also one that began while the reset waited."""
        if self._lock.holder == "job" or self._latch.state in BUSY:
            raise Fault(FaultCode.BUSY, "a job runs; cancel it first")

    def _still_in_fault(self, taken: tuple[Fault, ...], error: Exception) -> Fault:
        """Latch what was found in front of what was latched before, and return it."""
        found = _latched(as_fault(error))
        if found.kind is FaultCode.INTERNAL:
            log.error("opening_failed_internally", exc_info=error)
        if found.kind in (FaultCode.NOT_HOMED, FaultCode.NEEDLE_DOWN):
            # Asked for last: all else is known to be well, but for a needle that nobody has raised.
            self._latch.replace((cause for cause in taken if cause.kind is not FaultCode.NEEDLE_DOWN), found)
        else:
            self._latch.put_first(found)
        log.error("station_not_ready", error=found.message, advice=found.advice)
        return found

    async def _make_fit(self, taken: tuple[Fault, ...]) -> None:
        """Open the devices if need be, and see that they are fit to work; raise what is wrong.

        What needs a person is asked last: `not_homed` means that everything else is well.
        """
        trouble = await self._journal.mend()
        self.needle.board.end()
        deadline = Deadline.after(OPEN_WITHIN_S)
        hardware, fit = self._hardware, False
        if hardware is None:
            hardware, fit = await self._open(deadline)
        else:
            self._fit_calibrations()
            if await hardware.in_trouble(deadline):
                self._latch.doubt(AXES)
            await self._settle_doubts(hardware, deadline)
            await hardware.recover(deadline)
        fit = fit and not self._latch.doubtful
        await self._settle_doubts(hardware, deadline)
        if fit:
            homed, position = hardware.found_homed, hardware.found_position
        else:
            await hardware.check_health(deadline)
            await self._see(hardware)
            homed, position = await hardware.gantry.homed(deadline), None
        if not homed:
            self.needle.forget()
            raise Fault(FaultCode.NOT_HOMED)
        await self._require_needle_up(taken, position, deadline)
        # Behind all that speaks against moving: the journal's trouble may be over at any time, by itself.
        if trouble is not None:
            raise trouble

    async def _require_needle_up(self, taken: tuple[Fault, ...], position: Position | None, deadline: Deadline) -> None:
        """Raise if the needle is down, or was and nobody has raised it since; nothing moves here.

        `position`: where the drives have just said that they are; None: they are to be asked.
        """
        if self._context is None:
            raise Fault(FaultCode.INTERNAL, "devices are open and nothing was laid out to work with them")
        if position is None:
            await self._context.station.read_position(deadline)
        else:
            self.needle.reported(position)
        if not self.needle.is_up:
            self._have_it_seen_free()
            raise self.needle.fault("it is below the height of looks")
        if any(cause.kind is FaultCode.NEEDLE_DOWN for cause in taken):
            raise self.needle.fault("only a lift settles that it is up")

    def _have_it_seen_free(self) -> None:
        """Have a needle that somebody else left down looked at before anything moves sideways, where that is possible.

        Who was killed over a pressed pin took along where it stood free; a Z that lost its steps there would be lifted
        by its count alone.
        """
        if self._context is not None and self.needle.free_pin is None:
            self.needle.free_pin = self._taught_free(FreePin.taught, self._context.gantry.free_z_um)

    def _taught_free(self, judged: Callable[[ProbeModel, PoseMap, float], FreePin], z_um: float) -> FreePin | None:
        """Return where a free tip is seen at a height, by tip and map as they were measured; None without one."""
        probe, pose_map = self._calibrations.probe, self._calibrations.pose_map
        return judged(probe, pose_map, z_um) if probe is not None and pose_map is not None else None

    async def _open(self, deadline: Deadline) -> tuple[Hardware, bool]:
        """Open the devices; return them, and whether the drives' self-test found them fit."""
        self._fit_calibrations()
        self._unasked = frozenset(AXES)
        self._hardware = hardware = await self._open_devices(self._settings.config, deadline)
        self._unasked = frozenset()
        self._lay_out(hardware)
        log.info("station_open", camera=dict(hardware.camera.settings()))
        return hardware, hardware.found_fit

    async def _see(self, hardware: Hardware) -> None:
        """Raise unless a fresh picture comes, and it is dark; a camera that gives none is opened again first.

        Whatever was latched: a camera may have failed since without anybody having asked it for a picture.
        """
        limit = self._settings.config.lights.dark_level
        try:
            await require_dark(hardware, limit, Deadline.after(FRESH_WITHIN_S))
        except CameraError as exc:
            log.warning("camera_opened_again", error=str(exc))
            await hardware.camera.close()
            await hardware.camera.open(Deadline.after(FRAME_WITHIN_S))
            await require_dark(hardware, limit, Deadline.after(FRAME_WITHIN_S))
        self._looked(self._lock.works)

    async def _settle_doubts(self, hardware: Hardware, deadline: Deadline) -> None:
        """Take the reference from every axis in doubt; one that is known to have lost it is in doubt no longer."""
        doubtful = sorted(self._latch.doubtful)
        if doubtful:
            self.needle.forget()
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
            group.create_task(self._look_when_free())

    async def _stop_what_may_run(self) -> None:
        """Repeat every stop that was not confirmed; a move that begins does that by itself."""
        while True:
            await asyncio.sleep(STOP_AGAIN_S)
            gantry = self._hardware.gantry if self._hardware is not None else None
            if gantry is None:
                await self._stop_unasked()
                continue
            if gantry.moving or not gantry.unstopped:
                continue
            before = gantry.unstopped
            await gantry.stop_again()
            log.warning("stopped_late", axes=[axis for axis in before if axis not in gantry.unstopped])

    async def _stop_unasked(self) -> None:
        """Stop what a daemon before this one may have left running, while the devices cannot be opened."""
        if not self._unasked or self._lock.holder is not None:
            return
        async with self._lock.hold("stop"):
            if self._hardware is None:
                stand = await self._stop_unopened(self._settings.config, sorted(self._unasked))
                self._unasked -= stand
                if stand:
                    log.warning("unopened_drives_stand", axes=sorted(stand))
        await asyncio.sleep(ASK_UNOPENED_S)

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
                else:
                    await self._check_z_in_fault(self._hardware)

    async def _look_when_free(self) -> None:
        """Look for a lamp that shines soon after the station is free again."""
        while True:
            await self._lock.freed.wait()
            self._lock.freed.clear()
            await asyncio.sleep(LEFT_ALONE_S)
            await self._check_darkness()

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
        else:
            await self._check_z_stays(hardware.standing)

    async def _check_z_in_fault(self, hardware: Hardware) -> None:
        """Ask whether Z stays while another fault waits for a person; what else the drives say waits for `reset`."""
        if self.needle.place is NeedlePlace.UNKNOWN:
            return
        deadline = self._check_deadline(hardware)
        try:
            if not await hardware.gantry.homed(deadline):
                return
            position = await hardware.gantry.position(deadline)
        except DeviceError as exc:
            log.debug("z_not_asked_in_fault", error=str(exc))
            return
        await self._check_z_stays(position)

    async def _check_z_stays(self, position: Position | None) -> None:
        """Latch a needle that sank since it was left, and raise it. The lock is held; the drives were just asked.

        After a move that was stopped on its way, where it is found is where it was left.
        """
        context = self._context
        if position is None or context is None:
            return
        fault = sunk(self.needle, position)
        if fault is None:
            if self.needle.z_um is None and self.needle.place is not NeedlePlace.UNKNOWN:
                self.needle.reported(position)
            return
        self.needle.reported(position)
        unsure = self._latch.doubtful or any(cause.kind in UNSURE for cause in self._latch.causes)
        self._lose(fault)
        if unsure:
            return
        if (kept_down := await raise_needle(context.station)) is not None:
            self._latch.latch(_latched(kept_down))

    def _check_deadline(self, hardware: Hardware) -> Deadline:
        """Return by when a check has to be over, on lines of this speed."""
        return Deadline.after(self._settings.config.maintenance.idle_check_within_s + hardware.check_line_s)

    def _lose(self, error: Exception) -> None:
        """Latch what a check found."""
        fault = _latched(as_fault(error))
        log.error("station_lost", error=fault.message)
        self._latch.latch(fault)

    async def _check_darkness(self) -> None:
        """Look whether a lamp shines at rest, if it is time to; that becomes the station's fault.

        The lock is not held: no job waits for a picture of ours. What a job does meanwhile makes the picture void.
        """
        hardware, works = self._hardware, self._lock.works
        if hardware is None or not self._at_rest() or not self._time_to_look():
            return
        try:
            await require_dark(hardware, self._settings.config.lights.dark_level, Deadline.after(FRESH_WITHIN_S))
        except CameraError as exc:
            log.debug("darkness_not_seen", error=str(exc))
            return  # still to be seen, as soon as a picture comes
        except Exception as exc:  # noqa: BLE001  # whatever the picture tells becomes the station's fault
            if self._at_rest() and self._lock.works == works:
                fault = _latched(as_fault(exc))
                log.error("light_at_rest", error=fault.message)
                self._latch.latch(fault)
        self._looked(works)

    def _at_rest(self) -> bool:
        """Whether nothing works, and no lamp shines because a person wants it to; a health check asks drives only."""
        free = self._lock.holder in (None, "health check")
        return free and self._lock.leave is None and self._latch.state is State.IDLE

    def _time_to_look(self) -> bool:
        return self._lock.works != self._dark_after or time.monotonic() >= self._look_again_s

    def _looked(self, works: int) -> None:
        """Note that a picture was looked at which was taken after so much work."""
        self._dark_after, self._look_again_s = works, time.monotonic() + LOOK_EVERY_S

    async def first_check(self, watchdog: Watchdog) -> None:
        """Ask the drives once all is up: what the self-test of the start left out is read now.

        No job loop runs yet, so the watchdog is fed here while resets are before it.
        """
        waiting = watchdog.patience(EXCLUSIVE_WITHIN_S, lambda: self._lock.turns)
        async with self._lock.hold("health check", every_s=watchdog.every_s, still_waiting=waiting):
            await self._check_health()
        await self._check_darkness()

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
