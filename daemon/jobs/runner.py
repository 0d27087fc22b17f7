"""The queue of jobs: one runs, the rest wait, and every id is answered the same way for ever.

This is where a job's end becomes the machine's last transition, the journal's entry, the event and the answer, in that
order. Whatever a job raises, the lights go off and the first cause of a latched fault is kept.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import structlog

from daemon.config.model import ServoSection
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody, JobResult
from daemon.domain.states import BUSY, Event, Machine, State
from daemon.jobs.context import JobContext, Outcome, Procedure, StationContext
from daemon.jobs.fair_queue import FairQueue
from daemon.jobs.image_archive import ImageArchive
from daemon.jobs.observer import JobObserver, Publisher
from daemon.jobs.preconditions import refuse_in_fault, refuse_other_request, refuse_unknown_point
from daemon.jobs.watchdog import Watchdog
from daemon.platform.clock import utc_now
from daemon.station.allowance import Allowance
from daemon.station.device_errors import as_fault, forget_frames
from daemon.storage.journal import Journal
from daemon.wire.deadline import due_at_s
from daemon.wire.requests import AnyJob
from drivers.deadline import Deadline

LENGTHY = frozenset({"calibrate", "align"})
"""Jobs of minutes, whose deadline is another one where the request brings none."""
DARK_WITHIN_S = 2.0
log = structlog.get_logger(__name__)


@dataclass
class _Ticket:
    """A job from its arrival to its result."""

    request: AnyJob
    canonical: str
    due_s: float
    done: asyncio.Future[JobResult]
    client: str = ""
    cancelled: bool = False
    task: asyncio.Task[Outcome] | None = field(default=None, repr=False)
    job: JobContext | None = field(default=None, repr=False)


class JobRunner:
    """Take requests, run them one after the other, remember their results."""

    def __init__(self, machine: Machine, journal: Journal, events: Publisher, pictures: ImageArchive, station: str,
                 servo: ServoSection, procedures: Mapping[str, Procedure], queue_length: int,
                 queue_per_client: int | None = None) -> None:  # fmt: skip
        self._procedures = procedures
        self._machine, self._journal, self._events, self._pictures = machine, journal, events, pictures
        self._station, self._servo, self._queue_length = station, servo, queue_length
        self._queue_per_client = queue_length if queue_per_client is None else queue_per_client
        self._waiting: FairQueue[_Ticket] = FairQueue()
        self._open: dict[str, _Ticket] = {}
        self._running: _Ticket | None = None
        self.context: StationContext | None = None
        self.fault: Fault | None = None
        """The first cause of the present fault; later refusals name it."""
        self.progress: dict[str, Any] | None = None
        """How far the running job says it is, if it says so."""
        self.watchdog = Watchdog()
        """What is asked each time the loop turns: only while all is well is the watchdog fed."""
        self.between = asyncio.Lock()
        """Held while a job runs; who holds it may change what jobs work with."""
        self.on_result: Callable[[JobResult], None] = lambda _result: None
        """Called with every result, once it has been published."""
        self.observer = JobObserver()
        """What maintenance hears of."""

    # --- taking ----------------------------------------------------------------------------------------------

    async def submit(self, request: AnyJob, client: str = "") -> asyncio.Future[JobResult]:
        """Accept a job, or find the one that already has this id; raise `Fault` if it is refused.

        The jobs of different clients are run in turn.
        """
        canonical = request.model_dump_json(exclude={"wait", "deadline_ms"})
        known = await self._known(request.id, canonical)
        if known is not None:
            return known
        refuse_in_fault(request, self.fault)
        lengthy = request.op in LENGTHY
        due_s = due_at_s(
            request.deadline_ms, self._servo.calibration_timeout_s if lengthy else self._servo.job_timeout_s
        )
        self._refuse_too_many(client)
        if self.context is not None:
            refuse_unknown_point(request, self.context.board)
        ticket = _Ticket(request, canonical, due_s, asyncio.get_running_loop().create_future(), client)
        self._open[request.id] = ticket
        try:
            await self._journal.add_job(request.id, request.op, canonical)
        except BaseException:
            del self._open[request.id]
            raise
        self._waiting.put(client, ticket)
        return ticket.done

    async def _known(self, job_id: str, canonical: str) -> asyncio.Future[JobResult] | None:
        """Return the answer this id already has or will get."""
        ticket = self._open.get(job_id)
        if ticket is not None:
            refuse_other_request(job_id, canonical, ticket.canonical)
            return ticket.done
        stored = await self._journal.job(job_id)
        ticket = self._open.get(job_id)
        if ticket is not None:  # it arrived twice while the journal was asked
            refuse_other_request(job_id, canonical, ticket.canonical)
            return ticket.done
        if stored is None:
            return None
        refuse_other_request(job_id, canonical, stored.request)
        if stored.result is None:  # the disk failed when it ended; who waits must not wait for ever
            raise Fault(FaultCode.JOURNAL_FAILED, f"the result of job {job_id!r} could not be written"[:200], id=job_id)
        done: asyncio.Future[JobResult] = asyncio.get_running_loop().create_future()
        done.set_result(stored.result)
        return done

    def _refuse_too_many(self, client: str) -> None:
        """Refuse a job beyond what may wait, of this client or of all; its own share is named first."""
        theirs = sum(t.client == client for t in self._open.values() if t is not self._running)
        limits = {"limit": self._queue_length, "limit_per_client": self._queue_per_client}
        if theirs >= self._queue_per_client:
            raise Fault(FaultCode.BUSY, f"{theirs} jobs of this client wait already", **limits)
        if len(self._open) >= self._queue_length + 1:
            raise Fault(FaultCode.BUSY, f"{len(self._open)} jobs are open", **limits)

    # --- running ---------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Run jobs for ever; cancelling stops the one under way safely."""
        while True:
            ticket = await self._next()
            async with self.between:
                self.watchdog.begin(ticket.due_s)
                running = asyncio.create_task(self._run_one(ticket), name=f"job {ticket.request.id}")
                try:
                    await self.watchdog.supervise(running, partial(self._activity, ticket))
                finally:
                    self._running = None
                    self._open.pop(ticket.request.id, None)
                    ticket.job = None  # the last ticket stays until the next one comes; its pictures are 24 MB

    async def _next(self) -> _Ticket:
        """Wait for a job; the loop turns all the while."""
        while True:
            self.watchdog.check_in()
            try:
                async with asyncio.timeout(self.watchdog.every_s):
                    return await self._waiting.get()
            except TimeoutError:
                continue

    def _activity(self, ticket: _Ticket) -> Hashable:
        """Return what changes whenever the running job does something that shows."""
        exchanges = self.context.station.exchanges if self.context is not None else None
        return ticket.job.activity if ticket.job is not None else None, str(self.progress), exchanges

    async def _run_one(self, ticket: _Ticket) -> None:
        """Run one job and tell everybody how it ended."""
        await self._journal.reserve_seqs()
        self._running = ticket
        request = ticket.request
        self.progress = None
        keep_step, tell = self._keep_step(request.id), self._tell_progress(request)
        job = ticket.job = JobContext(request, Deadline(ticket.due_s), self._machine.fire, keep_step, tell)
        with structlog.contextvars.bound_contextvars(job=request.id, op=request.op):
            try:
                outcome, fault = await self._outcome(ticket, job), None
            except asyncio.CancelledError:
                await self._finish(ticket, job, job.partial, Fault(FaultCode.SHUTTING_DOWN, "the daemon was stopped"))
                raise
            except Exception as exc:  # the one place where every way a job can end is turned into an answer
                outcome, fault = job.partial, as_fault(exc)
                if fault.kind is FaultCode.INTERNAL:
                    log.exception("job_failed_internally")
                forget_frames(exc)
            await self._finish(ticket, job, outcome, fault)

    async def _outcome(self, ticket: _Ticket, job: JobContext) -> Outcome:
        """Do the errand; walk the machine's last step whatever comes."""
        end = Event.ON_TARGET
        latched: Fault | None = None
        try:
            if ticket.cancelled:
                raise Fault(FaultCode.CANCELLED, "cancelled before it began")
            context = self._admit(ticket)
            job.watch.enter(State.TRIGGERED.value)
            return await self._errand(ticket, job, context)
        except asyncio.CancelledError:
            end = Event.CANCELLED
            raise
        except Exception as exc:
            fault = as_fault(exc)
            end = self._ending(fault)
            latched = self._latched_by(ticket, fault)
            raise
        finally:
            # The job's own trouble came first; that the lights then failed too is usually its consequence.
            lights = await self._darken(job)
            self._end(end, latched or lights)

    @staticmethod
    def _latched_by(ticket: _Ticket, fault: Fault) -> Fault | None:
        """Return what keeps the daemon in fault: a latched fault, or that homing did not come to its end."""
        if fault.kind.latched:
            return fault
        return (
            Fault(FaultCode.NOT_HOMED, f"homing ended early: {fault.message}") if ticket.request.op == "home" else None
        )

    def _admit(self, ticket: _Ticket) -> StationContext:
        """Begin: leave `not_homed` for homing, check the deadline again, and go to `triggered`."""
        refuse_in_fault(ticket.request, self.fault)
        if self.context is None:
            raise Fault(FaultCode.IN_FAULT, "the station is not open")
        if self._machine.state is State.FAULT:
            self.clear()
        self._machine.fire(Event.TRIGGER)
        if Deadline(ticket.due_s).expired:
            raise Fault(FaultCode.STALE_DEADLINE, "the deadline passed while the job waited", id=ticket.request.id)
        return self.context

    async def _errand(self, ticket: _Ticket, job: JobContext, context: StationContext) -> Outcome:
        """Run the errand as a task of its own, so that `cancel` reaches it and nothing else."""
        ticket.task = asyncio.create_task(self._timed(self._procedures[ticket.request.op], job, context))
        try:
            return await asyncio.shield(ticket.task)
        except asyncio.CancelledError:
            ours = not ticket.task.done()
            ticket.task.cancel()
            await asyncio.wait([ticket.task])
            await context.station.stop()
            if ours:
                raise
            raise Fault(FaultCode.CANCELLED, "the job was cancelled; all motion was stopped") from None

    @staticmethod
    async def _timed(errand: Procedure, job: JobContext, context: StationContext) -> Outcome:
        """Hold the errand to its deadline; running out of time stops motion like a cancel does."""
        try:
            async with asyncio.timeout_at(asyncio.get_running_loop().time() + job.deadline.remaining_s):
                return await errand(job, context)
        except TimeoutError as exc:
            if not job.deadline.expired:
                raise
            await context.station.stop()
            raise Fault(FaultCode.DEADLINE_MISSED) from exc

    def _ending(self, fault: Fault) -> Event:
        """Return the event that ends a job which met `fault` in the present state."""
        if fault.kind in (FaultCode.CANCELLED, FaultCode.DEADLINE_MISSED):
            return Event.CANCELLED
        if self._machine.state is State.TRIGGERED and not fault.kind.latched:
            return Event.REFUSED
        return Event.FAILED

    def _end(self, event: Event, latched: Fault | None) -> None:
        """Take the machine's last step of a job; a fault that is not latched clears itself."""
        if self._machine.state in BUSY:
            self._machine.fire(event)
        if latched is not None:
            self.latch(latched)
        elif self._machine.state is State.FAULT and self.fault is None:
            self._machine.fire(Event.CLEARED)

    async def _darken(self, job: JobContext) -> Fault | None:
        """Switch the lights off; return what kept them on, which never hides how the job ended."""
        if self.context is None or self._machine.state not in BUSY:
            return None
        try:
            await asyncio.shield(self.context.station.lights_off(Allowance(Deadline.after(DARK_WITHIN_S), job.watch)))
        except Exception as exc:  # noqa: BLE001  # the job's own end matters more; the light's trouble latches a fault
            log.error("lights_not_off", error=str(exc))
            return as_fault(exc)
        return None

    # --- telling ---------------------------------------------------------------------------------------------

    async def _finish(self, ticket: _Ticket, job: JobContext, outcome: Outcome, fault: Fault | None) -> None:
        """Journal, publish, answer, then keep the pictures; in this order."""
        timing = job.watch.timing_ms()
        folder = self._pictures.folder_for(ticket.request, failed=fault is not None)
        result = JobResult(
            id=ticket.request.id,
            op=ticket.request.op,
            ok=fault is None,
            seq=self._journal.take_seq(),
            station=self._station,
            finished_at=utc_now(),
            outcome=outcome.outcome if fault is None else "failed",
            test_point=outcome.test_point,
            error_before_um=outcome.error_before_um,
            error_after_um=outcome.error_after_um,
            looks=job.looks,
            moves=job.moves,
            timing_ms=timing,
            pictures=str(folder) if folder and job.looks else None,
            detail=outcome.detail,
            error=ErrorBody.of(fault) if fault else None,
        )
        try:
            await job.settle()
            await self._journal.finish_job(result)
        except Fault as disk:
            self.latch(disk)
        self._events.publish("result", result.model_dump(mode="json"), seq=result.seq)
        self.on_result(result)
        # Answered is over: what is kept of it afterwards cannot be cancelled any more.
        self._running = None
        self._open.pop(ticket.request.id, None)
        if not ticket.done.done():
            ticket.done.set_result(result)
        log.info("job_done", outcome=result.outcome, ok=result.ok, error=fault.message if fault else None)
        self.observer.on_result(job, result)
        if result.pictures and folder:
            await self._keep_pictures(folder, job, result)

    async def _keep_pictures(self, folder: Path, job: JobContext, result: JobResult) -> None:
        """Keep the pictures; that they cannot be kept any more, or can again, is an alert."""
        await self._pictures.keep(folder, job, result)
        # Told each time: an alert of a daemon before this one may stand, whose cause is gone.
        self.observer.on_flag("pictures_not_kept", self._pictures.full)

    def _keep_step(self, job_id: str) -> Callable[[str, dict[str, Any]], Any]:
        def keep(kind: str, body: dict[str, Any]) -> Any:
            self.observer.on_step(job_id, kind, body)
            return self._journal.add_step(job_id, kind, body)

        return keep

    def _tell_progress(self, request: AnyJob) -> Callable[[int, int, str], None]:
        def tell(done: int, total: int, doing: str) -> None:
            self.progress = {"done": done, "total": total, "doing": doing}
            self._events.publish("progress", {"job": request.id, "op": request.op, **self.progress})

        return tell

    # --- steering --------------------------------------------------------------------------------------------

    @property
    def running(self) -> AnyJob | None:
        """The request under way."""
        return self._running.request if self._running else None

    @property
    def queued(self) -> int:
        """How many jobs wait."""
        return len(self._waiting)

    def cancel(self, job_id: str | None) -> str:
        """Stop a job, or the running one; return its id."""
        ticket = self._open.get(job_id) if job_id else self._running
        if ticket is None:
            raise Fault(FaultCode.UNKNOWN_JOB, "no such job is open" if job_id else "no job runs", id=job_id)
        ticket.cancelled = True
        if ticket.task is not None:
            ticket.task.cancel()
        return ticket.request.id

    def adopt(self, servo: ServoSection, queue_length: int, queue_per_client: int) -> None:
        """Take over another configuration; jobs that wait keep the deadline they came with."""
        self._servo, self._queue_length, self._queue_per_client = servo, queue_length, queue_per_client

    def latch(self, fault: Fault) -> None:
        """Stay in fault; the first cause is kept."""
        self.fault = self.fault or fault
        if self._machine.state is not State.FAULT:
            self._machine.fire(Event.FAILED)

    def clear(self) -> None:
        """Leave the fault."""
        self.fault = None
        if self._machine.state is State.FAULT:
            self._machine.fire(Event.CLEARED)
