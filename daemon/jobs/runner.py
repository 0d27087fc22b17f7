"""The job runner: one job runs, the rest wait, and an id always gets the same answer.

This is where a job's end becomes the machine's last transition, the journal's entry, the event and the answer, in that
order. Whatever a job raises, the station is made safe first (`daemon.jobs.safe_ending`: still, needle up, dark), and
what it leaves latched goes to the `FaultLatch`, which owns it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable
from functools import partial
from pathlib import Path
from typing import Any

import structlog

from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointRecord
from daemon.domain.results import JobResult, StepKind
from daemon.domain.states import BUSY, Event, State
from daemon.jobs.context import JobContext, KeptPoint, Outcome, PointLooks, Procedure, StationContext, Touching
from daemon.jobs.ended import EndedJob
from daemon.jobs.held_touch import HeldTouch
from daemon.jobs.intake import JobIntake, Ticket, not_written, refuse
from daemon.jobs.over_point import keep_stand
from daemon.jobs.preconditions import (
    refuse_in_fault,
    refuse_with_needle_down,
)
from daemon.jobs.safe_ending import make_safe
from daemon.jobs.surroundings import Surroundings
from daemon.platform.clock import utc_now
from daemon.station.device_errors import as_fault, forget_frames
from daemon.wire.operations.jobs import AnyJob
from drivers.deadline import Deadline
from drivers.shielded import finish

EXCLUSIVE_WITHIN_S = 60.0
"""What a reset, a health check or a reload may take at most while a job waits for it."""
log = structlog.get_logger(__name__)


class JobRunner:
    """Take requests, run them one after the other, remember their results."""

    def __init__(self, surroundings: Surroundings) -> None:
        self._with = surroundings
        self._latch, self._journal = surroundings.latch, surroundings.journal
        self._watchdog = surroundings.watchdog
        self._intake = JobIntake(surroundings)
        self._progress: dict[str, Any] | None = None
        self._unwritten: dict[str, EndedJob] = {}
        """Jobs that have ended and whose results nobody was told, for they could not be written."""

    async def submit(self, request: AnyJob, client: str = "", key: str = "") -> asyncio.Future[JobResult]:
        """Accept a job, or find the one that already has this id; raise `Fault` if it is refused.

        `client` has its share of the queue; `key` is the name of its key, by which it is known again, empty without.
        """
        return await self._intake.submit(request, client, key)

    # --- running ---------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Run jobs until cancelled; cancelling stops the one under way safely."""
        lock = self._with.lock
        while True:
            ticket = await self._next()
            waiting = self._watchdog.patience(EXCLUSIVE_WITHIN_S, lambda: lock.turns)
            async with lock.hold("job", every_s=self._watchdog.every_s, still_waiting=waiting):
                self._watchdog.begin(ticket.due_s)
                running = asyncio.create_task(self._run_one(ticket), name=f"job {ticket.request.id}")
                try:
                    await self._watchdog.supervise(running, partial(self._activity, ticket))
                finally:
                    self._intake.let_go(ticket)
                    ticket.job = None  # the last ticket stays until the next one comes; its pictures are 24 MB

    async def _next(self) -> Ticket:
        """Wait for a job; the loop turns all the while."""
        while True:
            self._watchdog.check_in()
            try:
                async with asyncio.timeout(self._watchdog.every_s):
                    return await self._intake.next()
            except TimeoutError:
                continue

    def _activity(self, ticket: Ticket) -> Hashable:
        """Return what changes whenever the running job does something that shows."""
        context = self._with.context()
        exchanges = context.station.exchanges if context is not None else None
        return ticket.job.activity if ticket.job is not None else None, str(self._progress), exchanges

    async def _run_one(self, ticket: Ticket) -> None:
        """Run one job and tell everybody how it ended."""
        self._intake.running = ticket
        request = ticket.request
        self._progress = None
        job = ticket.job = self._job_context(ticket)
        with structlog.contextvars.bound_contextvars(job=request.id, op=request.op):
            try:
                outcome, fault = await self._outcome(ticket, job), None
            except asyncio.CancelledError:
                stopped = Fault(FaultCode.SHUTTING_DOWN, "the daemon was stopped")
                await finish(self._finish(ticket, job, job.partial, stopped))
                raise
            except Exception as exc:  # the one place where every way a job can end is turned into an answer
                outcome, fault = job.partial, as_fault(exc)
                if fault.kind is FaultCode.INTERNAL:
                    log.exception("job_failed_internally")
                forget_frames(exc)
            # A job that came to its end is answered even if the daemon is told to stop while that is written down.
            await finish(self._finish(ticket, job, outcome, fault))

    def _job_context(self, ticket: Ticket) -> JobContext:
        keep_step, tell = self._keep_step(ticket.request.id), self._tell_progress(ticket.request)
        touching = None
        if ticket.touch is not None:
            touching = Touching(
                ticket.touch, ticket.key, self._journal, partial(self._tell_contact, "made"),
                partial(self._tell_contact, "lifted"), partial(self._keep_point, ticket),
                partial(self._tell_point, ticket), self._journal.runs,
            )  # fmt: skip
        return JobContext(
            ticket.request, Deadline(ticket.due_s), self._latch.fire, keep_step, tell, touching,
            mark_of=self._journal.mark_of,
        )  # fmt: skip

    async def refuse_waiting(self) -> None:
        """Answer the jobs that never began because the daemon stops; `run` must be over."""
        for ticket in tuple(self._intake.open.values()):
            job = self._job_context(ticket)
            fault = Fault(FaultCode.SHUTTING_DOWN, "the daemon was stopped before the job began")
            await self._finish(ticket, job, job.partial, fault)

    async def _outcome(self, ticket: Ticket, job: JobContext) -> Outcome:
        """Do what the job asks for; take the machine's last transition however it ends."""
        end = Event.ON_TARGET
        met: Fault | None = None
        departures = self._departures
        try:
            await self._journal.reserve_seqs()
            if ticket.cancelled:
                raise Fault(FaultCode.CANCELLED, "cancelled before it began")
            context = self._admit(ticket)
            job.watch.enter(State.TRIGGERED.value)
            procedure = self._procedure(ticket, job, context)
            return await keep_stand(ticket.request, ticket.key, context.station.needle, procedure)
        except asyncio.CancelledError:
            end = Event.CANCELLED
            raise
        except Exception as exc:
            met = as_fault(exc)
            end = self._ending(met)
            raise
        finally:
            unsafe: list[Fault] = []
            try:
                await self._make_safe(job, met, unsafe, moved=self._departures != departures)
            finally:
                self._end_contact(ticket)
                # The job's own trouble came first; what failed after it is usually its consequence.
                self._latch.end(end, *self._latched_by(met), *unsafe, passing=met)

    @property
    def _departures(self) -> int:
        """How many moves the needle of the station has heard of; 0 where there is no station."""
        context = self._with.context()
        return context.station.needle.departures if context is not None else 0

    async def _make_safe(self, job: JobContext, met: Fault | None, unsafe: list[Fault], *, moved: bool) -> None:
        """Stop, raise the needle and darken after a job that began; a cancellation waits until that is done."""
        context = self._with.context()
        if context is not None and self._latch.state in BUSY:
            await finish(make_safe(context.station, self._latch, met, job.watch, unsafe, moved=moved))

    def _latched_by(self, fault: Fault | None) -> tuple[Fault, ...]:
        """Return what keeps the daemon in fault: a latched fault, or that homing moved something and did not end.

        That the needle was down keeps nobody once it was raised.
        """
        context = self._with.context()
        if fault is None or (fault.kind is FaultCode.NEEDLE_DOWN and context and context.station.needle.is_up):
            return ()
        if fault.kind.latched:
            return (fault,)
        began = self._latch.running
        homing = began is not None and began[0] == "home" and self._latch.state is not State.TRIGGERED
        return (Fault(FaultCode.NOT_HOMED, f"homing ended early: {fault.message}"),) if homing else ()

    def _admit(self, ticket: Ticket) -> StationContext:
        """Begin: ask once more what speaks against the job, go to `triggered`, and check the deadline again."""
        request = ticket.request
        refuse_in_fault(self._latch.against(request.op))
        refusal = self._with.refusal(ticket.client, request.op)
        if refusal is not None:
            raise refusal
        context = self._with.context()
        if context is None:
            raise Fault(FaultCode.IN_FAULT, "the station is not open")
        refuse_with_needle_down(request.op, context.station.needle)
        self._latch.begin(request.op, request.id)
        if Deadline(ticket.due_s).expired:
            raise Fault(FaultCode.STALE_DEADLINE, "the deadline passed while the job waited", id=request.id)
        return context

    async def _procedure(self, ticket: Ticket, job: JobContext, context: StationContext) -> Outcome:
        """Run the procedure as a task of its own, so that `cancel` reaches it and nothing else."""
        procedure = self._with.procedures[ticket.request.op]
        ticket.task = asyncio.create_task(self._timed(procedure, job, context))
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
    async def _timed(procedure: Procedure, job: JobContext, context: StationContext) -> Outcome:
        """Hold the procedure to its deadline; running out of time stops motion like a cancel does."""
        try:
            async with asyncio.timeout_at(asyncio.get_running_loop().time() + job.deadline.remaining_s):
                return await procedure(job, context)
        except TimeoutError as exc:
            if not job.deadline.expired:
                raise
            await context.station.stop()
            raise Fault(FaultCode.DEADLINE_MISSED) from exc

    def _ending(self, fault: Fault) -> Event:
        """Return the event that ends a job which met `fault` in the present state."""
        if fault.kind in (FaultCode.CANCELLED, FaultCode.DEADLINE_MISSED, FaultCode.LEASE_EXPIRED):
            return Event.CANCELLED
        if self._latch.state is State.TRIGGERED and not fault.kind.latched:
            return Event.REFUSED
        return Event.FAILED

    # --- telling ---------------------------------------------------------------------------------------------

    async def _finish(self, ticket: Ticket, job: JobContext, outcome: Outcome, fault: Fault | None) -> None:
        """Journal, publish, answer, then keep the pictures; in this order.

        A result that cannot be written is told to nobody: after a kill the next start could not but tell another.
        """
        timing = job.watch.timing_ms()
        folder = self._with.images.folder_for(ticket.request, failed=fault is not None)
        ended = EndedJob(ticket.request, job, outcome, fault, utc_now(), timing, folder)
        await self._settle(job)
        try:
            result = await self._write(ended)
        except Fault as disk:
            self._hold_back(ended, ticket, disk)
            return
        self._let_go(ticket)
        if not ticket.done.done():
            ticket.done.set_result(result)
        log.info("job_done", outcome=result.outcome, ok=result.ok, error=fault.message if fault else None)
        self._with.observer.on_result(job, result)
        if result.pictures and folder:
            await self._keep_pictures(folder, job, result)

    @staticmethod
    async def _settle(job: JobContext) -> None:
        """Wait for the job's looks and moves to be on disk; one that is not costs no result."""
        try:
            await job.settle()
        except Exception as exc:  # noqa: BLE001  # a note is not worth a result
            log.error("steps_not_kept", error=str(exc))

    async def _write(self, ended: EndedJob) -> JobResult:
        """Write a result down and publish it; raise `Fault` if it cannot be written."""
        written: list[JobResult] = []

        async def write(seq: int) -> dict[str, Any]:
            result = ended.result(self._with.station, seq)
            await self._journal.finish_job(result)
            written.append(result)
            return result.model_dump(mode="json")

        await self._with.publisher.publish_written("result", write)
        self._with.on_result(written[0])
        return written[0]

    def _hold_back(self, ended: EndedJob, ticket: Ticket, disk: Fault) -> None:
        """Keep a result until it can be written; those who wait for it are told to ask again."""
        ended.job.forget_looks()  # their pictures are 24 MB
        self._unwritten[ended.request.id] = ended
        self._latch.latch(disk)
        self._let_go(ticket)
        refuse(ticket.done, not_written(ended.request.id))
        log.error("result_not_written", error=disk.message)

    def _let_go(self, ticket: Ticket) -> None:
        """Be done with a job: what is kept of it from now on can be cancelled no more, and nobody is refused for it."""
        self._with.lock.goes_on_as("archive")
        self._intake.let_go(ticket)

    async def write_held_back(self) -> None:
        """Write and tell the results that could not be written before; raise `Fault` if that still fails."""
        for job_id, ended in list(self._unwritten.items()):
            result = await self._write(ended)
            del self._unwritten[job_id]
            log.info("result_written_late", id=job_id, outcome=result.outcome)
            self._with.observer.on_result(ended.job, result)

    async def _keep_pictures(self, folder: Path, job: JobContext, result: JobResult) -> None:
        """Keep the pictures; that they cannot be kept any more, or can again, is an alert."""
        try:
            await self._with.images.keep(folder, job, result)
        except Exception:  # what is kept of a job that was answered must not end the job loop
            log.exception("images_failed_internally", folder=str(folder))
            return
        # Told each time: an alert of a daemon before this one may stand, whose cause is gone.
        self._with.observer.on_flag("pictures_not_kept", self._with.images.full)

    def _keep_step(self, job_id: str) -> Callable[[StepKind, dict[str, Any]], Any]:
        def keep(kind: StepKind, body: dict[str, Any]) -> Any:
            self._with.observer.on_step(job_id, kind, body)
            return self._journal.add_step(job_id, kind, body)

        return keep

    def _tell_progress(self, request: AnyJob) -> Callable[[int, int, str], None]:
        def tell(done: int, total: int, doing: str) -> None:
            self._progress = {"done": done, "total": total, "doing": doing}
            self._with.publisher.publish("progress", {"job": request.id, "op": request.op, **self._progress})

        return tell

    def _tell_contact(self, change: str, contact: ContactFacts) -> None:
        """Publish that the needle stands, or stands no longer."""
        body = contact.model_dump(exclude={"id", "since"})
        self._with.publisher.publish("contact", {"change": change, "job": contact.id, **body})

    def _keep_point(self, ticket: Ticket, record: PointRecord, looks: PointLooks) -> KeptPoint:
        """Return the record with the folder of its pictures, and what writes them."""
        images, job_id = self._with.images, ticket.request.id
        folder = images.folder_for_point(job_id, record)
        if folder is None:
            return record, None
        kept = record.model_copy(update={"pictures": str(folder)})
        return kept, images.keep_point(folder, job_id, looks, kept)

    def _tell_point(self, ticket: Ticket, record: PointRecord) -> None:
        """Publish what came of a point."""
        self._with.observer.on_point(record)
        self._with.publisher.publish("point", {"job": ticket.request.id, **record.model_dump(mode="json")})

    def _end_contact(self, ticket: Ticket) -> None:
        """Have no touch held any more, whatever ended it; that the needle was lifted is told only where it was."""
        stood = ticket.touch.end() if ticket.touch is not None else None
        context = self._with.context()
        if stood is not None and context is not None and context.station.needle.is_up:
            self._tell_contact("lifted", stood)

    # --- steering --------------------------------------------------------------------------------------------

    @property
    def running(self) -> AnyJob | None:
        """The request under way."""
        ticket = self._intake.running
        return ticket.request if ticket else None

    @property
    def progress(self) -> dict[str, Any] | None:
        """How far the running job says it is, if it says so."""
        return self._progress

    @property
    def queued(self) -> int:
        """How many jobs wait."""
        return self._intake.queued

    def touch(self, job_id: str) -> HeldTouch | None:
        """Return the open touch of this id."""
        ticket = self._intake.open.get(job_id)
        return ticket.touch if ticket is not None else None

    def result_of(self, job_id: str) -> asyncio.Future[JobResult] | None:
        """Return where the result of an open job will be."""
        ticket = self._intake.open.get(job_id)
        return ticket.done if ticket is not None else None

    @property
    def contact(self) -> ContactFacts | None:
        """The touch by which the needle is held down; None from when it is to be lifted."""
        ticket = self._intake.running
        return ticket.touch.contact if ticket is not None and ticket.touch is not None else None

    def pause(self, job_id: str | None) -> str:
        """Have a run end after the point under test; return its id. Raise `Fault` where no such run is under way."""
        ticket = self._intake.running
        if (
            ticket is None
            or ticket.job is None
            or ticket.request.op != "run"
            or job_id not in (None, ticket.request.id)
        ):
            raise Fault(
                FaultCode.UNKNOWN_JOB, "no such run is under way" if job_id else "no run is under way", id=job_id
            )
        ticket.job.pausing = True
        return ticket.request.id

    def cancel(self, job_id: str | None) -> str:
        """Stop a job, or the running one; return its id."""
        ticket = self._intake.open.get(job_id) if job_id else self._intake.running
        if ticket is None:
            raise Fault(FaultCode.UNKNOWN_JOB, "no such job is open" if job_id else "no job runs", id=job_id)
        ticket.cancelled = True
        if ticket.task is not None:
            ticket.task.cancel()
        return ticket.request.id
