"""Run: walk a plan over one board, point by point, unattended; gone on with where it was left.

Every point's record is on disk before the needle goes to the next one. So a kill costs no more than the point under
test, and whoever goes on touches none that has a verdict.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from importlib.metadata import version

from daemon.domain.board_run import BoardRun, RunBoard, RunPlace, RunSummary, summarise
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.plan import Plan, plan_of_points
from daemon.domain.point_test import PointRecord, PointTest, PointVerdict
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, RunBook, StationContext
from daemon.platform.clock import utc_now
from daemon.procedures.meter_readings import MeterReadings
from daemon.procedures.probe_point import admit_probing, probe_point
from daemon.procedures.reference_pad import check_needle
from daemon.procedures.run_order import order_of, places_of
from daemon.procedures.tare import tare_of
from daemon.station.device_errors import as_fault
from daemon.station.kinematics import EXTRAPOLATED_UM
from daemon.station.needle_health import NeedleHealth
from daemon.storage.plan_store import PlanStore, plans_folder
from daemon.wire.operations.jobs import Run, StopRules
from drivers.gantry import Position

PAUSED = "paused by a person"
AGAINST_THE_BOARD = frozenset({PointVerdict.FAIL, PointVerdict.OPEN_CONFIRMED})


async def run(job: JobContext, context: StationContext, request: Run) -> Outcome:
    """Test what is left of the plan on this board; a `Fault` says why it went no further, and leaves it unfinished."""
    book = job.touching.runs
    if book is None:
        raise TypeError("a run needs a journal that keeps runs")
    unfinished = await book.unfinished(request.board_id)
    goes_on = await _which(book, request, unfinished)
    plan, plan_version = (goes_on.plan, goes_on.plan_version) if goes_on else await _plan(context, request)
    plan.require_board(context.board)
    _refuse_insert(plan)
    context.station.needle.stand.forget()
    await admit_probing(job, context, request.board_id, tester=False)
    if goes_on is not None:
        the_run = goes_on
        await book.go_on(the_run, job.request.id)
    else:
        the_run = await _begun(job, context, request, plan, plan_version)
        if unfinished is not None:
            await book.tell(unfinished.id, "abandoned", None, f"abandoned for run {the_run.id}")
        await book.begin(the_run)
    job.fire(Event.ACCEPTED)
    return await _Walk(job, context, the_run, book, request.stop, await book.records_of(the_run.id)).go()


# --- before the first touch ------------------------------------------------------------------------------------


async def _which(book: RunBook, request: Run, unfinished: BoardRun | None) -> BoardRun | None:
    """Return the run to go on with, None to begin another; raise `Fault` where the request does not say which."""
    if request.resume:
        if unfinished is None:
            raise Fault(
                FaultCode.UNKNOWN_RUN, f"board {request.board_id} has no unfinished run to go on with",
                advice="begin one: send it without `resume`",
            )  # fmt: skip
        if request.points is not None or request.plan not in (None, unfinished.plan.name):
            asked = f"plan {request.plan}" if request.plan else "a list of points"
            raise await _refusal(book, unfinished, f", by plan {unfinished.plan.name} and not by {asked}")
        if request.version not in (None, unfinished.plan_version):
            raise await _refusal(book, unfinished, f", by version {unfinished.plan_version} of its plan")
        return unfinished
    if unfinished is not None and not request.abandon:
        raise await _refusal(book, unfinished, "")
    return None


async def _refusal(book: RunBook, unfinished: BoardRun, more: str) -> Fault:
    done, points = len(await book.records_of(unfinished.id)), len(unfinished.plan.tests)
    board = unfinished.board_id
    return Fault(
        FaultCode.RUN_UNFINISHED,
        f"run {unfinished.id} of board {board} is unfinished: {done} of {points} points have a verdict{more}",
        advice=f"go on with it: `reprobe run --resume --board-id {board}` (`resume`); or start over with `abandon`",
        run=unfinished.id,
        done=done,
        points=points,
        plan=unfinished.plan.name,
    )


async def _plan(context: StationContext, request: Run) -> tuple[Plan, int | None]:
    """Return the plan that was asked for, with its version; None for a list of points."""
    if request.points is not None:
        doubled = {name for name in request.points if request.points.count(name) > 1}
        if doubled:
            raise Fault(FaultCode.INVALID_REQUEST, f"points named twice: {', '.join(sorted(doubled))}"[:200], fields=[])
        return plan_of_points(context.board, request.points), None
    store = PlanStore(plans_folder(context.config.station.data_dir))
    stored = await asyncio.to_thread(store.get, request.plan or "", request.version)
    stored.require_approved()
    return stored.plan, stored.version


def _refuse_insert(plan: Plan) -> None:
    held = [test.point for test in plan.tests if test.method == "insert"]
    if held:
        raise Fault(
            FaultCode.INVALID_PLAN, f"{', '.join(held[:5])}: method insert waits for the tester, and a run for nobody",
            advice='test these points one by one, by the wire: a probe with "measure": "tester"',
        )  # fmt: skip


async def _begun(
    job: JobContext, context: StationContext, request: Run, plan: Plan, plan_version: int | None
) -> BoardRun:
    """Return a new run: where each point is tested, and in which order."""
    here = await context.station.position(job)

    def way() -> tuple[tuple[RunPlace, ...], tuple[int, ...]]:
        places = places_of(context, plan, here)
        _refuse_unmeasured(context, [at for _, at in places if at is not here])
        order = order_of(context, (at for _, at in places), here, short=request.order == "short")
        return tuple(place for place, _ in places), tuple(order)

    places, order = await asyncio.to_thread(way)
    facts = ("name", "side", "revision", "width_um", "height_um")
    board = RunBoard.model_validate({name: getattr(context.board, name) for name in facts})
    return BoardRun(
        id=request.id, board_id=request.board_id, plan=plan, plan_version=plan_version, plan_hash=plan.hash,
        board=board, order=order, places=places, station=context.config.station.name, software=version("reprobe"),
        calibrated=context.calibrations.in_force.made_at(), begun_at=utc_now(), jobs=(request.id,),
    )  # fmt: skip


def _refuse_unmeasured(context: StationContext, over: list[Position]) -> None:
    """Raise `Fault` where a surface was measured, and near none of these places: no point could be touched."""
    geometry = context.geometry
    if context.calibrations.surface is None or not over:
        return
    if all(geometry.measured_um(geometry.tip_um(at)) is None for at in over):
        raise Fault(
            FaultCode.SURFACE_UNKNOWN,
            f"this board's surface was measured farther than {EXTRAPOLATED_UM / 1e3:g} mm from every point of the run",
            advice="`calibrate surface` with more places, so that some lie near these points",
        )


# --- the walk --------------------------------------------------------------------------------------------------


@dataclass
class _Walk:
    """A run under way in one job."""

    job: JobContext
    context: StationContext
    run: BoardRun
    book: RunBook
    stop: StopRules
    records: list[PointRecord]
    health: NeedleHealth = field(default_factory=NeedleHealth)
    earlier: int = field(init=False)
    """Records of jobs before this one: whoever goes on has seen why they stopped."""

    def __post_init__(self) -> None:
        """Count what was there."""
        self.earlier = len(self.records)

    async def go(self) -> Outcome:
        """Test what is left, and tell how the run stands, whatever ends the job."""
        try:
            stopped_by = await self._test_what_is_left()
            await self._ask_reference()
        except BaseException as exc:
            why = (
                as_fault(exc).message if isinstance(exc, Exception) else "the job was cancelled, or the daemon stopped"
            )
            self.job.partial.detail = self._told("unfinished", why)
            self.job.later(self.book.tell(self.run.id, "unfinished", self._summary(), why))
            raise
        state = "unfinished" if stopped_by else "done"
        await self.book.tell(self.run.id, "unfinished" if stopped_by else "done", self._summary(), stopped_by)
        return Outcome("run_stopped" if stopped_by else "run_done", detail=self._told(state, stopped_by))

    async def _test_what_is_left(self) -> str:
        """Return why the run was stopped by its own rules; nothing when every test has a verdict."""
        job, total = self.job, len(self.run.plan.tests)
        left = self.run.tests_left(self.records)
        if left:
            job.progress(len(self.records), total, "the reference pad")
            await self._ask_reference()
        for test, place in left:
            if job.pausing:
                return PAUSED
            if tare_of(self.context, self.health) is None:  # it has aged
                await self._ask_reference()
            job.progress(len(self.records), total, test.point)
            self.records.append(await self._test(test, place))
            await job.settle()  # looks and moves of this point: whatever cannot be written stops the run
            if stopped_by := self._stopped_by():
                return stopped_by
        job.progress(total, total, "done")
        return ""

    async def _test(self, test: PointTest, place: RunPlace) -> PointRecord:
        """Test one point within the time that a job of its own would have."""
        within_s = self.context.servo.job_timeout_s
        run_id, board_id, at_deg = self.run.id, self.run.board_id, place.theta_deg
        try:
            async with asyncio.timeout(within_s) as clock:
                return await probe_point(
                    self.job, self.context, test, board_id, run=run_id, plan_hash=self.run.plan_hash,
                    health=self.health, at_deg=at_deg, done={record.point: record.verdict for record in self.records},
                )  # fmt: skip
        except TimeoutError as exc:
            if not clock.expired():
                raise
            await self.context.station.stop()
            raise Fault(
                FaultCode.DEADLINE_MISSED, f"{test.point} took longer than {within_s:g} s (servo.job_timeout_s)"
            ) from exc

    async def _ask_reference(self) -> None:
        """Touch the reference pad, where there is one: whether the needle is good, and what leads add to readings."""
        if self.context.config.reference is not None and self.context.station.meter is not None:
            await check_needle(self.job, self.context, MeterReadings(self.job, self.context), self.health)

    def _stopped_by(self) -> str:
        """Return which rule stops the run now."""
        verdicts = [record.verdict for record in self.records[self.earlier :]]
        most = self.stop.contact_not_made
        if most is not None and verdicts[-most:] == [PointVerdict.CONTACT_NOT_MADE] * most:
            return f"{most} points one after the other without contact (stop.contact_not_made)"
        failed = sum(verdict in AGAINST_THE_BOARD for verdict in verdicts)
        if self.stop.failed is not None and failed >= self.stop.failed:
            return f"{failed} points failed or are open (stop.failed)"
        return ""

    def _summary(self) -> RunSummary:
        before = self.run.summary
        told = summarise(len(self.run.plan.tests), self.records)
        first = (
            before.reference_first_ohm if before and before.reference_first_ohm is not None else self.health.first_ohm
        )
        last = self.health.last_ohm if self.health.last_ohm is not None else before and before.reference_last_ohm
        return told.model_copy(update={"reference_first_ohm": first, "reference_last_ohm": last})

    def _told(self, state: str, stopped_by: str) -> dict[str, object]:
        """Return what the result says of the run."""
        told: dict[str, object] = {"run": self.run.id, "board_id": self.run.board_id, "plan": self.run.plan.name,
                "plan_hash": self.run.plan_hash, "state": state, "summary": self._summary().model_dump()}  # fmt: skip
        return told | ({"stopped_by": stopped_by} if stopped_by else {})
