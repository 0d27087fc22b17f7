"""Surroundings of the job runner: its collaborators and the limits of jobs, whole before the first job."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from daemon.domain.errors import Fault
from daemon.domain.results import JobResult
from daemon.jobs.context import Procedure, StationContext
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.image_archive import ImageArchive
from daemon.jobs.observer import JobObserver, Publisher
from daemon.jobs.station_lock import StationLock
from daemon.jobs.watchdog import Watchdog
from daemon.storage.journal import Journal


@dataclass(frozen=True)
class JobLimits:
    """How long jobs may take where their requests say nothing, s, and how many may wait, of all clients and of one."""

    job_timeout_s: float
    calibration_timeout_s: float
    queue_length: int
    queue_per_client: int


@dataclass(frozen=True)
class Surroundings:
    """What the job runner works with, all of it whole before the first job."""

    station: str
    """The station's name, for results."""
    latch: FaultLatch
    lock: StationLock
    journal: Journal
    publisher: Publisher
    images: ImageArchive
    procedures: Mapping[str, Procedure]
    context: Callable[[], StationContext | None]
    """What jobs work with at present; None while no device is open."""
    limits: Callable[[], JobLimits]
    """The limits in force; read with every request."""
    observer: JobObserver = field(default_factory=JobObserver)
    watchdog: Watchdog = field(default_factory=Watchdog)
    refusal: Callable[[str, str], Fault | None] = lambda _client, _op: None
    """Why a client may not have an operation run any more, asked again when its job's turn has come."""
    on_result: Callable[[JobResult], None] = lambda _result: None
    """Called with every result, once it has been published."""
