"""Composition root: all parts of one running daemon, each made with its collaborators."""

from __future__ import annotations

from contextlib import AsyncExitStack
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

import structlog
import zmq.asyncio

from daemon.app.announcer import Announcer
from daemon.app.journal_watch import JournalWatch
from daemon.app.supervisor import StationSupervisor
from daemon.app.touch_counter import TouchCounter
from daemon.config.current import CurrentSettings
from daemon.config.model import Config
from daemon.config.reload import Change, Reloader
from daemon.domain.board import Board
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.image_archive import ImageArchive
from daemon.jobs.runner import JobRunner
from daemon.jobs.station_lock import StationLock
from daemon.jobs.surroundings import JobLimits, Surroundings
from daemon.jobs.watchdog import Watchdog
from daemon.maintenance.monitor import Monitor
from daemon.platform.instance_lock import alone
from daemon.platform.systemd_notify import Notifier
from daemon.procedures.registry import PROCEDURES
from daemon.server.auth import Authenticator
from daemon.server.control_socket import ControlSocket
from daemon.server.event_publisher import EventPublisher
from daemon.server.handlers import Collaborators, Handlers
from daemon.server.keyring import Keyring
from daemon.station.devices import open_hardware
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal
from daemon.telemetry.metrics import Metrics
from daemon.telemetry.status_line import StatusLine
from daemon.telemetry.vitals import VitalsReader

LINGER_MS = 200
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Runtime:
    """One daemon, whole: every part was given its collaborators when it was made."""

    settings: CurrentSettings
    notifier: Notifier
    metrics: Metrics
    journal: Journal
    latch: FaultLatch
    watchdog: Watchdog
    supervisor: StationSupervisor
    monitor: Monitor
    runner: JobRunner
    status_line: StatusLine
    announcer: Announcer
    journal_watch: JournalWatch
    control: ControlSocket
    reloader: Reloader


@dataclass(frozen=True)
class _Sockets:
    context: zmq.asyncio.Context
    authenticator: Authenticator
    events: EventPublisher


@dataclass(frozen=True)
class _Base:
    """What everything else stands on."""

    version: str
    settings: CurrentSettings
    journal: Journal
    metrics: Metrics
    sockets: _Sockets
    notifier: Notifier
    latch: FaultLatch
    lock: StationLock
    watchdog: Watchdog
    status_line: StatusLine


@dataclass(frozen=True)
class _Work:
    """What looks after the station and runs its jobs."""

    calibrations: Calibrations
    images: ImageArchive
    supervisor: StationSupervisor
    monitor: Monitor
    runner: JobRunner


async def put_together(config: Config, path: Path | None, stack: AsyncExitStack) -> Runtime:
    """Make every part, leaves first; `stack` takes them apart again in the opposite order.

    `path`: the file the configuration came from, absolute; SIGHUP reads it again. Devices are opened later.
    """
    base = await _make_base(config, stack)
    announcer = Announcer(
        base.sockets.events, base.journal, base.status_line, base.notifier, config.station.name, base.version
    )
    base.latch.subscribe(announcer.on_change)
    work = _make_work(base)
    journal_watch = JournalWatch(
        base.journal, base.latch, work.monitor,
        announcer.report_interrupted, work.monitor.load, work.runner.write_held_back,
    )  # fmt: skip
    control = _make_control(base, work, stack)
    stack.push_async_callback(work.supervisor.release)
    reloader = Reloader(
        path,
        lambda: base.settings.config,
        lambda: base.lock.hold("reload"),
        partial(_take_over, base, work, control),
        announcer.tell_of_reload,
    )
    return Runtime(
        base.settings, base.notifier, base.metrics, base.journal, base.latch, base.watchdog, work.supervisor,
        work.monitor, work.runner, base.status_line, announcer, journal_watch, control, reloader,
    )  # fmt: skip


async def _make_base(config: Config, stack: AsyncExitStack) -> _Base:
    settings = CurrentSettings(config, Board.load(config.board.file))
    stack.enter_context(alone(config.station.data_dir))
    journal = await Journal.open(config.station.data_dir / "journal.sqlite")
    stack.push_async_callback(journal.close)
    program = version("reprobe")
    metrics = Metrics(config.station.name, program)
    sockets = _open_sockets(config, journal, metrics, stack)
    notifier = Notifier.from_environment()
    stack.callback(notifier.close)
    latch = FaultLatch()
    watchdog = Watchdog(notifier.feed, notifier.feed_every_s)
    return _Base(
        program, settings, journal, metrics, sockets, notifier, latch, StationLock(), watchdog,
        StatusLine(latch, notifier),
    )  # fmt: skip


def _make_work(base: _Base) -> _Work:
    settings, station = base.settings, base.settings.config.station
    calibrations = Calibrations(station.data_dir / "calibration", station.name)
    images = ImageArchive(station.data_dir / "pictures", station.pictures, station.pictures_quota_mb)
    touches = TouchCounter(
        base.journal, base.metrics, lambda: monitor, lambda: base.latch.running[1] if base.latch.running else None
    )
    supervisor = StationSupervisor(
        settings, base.latch, base.lock, calibrations, base.journal, open_hardware, touches.touched
    )
    monitor = Monitor(settings, calibrations, lambda: supervisor.hardware, base.journal, base.sockets.events)
    runner = JobRunner(
        Surroundings(
            station=station.name, latch=base.latch, lock=base.lock, journal=base.journal,
            publisher=base.sockets.events, images=images, procedures=PROCEDURES, context=supervisor.context,
            limits=lambda: _limits(settings.config), observer=monitor,
            watchdog=base.watchdog, on_result=base.status_line.on_result,
            refusal=base.sockets.authenticator.refusal,
        )
    )  # fmt: skip
    return _Work(calibrations, images, supervisor, monitor, runner)


def _make_control(base: _Base, work: _Work, stack: AsyncExitStack) -> ControlSocket:
    """Make the control socket, what answers there, and the metrics that are read beside it."""
    config = base.settings.config
    vitals = VitalsReader(
        base.latch, lambda: work.runner.queued, work.calibrations, lambda: work.supervisor.hardware,
        config.station.data_dir,
    )  # fmt: skip
    _serve_metrics(base, vitals, config.metrics.port, stack)
    handlers = Handlers(
        Collaborators(
            settings=base.settings, latch=base.latch, runner=work.runner, reset=work.supervisor.reset,
            calibrations=work.calibrations, images=work.images, metrics=base.metrics, monitor=work.monitor,
            journal=base.journal, vitals=vitals.read, needle=work.supervisor.needle,
        )
    )  # fmt: skip
    sockets = base.sockets
    control = ControlSocket(sockets.context, config.api, base.version, handlers, sockets.authenticator)
    stack.callback(control.close)
    return control


def _take_over(base: _Base, work: _Work, control: ControlSocket, change: Change) -> None:
    """Put another configuration in force; nothing runs, and no device sees a difference."""
    base.settings.replace(change)
    work.images.adopt(change.config.station.pictures, change.config.station.pictures_quota_mb)
    control.adopt(change.config.api)
    work.monitor.adopt()
    work.supervisor.refresh_context()


def _open_sockets(config: Config, journal: Journal, metrics: Metrics, stack: AsyncExitStack) -> _Sockets:
    """Make the sockets' context, who may use them, and the event socket."""
    context = zmq.asyncio.Context()
    stack.callback(context.destroy, linger=LINGER_MS)
    authenticator = Authenticator(config.api.role, Keyring(config.api.keys_dir) if config.api.curve else None)
    authenticator.start(context)
    stack.callback(authenticator.stop)
    events = EventPublisher(
        zmq.Context(context), config.api.events, config.station.name, journal, metrics.take, authenticator
    )
    stack.callback(events.close)
    return _Sockets(context, authenticator, events)


def _serve_metrics(base: _Base, vitals: VitalsReader, port: int, stack: AsyncExitStack) -> None:
    """Serve metrics if they are wanted; a port that is in use is told, and keeps no station from its work."""
    base.metrics.watch(vitals.read)
    if not port:
        return
    try:
        base.metrics.serve(port)
    except (OSError, RuntimeError) as exc:
        facts = {"port": port, "error": str(exc), "advice": "free the port or choose another, then restart"}
        log.error("metrics_not_served", **facts)
        base.sockets.events.publish("log", {"event": "metrics_not_served", **facts})
        base.status_line.note(f"no metrics: port {port} cannot be served")
        return
    stack.callback(base.metrics.close)


def _limits(config: Config) -> JobLimits:
    servo, api = config.servo, config.api
    return JobLimits(servo.job_timeout_s, servo.calibration_timeout_s, api.queue_length, api.queue_per_client)
