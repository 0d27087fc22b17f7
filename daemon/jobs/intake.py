"""Intake of jobs: requests become tickets, an id is taken once, and nobody holds more than its share of the queue."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import UNIT_OF_METHOD
from daemon.domain.results import JobResult
from daemon.domain.states import Lifecycle
from daemon.jobs.context import JobContext, Outcome
from daemon.jobs.fair_queue import FairQueue
from daemon.jobs.held_touch import HeldTouch
from daemon.jobs.preconditions import refuse_in_fault, refuse_other_request, refuse_unknown_point
from daemon.jobs.surroundings import JobLimits, Surroundings
from daemon.station.device_errors import as_fault
from daemon.wire.deadline import due_at_s
from daemon.wire.operations.jobs import AnyJob, Probe, Touch
from daemon.wire.operations.row import DefaultDeadline
from daemon.wire.operations.table import OPERATIONS

RUN_WITHIN_S = 86_400.0
"""A run is as long as its plan; each of its points has the time of a job."""


@dataclass
class Ticket:
    """A job from its arrival to its result."""

    request: AnyJob
    canonical: str
    due_s: float
    done: asyncio.Future[JobResult]
    client: str = ""
    key: str = ""
    """Name of the client's key; empty where nobody comes with one."""
    touch: HeldTouch | None = field(default=None, repr=False)
    """Of a job that touches, what `hold` and `lift` reach."""
    cancelled: bool = False
    task: asyncio.Task[Outcome] | None = field(default=None, repr=False)
    job: JobContext | None = field(default=None, repr=False)


class JobIntake:
    """Tickets of all jobs that are not answered yet: those that wait, and the one that runs."""

    def __init__(self, surroundings: Surroundings) -> None:
        self._with = surroundings
        self._latch, self._journal = surroundings.latch, surroundings.journal
        self._waiting: FairQueue[Ticket] = FairQueue()
        self.open: dict[str, Ticket] = {}
        """Id -> ticket, from its arrival to its answer."""
        self.running: Ticket | None = None
        """The job under way, as the runner says."""

    @property
    def queued(self) -> int:
        """How many jobs were taken and have not begun, also one whose turn it is and that waits for the station."""
        return len(self.open) - (self.running is not None)

    async def next(self) -> Ticket:
        """Wait for the job whose turn it is."""
        return await self._waiting.get()

    def let_go(self, ticket: Ticket) -> None:
        """Be done with a job: its id is answered from the journal from now on."""
        self.running = None
        self.open.pop(ticket.request.id, None)

    async def submit(self, request: AnyJob, client: str = "", key: str = "") -> asyncio.Future[JobResult]:
        """Accept a job, or find the one that already has this id; raise `Fault` if it is refused.

        The jobs of different clients are run in turn.
        """
        canonical = request.model_dump_json(exclude={"wait", "deadline_ms"})
        known = await self._known(request.id, canonical)
        if known is not None:
            return known
        if self._latch.lifecycle is Lifecycle.CLOSING:
            raise Fault(FaultCode.SHUTTING_DOWN)
        refuse_in_fault(self._latch.against(request.op))
        limits = self._with.limits()
        default_s = _within_s(OPERATIONS.row(request.op).deadline, limits)
        touch = _held(request, key) if request.TOUCHES else None
        due_s = due_at_s(request.deadline_ms, default_s + request.held_ms / 1e3)
        self._refuse_too_many(client, limits)
        if request.ALONE and self.open:
            raise Fault(FaultCode.BUSY, f"something runs or waits, and a {request.op} never does", advice="wait for it")
        context = self._with.context()
        if context is not None:
            refuse_unknown_point(request, context.board)
        done: asyncio.Future[JobResult] = asyncio.get_running_loop().create_future()
        ticket = Ticket(request, canonical, due_s, done, client, key, touch)
        self.open[request.id] = ticket
        try:
            await self._journal.add_job(request.id, request.op, canonical)
        except BaseException as exc:
            self.open.pop(request.id, None)
            # Who sent the same id meanwhile waits for this ticket, and would wait without end.
            refuse(ticket.done, exc)
            raise
        self._waiting.put(client, ticket)
        return ticket.done

    async def _known(self, job_id: str, canonical: str) -> asyncio.Future[JobResult] | None:
        """Return the answer this id already has or will get."""
        ticket = self.open.get(job_id)
        if ticket is not None:
            refuse_other_request(job_id, canonical, ticket.canonical)
            return ticket.done
        stored = await self._journal.job(job_id)
        ticket = self.open.get(job_id)
        if ticket is not None:  # it arrived twice while the journal was asked
            refuse_other_request(job_id, canonical, ticket.canonical)
            return ticket.done
        if stored is None:
            return None
        refuse_other_request(job_id, canonical, stored.request)
        if stored.result is None:  # the disk failed when it ended; nobody may wait for it without end
            raise not_written(job_id)
        done: asyncio.Future[JobResult] = asyncio.get_running_loop().create_future()
        done.set_result(stored.result)
        return done

    def _refuse_too_many(self, client: str, allowed: JobLimits) -> None:
        """Refuse a job beyond what may wait, of this client or of all; its own share is named first."""
        theirs = sum(t.client == client for t in self.open.values() if t is not self.running)
        limits = {"limit": allowed.queue_length, "limit_per_client": allowed.queue_per_client}
        if theirs >= allowed.queue_per_client:
            raise Fault(FaultCode.BUSY, f"{theirs} jobs of this client wait already", **limits)
        if len(self.open) >= allowed.queue_length + 1:
            raise Fault(FaultCode.BUSY, f"{len(self.open)} jobs are open", **limits)


def _held(request: AnyJob, key: str) -> HeldTouch:
    """Return what `hold` and `lift` reach of a job that touches."""
    unit = UNIT_OF_METHOD[request.method] if isinstance(request, Probe) else None
    return HeldTouch(request.id, key, judged=not isinstance(request, Touch), unit=unit)


def _within_s(kind: DefaultDeadline, limits: JobLimits) -> float:
    """Return how long a job may take whose request says nothing."""
    if kind is DefaultDeadline.RUN:
        return RUN_WITHIN_S
    return limits.calibration_timeout_s if kind is DefaultDeadline.LENGTHY_JOB else limits.job_timeout_s


def not_written(job_id: str) -> Fault:
    """Return the fault of a job that has ended and whose result is not on disk."""
    return Fault(
        FaultCode.JOURNAL_FAILED, f"job {job_id!r} has ended, but its result could not be written yet"[:200],
        id=job_id, advice="free disk space, then ask again with the same id",
    )  # fmt: skip


def refuse(done: asyncio.Future[JobResult], why: BaseException) -> None:
    """Refuse a job to those who wait for it; that nobody may wait for it is no error."""
    if not done.done():
        done.set_exception(as_fault(why) if isinstance(why, Exception) else Fault(FaultCode.SHUTTING_DOWN))
        done.exception()
