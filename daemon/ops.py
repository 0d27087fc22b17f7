"""What each operation of the control socket answers."""

from __future__ import annotations

import asyncio
from typing import Any, Protocol

from daemon.board import Board
from daemon.calibrations import Calibrations
from daemon.clock import due_at_s
from daemon.config import Config
from daemon.faults import Fault, Kind
from daemon.jobs import Jobs
from daemon.journal import Journal
from daemon.messages import (
    OPS,
    Align,
    AnyJob,
    AnyRequest,
    Calibrate,
    Cancel,
    Correct,
    Describe,
    ErrorBody,
    Home,
    Look,
    Place,
    Report,
    Reset,
    Result,
    Results,
    Snapshot,
    Status,
)
from daemon.pictures import Pictures
from daemon.states import BUSY, Machine


class Served(Protocol):
    """What of the running daemon the operations ask."""

    config: Config
    machine: Machine
    jobs: Jobs
    board: Board
    calibrations: Calibrations
    pictures: Pictures

    async def reset(self) -> Fault | None:
        """Try to leave a fault; return what still speaks against it."""


class Ops:
    """Answer requests for one daemon."""

    def __init__(self, service: Served, journal: Journal) -> None:
        self._service = service
        self._journal = journal

    async def handle(self, request: AnyRequest) -> dict[str, Any]:
        """Return the reply's fields, or raise `Fault`."""
        match request:
            case Correct() | Place() | Look() | Align() | Calibrate() | Home():
                return await self._job(request)
            case Status():
                return self._status()
            case Snapshot():
                last = await self._journal.last_result()
                return self._status() | {
                    "next_seq": self._journal.upcoming_seq,
                    "last_result": last.model_dump(mode="json") if last else None,
                    "touches": await self._journal.touches(),
                }
            case Describe():
                return self._describe()
            case _:
                due_at_s(request.deadline_ms, 1.0)
                return await self._other(request)

    async def _job(self, request: AnyJob) -> dict[str, Any]:
        done = await self._service.jobs.submit(request)
        if not request.wait and not done.done():
            return {"id": request.id, "accepted": True}
        # Shielded: the future belongs to the job, and other clients may wait for the same one.
        result = await asyncio.shield(done)
        return {"id": request.id, "accepted": True, "result": result.model_dump(mode="json")}

    async def _other(self, request: AnyRequest) -> dict[str, Any]:
        match request:
            case Cancel():
                return {"cancelled": self._service.jobs.cancel(request.id)}
            case Reset():
                return await self._reset()
            case Result():
                return await self._result(request.id)
            case Results():
                found = await self._journal.results(request.since, request.limit)
                return {"results": [r.model_dump(mode="json") for r in found]}
            case Report():
                return await self._report(request)
            case _:
                raise Fault(Kind.UNKNOWN_OP)

    def _status(self) -> dict[str, Any]:
        service = self._service
        jobs, calibrations = service.jobs, service.calibrations
        running = jobs.running
        return {
            "station": service.config.station.name,
            "state": service.machine.state.value,
            "fault": ErrorBody.of(jobs.fault).model_dump(mode="json") if jobs.fault else None,
            "running": {"id": running.id, "op": running.op, "progress": jobs.progress} if running else None,
            "queued": jobs.queued,
            "calibration": {
                "tip": calibrations.probe is not None,
                "map_made_at": calibrations.mapped_at,
                "made_at": calibrations.made_at(),
                "aligned": calibrations.alignment(service.board) is not None,
                "not_used": calibrations.problems,
            },
            "pictures": service.pictures.full or "kept",
        }

    def _describe(self) -> dict[str, Any]:
        service = self._service
        board = service.board
        return {
            "station": service.config.station.name,
            "ops": list(OPS),
            "events": service.config.api.events,
            "board": {
                "name": board.name,
                "side": board.side,
                "width_um": board.width_um,
                "height_um": board.height_um,
                "test_points": [p.model_dump(mode="json", exclude={"why_not"}) for p in board.test_points()],
                "not_probeable": {p.name: p.why_not for p in board.points if p.why_not} | board.hidden,
            },
            "errors": [
                {"code": k.code, "name": k.wire_name, "cause": k.value.cause, "advice": k.value.advice} for k in Kind
            ],
        }

    async def _reset(self) -> dict[str, Any]:
        if self._service.machine.state in BUSY:
            raise Fault(Kind.BUSY, "a job runs; cancel it first")
        fault = await self._service.reset()
        if fault is not None:
            raise fault
        return self._status()

    async def _result(self, job_id: str) -> dict[str, Any]:
        stored = await self._journal.job(job_id)
        if stored is None:
            raise Fault(Kind.UNKNOWN_JOB, f"no job {job_id!r}"[:200], id=job_id)
        return {
            "id": job_id,
            "done": stored.result is not None,
            "result": stored.result.model_dump(mode="json") if stored.result else None,
        }

    async def _report(self, request: Report) -> dict[str, Any]:
        if request.id is not None and await self._journal.job(request.id) is None:
            raise Fault(Kind.UNKNOWN_JOB, f"no job {request.id!r}"[:200], id=request.id)
        await self._journal.add_report(request.id, request.retest, request.touches)
        return {"touches": await self._journal.touches()}
