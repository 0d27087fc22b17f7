"""The parts of one running daemon, put together."""

from __future__ import annotations

from contextlib import AsyncExitStack
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import zmq.asyncio

from daemon.app.announcer import Announcer
from daemon.app.supervisor import StationSupervisor
from daemon.config.current import CurrentSettings
from daemon.config.model import Config
from daemon.config.reload import Change, Reloader
from daemon.domain.board import Board
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.image_archive import ImageArchive
from daemon.jobs.runner import JobLimits, JobRunner, Surroundings
from daemon.jobs.station_lock import StationLock
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


@dataclass(frozen=True)
class Runtime:
    """One daemon, whole: every part was given its collaborators when it was made."""

    version: str
    settings: CurrentSettings
    notifier: Notifier
    metrics: Metrics
    journal: Journal
    events: EventPublisher
    latch: FaultLatch
    supervisor: StationSupervisor
    monitor: Monitor
    runner: JobRunner
    status_line: StatusLine
    announcer: Announcer
    control: ControlSocket
    reloader: Reloader


@dataclass(frozen=True)
class _Sockets:
    context: zmq.asyncio.Context
    authenticator: Authenticator
    events: EventPublisher


async def put_together(config: Config, path: Path | None, stack: AsyncExitStack) -> Runtime:
    """Make every part, leaves first; `stack` takes them apart again in the opposite order.

    `path`: the file the configuration came from, absolute; SIGHUP reads it again. Devices are opened later.
    """
    settings = CurrentSettings(config, Board.load(config.board.file))
    data_dir, name = config.station.data_dir, config.station.name
    stack.enter_context(alone(data_dir))
    journal = await Journal.open(data_dir / "journal.sqlite")
    stack.push_async_callback(journal.close)
    program = version("reprobe")
    metrics = Metrics(name, program)
    sockets = _open_sockets(config, journal, metrics, stack)
    notifier = Notifier.from_environment()
    stack.callback(notifier.close)

    latch, lock = FaultLatch(), StationLock()
    status_line = StatusLine(latch, notifier)
    announcer = Announcer(sockets.events, journal, status_line, notifier, name, program)
    latch.subscribe(announcer.on_change)
    calibrations = Calibrations(data_dir / "calibration", name)
    images = ImageArchive(data_dir / "pictures", config.station.pictures, config.station.pictures_quota_mb)
    supervisor = StationSupervisor(settings, latch, lock, calibrations, journal, open_hardware)
    monitor = Monitor(settings, calibrations, lambda: supervisor.hardware, journal, sockets.events)
    runner = JobRunner(
        Surroundings(
            station=name, latch=latch, lock=lock, journal=journal, publisher=sockets.events, images=images,
            procedures=PROCEDURES, context=supervisor.context, limits=lambda: _limits(settings.config),
            observer=monitor, watchdog=Watchdog(notifier.feed, notifier.feed_every_s),
            on_result=status_line.on_result,
        )
    )  # fmt: skip
    vitals = VitalsReader(latch, lambda: runner.queued, calibrations, lambda: supervisor.hardware, data_dir)
    _serve_metrics(metrics, vitals, config.metrics.port, stack)
    handlers = Handlers(
        Collaborators(
            settings=settings, latch=latch, runner=runner, reset=supervisor.reset, calibrations=calibrations,
            images=images, metrics=metrics, monitor=monitor, journal=journal, vitals=vitals.read,
        )
    )  # fmt: skip
    control = ControlSocket(sockets.context, config.api, program, handlers, sockets.authenticator)
    stack.callback(control.close)
    stack.push_async_callback(supervisor.release)

    def take_over(change: Change) -> None:
        """Put another configuration in force; nothing runs, and no device sees a difference."""
        settings.replace(change)
        images.adopt(change.config.station.pictures, change.config.station.pictures_quota_mb)
        control.adopt(change.config.api)
        monitor.adopt()
        supervisor.refresh_context()

    reloader = Reloader(path, lambda: settings.config, lambda: lock.hold("reload"), take_over, announcer.tell_of_reload)
    return Runtime(
        program, settings, notifier, metrics, journal, sockets.events, latch, supervisor, monitor, runner,
        status_line, announcer, control, reloader,
    )  # fmt: skip


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


def _serve_metrics(metrics: Metrics, vitals: VitalsReader, port: int, stack: AsyncExitStack) -> None:
    metrics.watch(vitals.read)
    if port:
        metrics.serve(port)
        stack.callback(metrics.close)


def _limits(config: Config) -> JobLimits:
    servo, api = config.servo, config.api
    return JobLimits(servo.job_timeout_s, servo.calibration_timeout_s, api.queue_length, api.queue_per_client)
