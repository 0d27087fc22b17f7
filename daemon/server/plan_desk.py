"""Answers to `plan`, `points`, `point`, `mark` and `marks`: plans, records of runs and points, what people forbade."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import assert_never

from daemon.config.current import CurrentSettings
from daemon.config.plan_file import PlanError, read_plan
from daemon.domain.board import Board
from daemon.domain.board_run import BoardRun
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.plan import Plan, StoredPlan
from daemon.domain.plan_learning import learn
from daemon.domain.point_mark import PointMark
from daemon.domain.point_test import PointRecord
from daemon.domain.roles import ROLES, Caller
from daemon.jobs.image_archive import point_pictures_id
from daemon.platform.clock import utc_now
from daemon.storage.journal import Journal
from daemon.storage.plan_store import PlanStore, plans_folder
from daemon.wire.operations import runs
from daemon.wire.replies import Reply

UNNAMED = "plan"
MISTAKES_TOLD = 200
PAGE = 1000


class PlanDesk:
    """Answer what is asked of plans and of the points of runs."""

    def __init__(self, settings: CurrentSettings, journal: Journal) -> None:
        self._settings, self._journal = settings, journal
        self._store = PlanStore(plans_folder(settings.config.station.data_dir))
        self._turn = asyncio.Lock()
        """Held while a version is written: two that come at once are two versions."""

    async def answer(self, request: runs.AnyRunQuestion, caller: Caller) -> Reply:
        """Answer any of them; raise `Fault` for what cannot be."""
        match request:
            case runs.Points():
                return await self.points(request)
            case runs.PointTests():
                return await self.tests(request)
            case runs.MarkPoint():
                return await self._mark(request, caller)
            case runs.Marks():
                board = self._settings.board
                return runs.MarksReply(marks=await self._journal.marks.of_board(board.name, board.side))
            case runs.PlanRequest():
                return await self.plan(request, caller)
            case _:
                assert_never(request)

    async def plan(self, request: runs.PlanRequest, caller: Caller) -> runs.PlanReply:
        """Answer one `plan`; raise `Fault` for what cannot be."""
        if not request.only_asks and caller.role != ROLES[-1]:
            raise Fault(
                FaultCode.NOT_ALLOWED, f"to {request.action} a plan needs the role {ROLES[-1]}, this key has "
                f"{caller.role}", needs=ROLES[-1], role=caller.role,
            )  # fmt: skip
        by = request.by or caller.key or caller.client
        async with self._turn:
            try:
                return await self._answer(request, by)
            except OSError as exc:
                advice = "see that the data directory has room and that the daemon's user may write there"
                raise Fault(FaultCode.INVALID_PLAN, f"the plan cannot be kept: {exc}", advice=advice) from exc

    async def _answer(self, request: runs.PlanRequest, by: str) -> runs.PlanReply:
        name, version = request.name or "", request.version
        match request.action:
            case "list":
                return await self._list()
            case "show":
                return runs.PlanReply(plan=await asyncio.to_thread(self._store.get, name, version))
            case "check" | "store":
                plan = await asyncio.to_thread(_read, request, self._settings.board)
                if request.action == "check":
                    return runs.PlanReply(plan=_unstored(plan, by))
                return runs.PlanReply(plan=await asyncio.to_thread(self._store.store, plan, by))
            case "approve":
                return runs.PlanReply(plan=await asyncio.to_thread(self._store.approve, name, version, by))
            case "learn":
                return await self._learn(name, request.learn_from or (), by)
            case _:
                assert_never(request.action)

    async def _learn(self, name: str, run_ids: Sequence[str], by: str) -> runs.PlanReply:
        """Store a plan with limits of these runs, whose tests are those of the first one."""
        found: dict[str, tuple[BoardRun, list[PointRecord]]] = {}
        for run_id in run_ids:
            run = await self._run(run_id)
            run.plan.require_board(self._settings.board)
            found[run.id] = run, await self._records(run)
        base = next(iter(found.values()))[0].plan
        try:
            learned = learn(name, base, {run_id: records for run_id, (_, records) in found.items()})
        except ValueError as exc:
            raise Fault(
                FaultCode.INVALID_PLAN, f"nothing can be learned: {exc}", advice="name runs that passed"
            ) from exc
        stored = await asyncio.to_thread(self._store.store, learned.plan, by)
        return runs.PlanReply(plan=stored, left_out=dict(learned.left_out))

    async def _list(self) -> runs.PlanReply:
        stored, damaged = await asyncio.to_thread(self._store.newest)
        facts = [_facts(one, self._settings.board) for one in stored]
        return runs.PlanReply(plans=facts, damaged=[fault.message for fault in damaged])

    # --- points -----------------------------------------------------------------------------------------------

    async def points(self, request: runs.Points) -> runs.PointsReply:
        """Answer one page of a run's records."""
        run = await self._run(request.run)
        rows = await self._journal.points_of(run.id, request.since, request.limit)
        return runs.PointsReply(run=run, points=[_numbered(*row) for row in rows])

    async def tests(self, request: runs.PointTests) -> runs.PointTestsReply:
        """Answer one page of a point's tests; one that the board has not, or not any more, may have been tested."""
        rows = await self._journal.tests_of(request.test_point, request.board_id, request.before, request.limit + 1)
        tests = [_numbered(*row) for row in rows[: request.limit]]
        return runs.PointTestsReply(tests=tests, more=len(rows) > request.limit)

    async def _mark(self, request: runs.MarkPoint, caller: Caller) -> runs.MarkReply:
        board = self._settings.board
        board.point(request.test_point)
        by = request.by or caller.key or caller.client
        mark = PointMark(point=request.test_point, mark=request.mark, reason=request.reason, by=by, at=utc_now())
        await self._journal.marks.add(board.name, board.side, mark)
        return runs.MarkReply(mark=mark)

    async def _run(self, run_id: str) -> BoardRun:
        run = await self._journal.runs.find(run_id)
        if run is None:
            raise Fault(FaultCode.UNKNOWN_RUN, f"no run {run_id!r}"[:200], run=run_id)
        return run

    async def _records(self, run: BoardRun) -> list[PointRecord]:
        records: list[PointRecord] = []
        since = 0
        while rows := await self._journal.points_of(run.id, since, PAGE):
            records += [record for *_, record in rows]
            since = rows[-1][0] + 1
        return records


def _numbered(n: int, job: str, record: PointRecord) -> runs.NumberedRecord:
    kept = point_pictures_id(job, record.point) if record.pictures else None
    return runs.NumberedRecord(n=n, job=job, pictures_id=kept, **record.model_dump())


def _read(request: runs.PlanRequest, board: Board) -> Plan:
    """Read a plan's text; raise `Fault` with all mistakes."""
    try:
        return read_plan(request.text or "", request.form, board, request.name or UNNAMED)
    except PlanError as exc:
        count, first = len(exc.mistakes), exc.mistakes[0]
        more = f", and {count - 1} more mistake{'s' if count > 2 else ''}" if count > 1 else ""
        told = [{"line": mistake.line, "what": mistake.what} for mistake in exc.mistakes[:MISTAKES_TOLD]]
        raise Fault(FaultCode.INVALID_PLAN, f"{first}{more}", mistakes=told, count=count) from exc


def _unstored(plan: Plan, by: str) -> StoredPlan:
    return StoredPlan(version=0, plan=plan, hash=plan.hash, stored_at=utc_now(), stored_by=by)


def _facts(stored: StoredPlan, board: Board) -> runs.PlanFacts:
    plan = stored.plan
    return runs.PlanFacts(
        name=plan.name, version=stored.version, hash=stored.hash, board=plan.board,
        fits=(plan.board, plan.board_revision) == (board.name, board.revision), tests=len(plan.tests),
        learned=plan.learned, approved=stored.approved is not None, stored_at=stored.stored_at,
    )  # fmt: skip
