"""Handlers of the control socket's operations: what each answers.

Jobs are handed to the job runner; every other operation has its case and its method here.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import assert_never

from daemon.config.current import CurrentSettings
from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.no_paths import without_paths
from daemon.domain.point_test import TESTER_WORDS, UNIT_WORDS
from daemon.domain.results import ErrorBody, JobResult
from daemon.domain.roles import ROLES, Caller
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.held_touch import HeldTouch
from daemon.jobs.image_archive import ImageArchive
from daemon.jobs.runner import JobRunner
from daemon.maintenance.monitor import Monitor
from daemon.server.audit_trail import AuditTrail
from daemon.server.chart_desk import ChartDesk
from daemon.server.plan_desk import PlanDesk
from daemon.server.record_desk import RecordDesk
from daemon.server.settings_told import settings_told
from daemon.station.needle import Needle
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal, PastWanted
from daemon.telemetry.metrics import Metrics
from daemon.telemetry.vitals import Vitals
from daemon.wire.deadline import due_at_s
from daemon.wire.events import TOPICS, AlertFacts
from daemon.wire.operations.control import (
    CalibrationState,
    Cancel,
    CancelReply,
    Hold,
    HoldReply,
    LightUp,
    LightUpReply,
    Links,
    NeedleState,
    Pause,
    PauseReply,
    Reset,
    Result,
    ResultReply,
    Results,
    ResultsReply,
    RunFacts,
    Running,
    Snapshot,
    SnapshotReply,
    Status,
    StatusReply,
)
from daemon.wire.operations.describe import (
    BoardFacts,
    Configuration,
    ConfigurationReply,
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
    Charts,
    PastAlert,
    Report,
    ReportReply,
)
from daemon.wire.operations.jobs import AnyJob, JobReply, Lift
from daemon.wire.operations.records import (
    Audit,
    AuditEntry,
    AuditReply,
    History,
    HistoryReply,
    Note,
    NoteReply,
    PastResult,
    Picture,
    PictureReply,
    Pictures,
    PicturesReply,
    Records,
)
from daemon.wire.operations.row import DefaultDeadline
from daemon.wire.operations.runs import MarkPoint, Marks, PlanRequest, Points, PointTests
from daemon.wire.operations.table import OPERATIONS, AnyRequest
from daemon.wire.replies import Reply
from daemon.wire.requests import VERSIONS, ImmediateRequest, JobRequest
from drivers.lights import Light

SHORT_S = 1.0
TOUCHING_OPS = frozenset(
    row.op for row in OPERATIONS.rows if issubclass(row.request, JobRequest) and row.request.TOUCHES
)
"""Jobs whose held needle a `lift` ends."""


@dataclass(frozen=True)
class Collaborators:
    """What of the running daemon the operations ask."""

    settings: CurrentSettings
    latch: FaultLatch
    runner: JobRunner
    reset: Callable[[], Awaitable[Fault | None]]
    """Try to leave a fault; return what still speaks against it."""
    light: Callable[[Light, float], Awaitable[None]]
    """Have a lamp on for so many seconds."""
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
        self._plans = PlanDesk(collaborators.settings, collaborators.journal)
        station = collaborators.settings.config.station
        self._charts = ChartDesk(station.name, station.journal)
        self._audit = AuditTrail(collaborators.journal)
        self._records = RecordDesk(collaborators.settings.config.station.name, collaborators.journal.stream)

    def at_once(self, request: AnyRequest, caller: Caller) -> Reply | None:
        """Return the reply to what needs no waiting, else None."""
        return self._immediate(request, caller) if isinstance(request, ImmediateRequest) else None

    async def handle(self, request: AnyRequest, caller: Caller) -> Reply:
        """Return the reply, or raise `Fault`; an order is written down before it is carried out."""
        work = self._carry_out(request, caller)
        if request.only_asks or not OPERATIONS.row(request.op).is_order:
            return await work
        return await self._audit.around(request.op, request, caller, work)

    async def _carry_out(self, request: AnyRequest, caller: Caller) -> Reply:  # noqa: C901, PLR0912  # a case each
        if OPERATIONS.row(request.op).deadline is DefaultDeadline.SHORT:
            due_at_s(request.deadline_ms, SHORT_S)
        match request:
            case Lift():
                return await self._lift(request, caller)
            case JobRequest():
                return await self._job(request, caller)
            case ImmediateRequest():
                return self._immediate(request, caller)
            case Cancel():
                return CancelReply(cancelled=self._with.runner.cancel(request.id))
            case Pause():
                return PauseReply(paused=self._with.runner.pause(request.id))
            case Reset():
                return await self._reset()
            case LightUp():
                return await self._light(request)
            case Snapshot():
                return await self._snapshot()
            case Result():
                return await self._result(request.id)
            case Results():
                return ResultsReply(results=await self._journal.results(request.since, request.limit))
            case Alerts():
                return await self._alerts(request)
            case Acknowledge():
                return await self._acknowledge(request, caller)
            case Report():
                return await self._report(request)
            case Charts():
                return await self._charts.charts(request.month)
            case Points() | PointTests() | MarkPoint() | Marks() | PlanRequest():
                return await self._plans.answer(request, caller)
            case History():
                return await self._history(request)
            case Audit():
                return await self._audited(request)
            case Pictures():
                hashes = await self._with.images.hashes_of(request.id)
                return PicturesReply(id=request.id, pictures=list(hashes), sha256=hashes)
            case Picture():
                return await self._picture(request)
            case Records():
                return await self._records.records(request.journal, request.since, request.limit, request.kinds)
            case Note():  # as an order it is written down already
                return NoteReply()
            case _:
                assert_never(request)

    def _immediate(self, request: Status | Describe | Configuration | Hold, caller: Caller) -> Reply:
        match request:
            case Hold():
                return self._hold(request, caller)
            case Status():
                return self._status()
            case Describe():
                return self._describe(caller)
            case Configuration():
                refused = [without_paths(why) for why in self._with.settings.refused]
                return ConfigurationReply(settings=settings_told(self._with.settings.config), refused=refused)
            case _:
                assert_never(request)

    async def _job(self, request: AnyJob, caller: Caller) -> Reply:
        runner = self._with.runner
        done = await runner.submit(request, caller.client, caller.key)
        touch = runner.touch(request.id) if request.wait == "contact" else None
        if touch is not None:
            await asyncio.wait((done, touch.made), return_when=asyncio.FIRST_COMPLETED)
            if not done.done() and (contact := touch.contact) is not None:
                return JobReply(id=request.id, contact=contact)
        if not request.wait and not done.done():
            return JobReply(id=request.id)
        # Shielded: the future belongs to the job, and other clients may wait for the same one.
        return JobReply(id=request.id, result=await asyncio.shield(done))

    def _hold(self, request: Hold, caller: Caller) -> HoldReply:
        touch = self._with.runner.touch(request.id)
        if touch is None:
            raise Fault(FaultCode.UNKNOWN_JOB, f"no touch {request.id!r} is open"[:200], id=request.id)
        contact, until_ms = touch.renew(caller.key, request.lease_ms)
        return HoldReply(id=request.id, until_ms=round(until_ms, 1), contact=contact)

    async def _lift(self, request: Lift, caller: Caller) -> Reply:
        """End the touch of this id and answer its result, or that it stands again; any other id is a job of its own."""
        runner = self._with.runner
        touch, done = runner.touch(request.id), runner.result_of(request.id)
        if touch is not None and done is not None:
            _refuse_word(request, touch)
            _refuse_unit(request, touch)
            touch.lift(caller.key, request.measured, request.press)
            again = touch.made
            await asyncio.wait((done, again), return_when=asyncio.FIRST_COMPLETED)
            if not done.done() and again.done():
                return JobReply(id=request.id, contact=again.result())
            return _lifted(request, await asyncio.shield(done))
        stored = await self._journal.job(request.id)
        if stored is not None and stored.result is not None and stored.result.op in TOUCHING_OPS:
            return _lifted(request, stored.result)
        if request.measured or request.press is not None:
            raise Fault(FaultCode.UNKNOWN_JOB, f"no touch {request.id!r} is known"[:200], id=request.id)
        return await self._job(request, caller)

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
                not_used={kind: without_paths(why) for kind, why in calibrations.problems.items()},
            ),
            pictures=without_paths(self._with.images.full or "kept"),
            needle=NeedleState(place=self._with.needle.place.value, z_um=self._with.needle.z_um),
            configuration_refused=[without_paths(why) for why in self._with.settings.refused],
        )

    async def _light(self, request: LightUp) -> Reply:
        await self._with.light(Light(request.colour), request.lease_ms / 1e3)
        return LightUpReply(colour=request.colour, until_ms=request.lease_ms)

    async def _snapshot(self) -> SnapshotReply:
        """Answer what a late joiner needs.

        `next_seq` is read first: what is published while the rest is read comes again in the replay, and is not missed.
        """
        next_seq = self._journal.upcoming_seq
        last, touches = await self._journal.last_result(), await self._journal.touches()
        journal = await self._journal.stream.journal()
        links = Links.model_validate(self._with.vitals().links())
        run = await self._journal.runs.newest()
        status = self._status()
        facts = {name: getattr(status, name) for name in StatusReply.model_fields}
        return SnapshotReply(**facts, next_seq=next_seq, journal=journal, last_result=last, touches=touches,
                             links=links, contact=self._with.runner.contact,
                             board_revision=self._with.settings.board.revision,
                             run=RunFacts.model_validate(run) if run else None)  # fmt: skip

    def _describe(self, caller: Caller) -> DescribeReply:
        config, board = self._with.settings.config, self._with.settings.board
        api = config.api
        return DescribeReply(
            station=config.station.name,
            ops=list(OPERATIONS.ops),
            events=api.events,
            live=api.live,
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
        if fault is not None and fault.kind is FaultCode.NOT_HOMED:
            # It is asked for last: all that a reset can do is done
            told = "the reset worked, nothing else is found wrong; what is left is to home the axes"
            raise Fault(fault.kind, f"{told} ({fault.message})", **fault.detail, reset="done")
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
        overview, fault = self._with.monitor.overview(), self._with.latch.fault
        in_force = self._with.calibrations.in_force
        missing = [
            kind for kind, is_there in (("tip", in_force.probe), ("map", in_force.mapped_at)) if is_there is None
        ]
        overview["healthy"] = overview["healthy"] and fault is None and not missing
        told = ErrorBody.of(fault) if fault else None
        seen = [PastAlert.model_validate(alert) for alert in past]
        return AlertsReply(alerts=seen, fault=told, not_calibrated=missing, **overview)

    async def _acknowledge(self, request: Acknowledge, caller: Caller) -> Reply:
        if request.mended and caller.role != ROLES[-1]:
            raise Fault(
                FaultCode.NOT_ALLOWED, f"to say that it is mended needs the role {ROLES[-1]}, this key has "
                f"{caller.role}", needs=ROLES[-1], role=caller.role,
            )  # fmt: skip
        monitor = self._with.monitor
        known = await monitor.acknowledge(request.alert, request.by, request.note, mended=request.mended)
        return AcknowledgeReply(alert=AlertFacts.model_validate(known.to_dict()))

    async def _history(self, request: History) -> Reply:
        wanted = PastWanted(request.of, request.test_point, request.board_id, request.outcome)
        found = await self._journal.history(wanted, request.before, request.limit + 1)
        results = [PastResult(**result.model_dump(), board_id=board) for result, board in found[: request.limit]]
        return HistoryReply(results=results, more=len(found) > request.limit)

    async def _picture(self, request: Picture) -> Reply:
        jpeg = await self._with.images.picture(request.id, request.which)
        if jpeg is None:
            raise Fault(FaultCode.UNKNOWN_PICTURE, id=request.id, which=request.which)
        digest = hashlib.sha256(jpeg).hexdigest()
        return PictureReply(id=request.id, which=request.which, jpeg=base64.b64encode(jpeg).decode(), sha256=digest)

    async def _audited(self, request: Audit) -> Reply:
        found = await self._journal.orders(request.before, request.limit + 1)
        entries = [AuditEntry.model_validate(order) for order in found[: request.limit]]
        return AuditReply(entries=entries, more=len(found) > request.limit)

    async def _report(self, request: Report) -> Reply:
        if request.id is not None and await self._journal.job(request.id) is None:
            raise Fault(FaultCode.UNKNOWN_JOB, f"no job {request.id!r}"[:200], id=request.id)
        await self._journal.add_report(request.id, request.retest, request.touches)
        self._with.metrics.report(request.retest, request.touches)
        self._with.monitor.on_touches(request.touches)
        return ReportReply(touches=await self._journal.touches())


def _refuse_word(request: Lift, touch: HeldTouch) -> None:
    """Refuse a word that a probe cannot take for a verdict; the needle stays where it is."""
    if touch.judged and request.verdict is not None and request.verdict.lower() not in TESTER_WORDS:
        problem = f"of a probe: {', '.join(sorted(TESTER_WORDS))}"
        fields = [{"field": "verdict", "problem": problem}]
        raise Fault(FaultCode.INVALID_REQUEST, f"{request.verdict!r} is no verdict {problem}", fields=fields)


def _refuse_unit(request: Lift, touch: HeldTouch) -> None:
    """Refuse a value that would be judged by limits of another unit; the needle stays where it is."""
    said = UNIT_WORDS.get((request.unit or "").lower(), request.unit)
    if request.value is not None and said is not None and touch.unit not in (None, said):
        fields = [{"field": "unit", "problem": f"{touch.unit}, by which this probe is judged, and not {request.unit}"}]
        raise Fault(
            FaultCode.INVALID_REQUEST, f"{request.unit!r} is not {touch.unit}, the unit judged by", fields=fields
        )


def _board_facts(board: Board) -> BoardFacts:
    points = [p.model_dump(exclude={"why_not", "centre_um", "metal_um"}) for p in board.test_points()]
    return BoardFacts(
        name=board.name,
        side=board.side,
        width_um=board.width_um,
        height_um=board.height_um,
        test_points=[TestPoint.model_validate(point) for point in points],
        not_probeable={p.name: p.why_not for p in board.points if p.why_not} | board.hidden,
    )


def _lifted(request: Lift, result: JobResult) -> JobReply:
    """Answer what came of a touch; raise `Fault` if it passed and what the tester says now is not what was kept."""
    kept, last = result.detail.get("measured"), result.detail.get("press")
    if result.ok and request.measured and request.press is not None and last not in (None, request.press):
        why = f"press {request.press} of {request.id!r} is not the one whose word was kept last, which was {last}"
        raise Fault(FaultCode.ANOTHER_PRESS, why[:200], id=request.id, press=request.press, kept=kept)
    if result.ok and request.measured and request.measured != kept:
        raise Fault(FaultCode.VERDICT_NOT_KEPT, id=request.id, kept=kept)
    return JobReply(id=request.id, result=result)
