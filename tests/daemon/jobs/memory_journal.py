"""A journal in memory: for tests in which no disk may make anybody wait."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult, StepKind
from daemon.storage.journal import StoredJob


class MemoryJournal:
    """What job runner and supervisor ask of a journal."""

    def __init__(self) -> None:
        self.runs = None
        self.jobs: dict[str, StoredJob] = {}
        self.steps: list[tuple[str, str, dict[str, Any]]] = []
        self.things: dict[str, dict[str, Any]] = {}
        self.broken = False
        self.step_error: Exception | None = None
        self.before_result: Callable[[], Awaitable[None]] | None = None
        """Waited for before a result is written."""

    async def mark_of(self, _board: str, _side: str, _point: str) -> None:
        """Nobody said anything of any point."""

    async def reserve_seqs(self) -> None:
        return

    async def mend(self) -> Fault | None:
        return Fault(FaultCode.JOURNAL_FAILED, "the disk is full") if self.broken else None

    async def job(self, job_id: str) -> StoredJob | None:
        return self.jobs.get(job_id)

    async def add_job(self, job_id: str, _op: str, request: str) -> None:
        self._write()
        self.jobs[job_id] = StoredJob(request, None)

    async def add_step(self, job_id: str, kind: StepKind, body: dict[str, Any]) -> None:
        self._write()
        if self.step_error is not None:
            raise self.step_error
        self.steps.append((job_id, kind, body))

    async def finish_job(self, result: JobResult) -> None:
        if self.before_result is not None:
            await self.before_result()
        self._write()
        self.jobs[result.id] = StoredJob(self.jobs[result.id].request, result)

    async def keep(self, key: str, body: dict[str, Any]) -> None:
        self._write()
        self.things[key] = body

    async def kept(self, key: str) -> dict[str, Any] | None:
        return self.things.get(key)

    def _write(self) -> None:
        if self.broken:
            raise Fault(FaultCode.JOURNAL_FAILED, "the disk is full")
