"""Handlers of the control socket's operations: what each answers.

Jobs are handed to the job runner; every other operation has its case and its method here.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import assert_never

from daemon.config.current import CurrentSettings
from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody
from daemon.domain.roles import Caller
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.image_archive import ImageArchive
from daemon.jobs.runner import JobRunner
from daemon.maintenance.monitor import Monitor
from daemon.station.needle import Needle
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal
from daemon.telemetry.metrics import Metrics
from daemon.telemetry.vitals import Vitals
from daemon.wire.deadline import due_at_s
from daemon.wire.events import TOPICS, AlertFacts
from daemon.wire.operations.control import (
    CalibrationState,
    Cancel,
    CancelReply,
    Links,
    NeedleState,
    Reset,
    Result,
    ResultReply,
    Results,
    ResultsReply,
    Running,
    Snapshot,
    SnapshotReply,
    Status,
    StatusReply,
)
from daemon.wire.operations.describe import (
    BoardFacts,
    Describe,
    DescribeReply,
    ErrorFacts,
    Limits,
    TestPoint,
    You,
)
from daemon.wire.operations.health import (
    Acknowledge,
    AcknowledgeReply,
    Alerts,
    AlertsReply,
    PastAlert,
    Report,
    ReportReply,
)
from daemon.wire.operations.jobs import AnyJob, JobReply
from daemon.wire.operations.row import DefaultDeadline
from daemon.wire.operations.table import OPERATIONS, AnyRequest
from daemon.wire.replies import Reply
from daemon.wire.requests import VERSIONS, ImmediateRequest, JobRequest

SHORT_S = 1.0


@dataclass(frozen=True)
class Collaborators:
    """What of the running daemon the operations ask."""

    settings: CurrentSettings
    latch: FaultLatch
    runner: JobRunner
    reset: Callable[[], Awaitable[Fault | None]]
    """Try to leave a fault; return what still speaks against it."""
    calibrations: Calibrations
    images: ImageArchive
    metrics: Metrics
    monitor: Monitor
    journal: Journal
    vitals: Callable[[], Vitals]
    """Read the present numbers."""
    needle: Needle = field(default_factory=Needle)
    """Where the needle is."""


class Handlers:
    """Answer requests for one daemon."""

    def __init__(self, collaborators: Collaborators) -> None:
        self._with = collaborators
        self._journal = collaborators.journal

    def at_once(self, request: AnyRequest, caller: Caller) -> Reply | None:
        """Return the reply to what needs no waiting, else None."""
        return self._immediate(request, caller) if isinstance(request, ImmediateRequest) else None

    async def handle(self, request: AnyRequest, caller: Caller) -> Reply:  # noqa: C901, PLR0912  # a case each
        """Return the reply, or raise `Fault`."""
        if OPERATIONS.row(request.op).deadline is DefaultDeadline.SHORT:
            due_at_s(request.deadline_ms, SHORT_S)
        match request:
            case JobRequest():
                return await self._job(request, caller)
            case ImmediateRequest():
                return self._immediate(request, caller)
            case Cancel():
                return CancelReply(cancelled=self._with.runner.cancel(request.id))
            case Reset():
                return await self._reset()
            case Snapshot():
                return await self._snapshot()
            case Result():
                return await self._result(request.id)
            case Results():
                return ResultsReply(results=await self._journal.results(request.since, request.limit))
            case Alerts():
                return await self._alerts(request)
            case Acknowledge():
                return await self._acknowledge(request)
            case Report():
                return await self._report(request)
            case _:
                assert_never(request)

    def _immediate(self, request: Status | Describe, caller: Caller) -> Reply:
        match request:
            case Status():
                return self._status()
            case Describe():
                return self._describe(caller)
            case _:
                assert_never(request)

    async def _job(self, request: AnyJob, caller: Caller) -> Reply:
        done = await self._with.runner.submit(request, caller.client)
        if not request.wait and not done.done():
            return JobReply(id=request.id)
        # Shielded: the future belongs to the job, and other clients may wait for the same one.
        return JobReply(id=request.id, result=await asyncio.shield(done))

    def _status(self) -> StatusReply:
        runner, latch, calibrations = self._with.runner, self._with.latch, self._with.calibrations.in_force
        running, fault = runner.running, latch.fault
        return StatusReply(
            station=self._with.settings.config.station.name,
            state=latch.state.value,
            lifecycle=latch.lifecycle.value,
            fault=ErrorBody.of(fault) if fault else None,
            running=Running(id=running.id, op=running.op, progress=runner.progress) if running else None,
            queued=runner.queued,
            calibration=CalibrationState(
                tip=calibrations.probe is not None,
                map_made_at=calibrations.mapped_at,
                made_at=calibrations.made_at(),
                aligned=calibrations.alignment(self._with.settings.board) is not None,
                not_used=dict(calibrations.problems),
            ),
            pictures=self._with.images.full or "kept",
            needle=NeedleState(place=self._with.needle.place.value, z_um=self._with.needle.z_um),
        )

    async def _snapshot(self) -> SnapshotReply:
        """Answer what a late joiner needs.

        `next_seq` is read first: what is published while the rest is read comes again in the replay, and is not missed.
        """
        next_seq = self._journal.upcoming_seq
        last, touches = await self._journal.last_result(), await self._journal.touches()
        links = Links.model_validate(self._with.vitals().links())
        status = self._status()
        facts = {name: getattr(status, name) for name in StatusReply.model_fields}
        return SnapshotReply(**facts, next_seq=next_seq, last_result=last, touches=touches, links=links)

    def _describe(self, caller: Caller) -> DescribeReply:
        config, board = self._with.settings.config, self._with.settings.board
        api = config.api
        return DescribeReply(
            station=config.station.name,
            ops=list(OPERATIONS.ops),
            events=api.events,
            board=_board_facts(board),
            errors=[
                ErrorFacts(code=k.code, name=k.wire_name, cause=k.value.cause, advice=k.value.advice) for k in FaultCode
            ],
            versions=list(VERSIONS),
            topics=list(TOPICS),
            you=You(
                client=caller.client,
                role=caller.role,
                ops=[op for op in OPERATIONS.ops if OPERATIONS.may(caller.role, op)],
            ),
            limits=Limits(
                max_message_bytes=api.max_message_bytes, rate_per_s=api.rate_per_s, rate_burst=api.rate_burst,
                queue_length=api.queue_length, queue_per_client=api.queue_per_client,
            ),
        )  # fmt: skip

    async def _reset(self) -> Reply:
        fault = await self._with.reset()
        if fault is not None:
            raise fault
        return self._status()

    async def _result(self, job_id: str) -> Reply:
        stored = await self._journal.job(job_id)
        if stored is None:
            raise Fault(FaultCode.UNKNOWN_JOB, f"no job {job_id!r}"[:200], id=job_id)
        return ResultReply(id=job_id, done=stored.result is not None, result=stored.result)

    async def _alerts(self, request: Alerts) -> Reply:
        past = await self._journal.alerts(request.since, request.limit)
        overview = self._with.monitor.overview()
        return AlertsReply(alerts=[PastAlert.model_validate(alert) for alert in past], **overview)

    async def _acknowledge(self, request: Acknowledge) -> Reply:
        monitor = self._with.monitor
        known = await monitor.acknowledge(request.alert, request.by, request.note, mended=request.mended)
        return AcknowledgeReply(alert=AlertFacts.model_validate(known.to_dict()))

    async def _report(self, request: Report) -> Reply:
        if request.id is not None and await self._journal.job(request.id) is None:
            raise Fault(FaultCode.UNKNOWN_JOB, f"no job {request.id!r}"[:200], id=request.id)
        await self._journal.add_report(request.id, request.retest, request.touches)
        self._with.metrics.report(request.retest, request.touches)
        self._with.monitor.on_touches(request.touches)
        return ReportReply(touches=await self._journal.touches())


def _board_facts(board: Board) -> BoardFacts:
    points = [p.model_dump(exclude={"why_not"}) for p in board.test_points()]
    return BoardFacts(
        name=board.name,
        side=board.side,
        width_um=board.width_um,
        height_um=board.height_um,
        test_points=[TestPoint.model_validate(point) for point in points],
        not_probeable={p.name: p.why_not for p in board.points if p.why_not} | board.hidden,
    )
