"""Start, serve, stop: the daemon as a whole.

It starts in `fault` and stays there until every device is open and the drives say they are homed. A device that is
missing does not end the daemon: it says what is missing, answers, and tries again on `reset`.
"""

from __future__ import annotations

import asyncio
import signal
from contextlib import AsyncExitStack
from importlib.metadata import version
from pathlib import Path
from typing import Any

import structlog
import zmq.asyncio

from daemon.app.housekeeping import tend
from daemon.config.model import Config
from daemon.config.reload import Change, Reloader
from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody, JobResult
from daemon.domain.states import Event, Machine, State
from daemon.jobs.context import StationContext
from daemon.jobs.image_archive import ImageArchive
from daemon.jobs.runner import JobRunner
from daemon.jobs.watchdog import Watchdog
from daemon.maintenance.monitor import Monitor
from daemon.platform.clock import utc_now
from daemon.platform.instance_lock import alone
from daemon.platform.memory import few_arenas
from daemon.platform.systemd_notify import Notifier
from daemon.procedures.registry import PROCEDURES
from daemon.server.auth import Authenticator
from daemon.server.control_socket import ControlSocket
from daemon.server.event_publisher import EventPublisher
from daemon.server.handlers import Handlers
from daemon.server.keyring import Keyring
from daemon.station.device_errors import as_fault
from daemon.station.devices import Hardware, open_hardware
from daemon.station.kinematics import Geometry
from daemon.station.safe_shutdown import REFERENCE_LOST, shut_down
from daemon.station.station import Station
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal
from daemon.telemetry.metrics import Metrics
from daemon.telemetry.status_line import StatusLine
from daemon.telemetry.vitals import Vitals, read_vitals
from drivers.deadline import Deadline
from drivers.errors import DeviceError
from vision.warm import warm_up

OPEN_WITHIN_S = 20.0
CHECK_EVERY_S = 2.0
CHECK_WITHIN_S = 2.0
LINGER_MS = 200
RELOADED = {
    "taken": "",
    "waits": "a new configuration waits for the job to end",
    "refused": "the new configuration was refused, the old one stays: {problems}",
}
"""What the status line says of a reload."""
log = structlog.get_logger(__name__)


class Service:
    """One daemon. `run` serves until `stop` is called or the process is told to end."""

    def __init__(self, config: Config, path: Path | None = None) -> None:
        """Take the configuration and the file it came from, which SIGHUP reads again."""
        self.config = config
        self._path = path.resolve() if path is not None else None
        self._notifier = Notifier.from_environment()
        self.version = version("reprobe")
        self._stop = asyncio.Event()
        self._hardware: Hardware | None = None
        self.calibrations = Calibrations(config.station.data_dir / "calibration", config.station.name)
        self._opening = asyncio.Lock()
        self.metrics = Metrics(config.station.name, self.version)

    @property
    def hardware(self) -> Hardware | None:
        """The open devices, None while there are none."""
        return self._hardware

    def vitals(self) -> Vitals:
        """Read what is so at present; from any thread."""
        return read_vitals(self, self.config.station.data_dir)

    def stop(self) -> None:
        """Ask the daemon to end; motion stops, lights go off, everything is written."""
        self._stop.set()

    async def run(self) -> None:
        """Serve until told to stop; whatever was opened is closed again, in the opposite order."""
        few_arenas()
        config = self.config
        self.board = Board.load(config.board.file)
        async with AsyncExitStack() as stack:
            stack.enter_context(alone(config.station.data_dir))
            self._journal = await Journal.open(config.station.data_dir / "journal.sqlite")
            stack.push_async_callback(self._journal.close)
            context = zmq.asyncio.Context()
            stack.callback(context.destroy, linger=LINGER_MS)
            guard = Authenticator(config.api.role, Keyring(config.api.keys_dir) if config.api.curve else None)
            guard.start(context)
            stack.callback(guard.stop)
            self._events = EventPublisher(
                zmq.Context(context), config.api.events, config.station.name, self._journal, self.metrics.take, guard
            )
            stack.callback(self._events.close)
            self.machine = Machine(self._publish_state)
            self.pictures = ImageArchive(
                config.station.data_dir / "pictures", config.station.pictures, config.station.pictures_quota_mb
            )
            self.jobs = JobRunner(
                self.machine, self._journal, self._events, self.pictures, config.station.name,
                config.servo, PROCEDURES, config.api.queue_length, config.api.queue_per_client,
            )  # fmt: skip
            self.monitor = Monitor(self, self._journal, self._events)
            self.jobs.observer = self.monitor
            self._tell_manager(stack)
            self._serve_metrics(stack)
            self._control = ControlSocket(context, config.api, self.version, Handlers(self, self._journal), guard)
            stack.callback(self._control.close)
            stack.push_async_callback(self._release)
            self._trap_signals()
            await self._serve(self._control)
        log.info("stopped")

    def _tell_manager(self, stack: AsyncExitStack) -> None:
        """Let the service manager see state and results, and the job loop feed its watchdog."""
        stack.callback(self._notifier.close)
        self._status_line = StatusLine(self, self._notifier)
        self.jobs.on_result = self._status_line.on_result
        self.jobs.watchdog = Watchdog(self._notifier.feed, self._notifier.feed_every_s)
        self._reloader = Reloader(
            self._path, lambda: self.config, self.jobs.between, self._take_over, self._tell_of_reload
        )

    def _serve_metrics(self, stack: AsyncExitStack) -> None:
        self.metrics.watch(self.vitals)
        if self.config.metrics.port:
            self.metrics.serve(self.config.metrics.port)
            stack.callback(self.metrics.close)

    async def _serve(self, control: ControlSocket) -> None:
        """Report what a stop interrupted, open the devices, then run everything until told to stop."""
        await self._journal.reserve_seqs()
        await self._report_interrupted()
        await self.monitor.load()
        for alert in self.monitor.alerts.standing.values():
            self.metrics.take("alert", alert.body("raised"))
        answering = asyncio.create_task(control.serve(), name="control")
        background = [
            asyncio.create_task(self._heartbeat(), name="heartbeat"),
            asyncio.create_task(self._supervise(), name="supervise"),
            asyncio.create_task(self._reloader.run(busy=lambda: self.jobs.running is not None), name="reload"),
            asyncio.create_task(tend(self), name="tend"),
            asyncio.create_task(self.monitor.run(), name="maintenance"),
        ]
        working = asyncio.create_task(self._open_and_work(), name="jobs")
        stopping = asyncio.create_task(self._stop.wait(), name="stop")
        tasks: set[asyncio.Task[Any]] = {answering, working, stopping, *background}
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        log.info("stopping")
        self._notifier.stopping("stopping")
        for task in (*background, working):
            task.cancel()
        await asyncio.wait([working, *background])
        await self.monitor.close()
        await control.drain(within_s=1.0)
        answering.cancel()
        stopping.cancel()
        await asyncio.wait([answering, stopping])
        for task in done - {stopping}:
            task.result()  # a task that ended by itself ended by an error: let it be seen

    async def _open_and_work(self) -> None:
        await self.reset()
        self._status_line.ready(await self._journal.last_result())
        # Jobs come after: the first one would have to wait for it anyway.
        await asyncio.to_thread(warm_up)
        if self._hardware is not None:
            await self._check_health(self._hardware)
        await self.jobs.run()

    # --- devices ---------------------------------------------------------------------------------------------

    async def reset(self) -> Fault | None:
        """Open what is not open, clear what the drives hold, and leave the fault if nothing speaks against it.

        Returns what still speaks against it.
        """
        async with self._opening:
            before, self.jobs.fault = self.jobs.fault, None
            try:
                await self._open(lost=before is not None and before.kind in REFERENCE_LOST)
            except Exception as exc:  # whatever keeps the station closed becomes its fault
                fault = as_fault(exc)
                if fault.kind is FaultCode.INTERNAL:
                    log.exception("opening_failed_internally")
                self.jobs.latch(_latched(fault))
                log.error("station_not_ready", error=fault.message, advice=fault.advice)
                self._status_line.refresh()
                return fault
            self.jobs.clear()
            return None

    def _take_over(self, change: Change) -> None:
        """Put another configuration in force; nothing runs, and no device sees a difference."""
        config = self.config = change.config
        self.board = change.board
        self.pictures.adopt(config.station.pictures, config.station.pictures_quota_mb)
        self.jobs.adopt(config.servo, config.api.queue_length, config.api.queue_per_client)
        self._control.adopt(config.api)
        self.monitor.adopt()
        if self._hardware is not None:
            self._set_context(self._hardware)

    def _set_context(self, hardware: Hardware) -> None:
        """Lay out what jobs work with."""
        geometry = Geometry(self.config, self.board, self.calibrations)
        station = Station(self.config, hardware)
        self.jobs.context = StationContext(self.config, station, self.board, self.calibrations, geometry)

    async def _open(self, *, lost: bool) -> None:
        """Open the hardware if need be, and see that it is fit to work; raise what is wrong.

        `lost`: what went before leaves the axes' reference in doubt.
        """
        deadline = Deadline.after(OPEN_WITHIN_S)
        if self._hardware is None:
            self.calibrations.load()
            self._hardware = await open_hardware(self.config, deadline)
            self._set_context(self._hardware)
            log.info("station_open", camera=dict(self._hardware.camera.settings()))
            # The self-test has just asked them; what else they say of themselves is read once the start is over.
            found = self._hardware.found.values()
            fit, homed = all(axis.fit for axis in found), all(axis.homed for axis in found)
        else:
            await self._hardware.recover(deadline, reference_lost=lost)
            fit, homed = False, await self._hardware.gantry.homed(deadline)
        if not fit:
            await self._hardware.check_health(deadline)
        if not homed:
            raise Fault(FaultCode.NOT_HOMED)

    async def _supervise(self) -> None:
        """While nothing runs, look after the drives: an e-stop or a pulled cable is noticed before the next job."""
        while True:
            await asyncio.sleep(CHECK_EVERY_S)
            if self._hardware is None or self.jobs.running is not None or self._opening.locked():
                continue
            if self.machine.state is State.IDLE:
                await self._check_health(self._hardware)
            elif self.jobs.fault is not None and self.jobs.fault.kind in REFERENCE_LOST:
                await self._forget_homing(self._hardware)

    async def _check_health(self, hardware: Hardware) -> None:
        try:
            await hardware.check_health(Deadline.after(CHECK_WITHIN_S))
        except Exception as exc:  # noqa: BLE001  # whatever the drives report becomes the station's fault
            if self.jobs.running is None:
                fault = _latched(as_fault(exc))
                log.error("station_lost", error=fault.message)
                self.jobs.latch(fault)

    async def _forget_homing(self, hardware: Hardware) -> None:
        """Write the doubt into the drives, so that a daemon started anew does not believe them either."""
        deadline = Deadline.after(CHECK_WITHIN_S)
        try:
            if await hardware.gantry.homed(deadline):
                await hardware.gantry.forget_homing(deadline)
        except DeviceError as exc:
            log.debug("homing_not_forgotten_yet", error=str(exc))

    # --- telling ---------------------------------------------------------------------------------------------

    async def _heartbeat(self) -> None:
        while True:
            await self._journal.reserve_seqs()
            self._events.publish("heartbeat", {"state": self.machine.state.value, "version": self.version})
            await asyncio.sleep(self.config.api.heartbeat_s)

    def _publish_state(self, before: State, event: Event, after: State) -> None:
        fault = self.jobs.fault
        running = self.jobs.running
        self._events.publish(
            "state",
            {
                "state": after.value,
                "was": before.value,
                "event": event.value,
                "job": running.id if running else None,
                "fault": ErrorBody.of(fault).model_dump(mode="json") if fault and after is State.FAULT else None,
            },
        )
        log.info("state", change=f"{before.value} --{event.value}--> {after.value}")
        self._status_line.refresh()

    async def _tell_of_reload(self, what: str, facts: dict[str, object]) -> None:
        """Say to the service manager and to whoever listens how a new configuration fared."""
        if what == "begun":
            self._notifier.reloading()
            return
        self._status_line.note(RELOADED[what].format(problems=_some(facts.get("problems"))))
        self._notifier.ready(self._status_line.line())
        await self._journal.reserve_seqs()
        self._events.publish("log", {"event": f"configuration_{what}", **facts})

    async def _report_interrupted(self) -> None:
        """Give each job that a crash or a kill cut off its result: a fault; nothing moves."""
        for job_id, op in await self._journal.unfinished():
            error = ErrorBody.of(Fault(FaultCode.INTERRUPTED))
            result = JobResult(
                id=job_id, op=op, ok=False, seq=self._journal.take_seq(), station=self.config.station.name,
                finished_at=utc_now(), outcome="failed", error=error,
            )  # fmt: skip
            await self._journal.finish_job(result)
            self._events.publish("result", result.model_dump(mode="json"), seq=result.seq)

    # --- the end ---------------------------------------------------------------------------------------------

    def _trap_signals(self) -> None:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self.stop)
        loop.add_signal_handler(signal.SIGHUP, self._reloader.ask)

    async def _release(self) -> None:
        """Lift the needle, darken, and let go of the devices."""
        if self._hardware is not None:
            context = self.jobs.context
            await shut_down(self._hardware, context.station if context is not None else None, self.jobs.fault)


def _some(problems: object) -> str:
    """Return the first problems of a configuration in one line."""
    listed = [f"{where}: {what}" for where, what in problems] if isinstance(problems, list) else []
    return ", ".join(listed[:2]) + (f" and {len(listed) - 2} more" if len(listed) > 2 else "")


def _latched(fault: Fault) -> Fault:
    """Keep what closes a station latched, whatever its kind."""
    if fault.kind.latched:
        return fault
    detail: dict[str, Any] = {**fault.detail, "was": fault.kind.wire_name}
    return Fault(FaultCode.INTERNAL, fault.message, **detail)
