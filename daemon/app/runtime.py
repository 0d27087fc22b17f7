"""Composition root: all parts of one running daemon, each made with its collaborators."""

from __future__ import annotations

from contextlib import AsyncExitStack
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

import zmq.asyncio

from daemon.app.announcer import Announcer
from daemon.app.circumstances import CircumstancesWatch
from daemon.app.fault_alerts import FaultAlerts
from daemon.app.journal_watch import JournalWatch
from daemon.app.metrics_port import MetricsPort
from daemon.app.supervisor import StationSupervisor
from daemon.app.touch_counter import TouchCounter
from daemon.app.unserved import Part, UnservedWatch
from daemon.config.current import CurrentSettings
from daemon.config.model import Config
from daemon.config.reload import Change, Reloader
from daemon.domain.board import Board
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.image_archive import ImageArchive
from daemon.jobs.lamp_lease import LampLease
from daemon.jobs.runner import JobRunner
from daemon.jobs.station_lock import StationLock
from daemon.jobs.surroundings import JobLimits, Surroundings
from daemon.jobs.watchdog import Watchdog
from daemon.maintenance.monitor import Monitor
from daemon.platform.atomic_file import remove_leftovers
from daemon.platform.instance_lock import alone
from daemon.platform.systemd_notify import Notifier
from daemon.procedures.registry import PROCEDURES
from daemon.server.auth import Authenticator
from daemon.server.control_socket import ControlSocket
from daemon.server.event_publisher import EventPublisher
from daemon.server.handlers import Collaborators, Handlers
from daemon.server.keyring import Keyring
from daemon.server.live_publisher import LivePublisher, LiveView
from daemon.station.devices import open_hardware
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal
from daemon.storage.unfinished_restore import require_whole
from daemon.telemetry.metrics import Metrics
from daemon.telemetry.status_line import StatusLine
from daemon.telemetry.vitals import VitalsReader

LINGER_MS = 200


@dataclass(frozen=True)
class Runtime:
    """One daemon, whole: every part was given its collaborators when it was made."""

    settings: CurrentSettings
    notifier: Notifier
    metrics: Metrics
    metrics_port: MetricsPort
    journal: Journal
    latch: FaultLatch
    watchdog: Watchdog
    supervisor: StationSupervisor
    monitor: Monitor
    runner: JobRunner
    status_line: StatusLine
    announcer: Announcer
    journal_watch: JournalWatch
    fault_alerts: FaultAlerts
    control: ControlSocket
    reloader: Reloader
    live: LivePublisher | None
    events: EventPublisher
    unserved: UnservedWatch


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
    metrics_port: MetricsPort
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
    circumstances = CircumstancesWatch(base.journal.stream, base.version, base.settings, work.calibrations)
    circumstances.refresh()
    base.latch.subscribe(circumstances.refresh)
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
        partial(_tell_of_reload, base.settings, announcer),
    )
    live = _make_live(base, work, stack)
    events = base.sockets.events
    parts: list[Part] = [events, base.metrics_port, *([live] if live is not None else [])]
    return Runtime(
        base.settings, base.notifier, base.metrics, base.metrics_port, base.journal, base.latch, base.watchdog,
        work.supervisor, work.monitor, work.runner, base.status_line, announcer, journal_watch,
        FaultAlerts(base.latch, work.monitor), control, reloader, live, events,
        UnservedWatch(parts, work.monitor, base.status_line),
    )  # fmt: skip


async def _tell_of_reload(settings: CurrentSettings, announcer: Announcer, what: str, facts: dict[str, object]) -> None:
    settings.note_reload(what, facts)
    await announcer.tell_of_reload(what, facts)


async def _make_base(config: Config, stack: AsyncExitStack) -> _Base:
    settings = CurrentSettings(config, Board.load(config.board.file))
    stack.enter_context(alone(config.station.data_dir))
    require_whole(config.station.data_dir)
    journal = await Journal.open(config.station.journal)
    stack.push_async_callback(journal.close)
    program = version("reprobe")
    metrics = Metrics(config.station.name, program)
    sockets = _open_sockets(config, journal, metrics, stack)
    notifier = Notifier.from_environment()
    stack.callback(notifier.close)
    latch = FaultLatch()
    status_line = StatusLine(latch, notifier)
    metrics_port = MetricsPort(metrics, config.metrics.port, sockets.events)
    watchdog = Watchdog(notifier.feed, notifier.feed_every_s)
    return _Base(
        program, settings, journal, metrics, metrics_port, sockets, notifier, latch, StationLock(), watchdog,
        status_line,
    )  # fmt: skip


def _make_work(base: _Base) -> _Work:
    settings, station = base.settings, base.settings.config.station
    remove_leftovers(station.data_dir / "calibration")
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
    base.metrics.watch(vitals.read)
    base.metrics_port.open()
    stack.callback(base.metrics.close)
    lamp = LampLease(
        base.latch, base.lock, lambda: work.supervisor.hardware.lights if work.supervisor.hardware else None
    )
    handlers = Handlers(
        Collaborators(
            settings=base.settings, latch=base.latch, runner=work.runner, reset=work.supervisor.reset,
            light=lamp.switch,
            calibrations=work.calibrations, images=work.images, metrics=base.metrics, monitor=work.monitor,
            journal=base.journal, vitals=vitals.read, needle=work.supervisor.needle,
        )
    )  # fmt: skip
    sockets = base.sockets
    control = ControlSocket(sockets.context, config.api, base.version, handlers, sockets.authenticator)
    stack.callback(control.close)
    return control


def _make_live(base: _Base, work: _Work, stack: AsyncExitStack) -> LivePublisher | None:
    """Make the socket of live pictures, if one is wanted."""
    api, camera = base.settings.config.api, base.settings.config.camera
    if not api.live:
        return None
    view = LiveView(
        camera=lambda: work.supervisor.hardware.camera if work.supervisor.hardware else None,
        state=lambda: base.latch.state.value,
        size_px=lambda: (camera.width, camera.height),
        tip_px=lambda: probe.tip_px if (probe := work.calibrations.in_force.probe) is not None else None,
        sight=lambda: work.supervisor.needle.sight,
    )
    live = LivePublisher(base.sockets.context, api.live, api.live_fps, view, base.sockets.authenticator)
    stack.callback(live.close)
    return live


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


def _limits(config: Config) -> JobLimits:
    servo, api = config.servo, config.api
    return JobLimits(servo.job_timeout_s, servo.calibration_timeout_s, api.queue_length, api.queue_per_client)
