"""A journal in memory: for tests in which no disk may make anybody wait."""

from __future__ import annotations

from typing import Any

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult
from daemon.storage.journal import StoredJob


class MemoryJournal:
    """What job runner and supervisor ask of a journal."""

    def __init__(self) -> None:
        self.jobs: dict[str, StoredJob] = {}
        self.steps: list[tuple[str, str, dict[str, Any]]] = []
        self.things: dict[str, dict[str, Any]] = {}
        self.broken = False
        self._seq = 0

    async def reserve_seqs(self) -> None:
        self._write()

    def take_seq(self) -> int:
        self._seq += 1
        return self._seq

    async def job(self, job_id: str) -> StoredJob | None:
        return self.jobs.get(job_id)

    async def add_job(self, job_id: str, _op: str, request: str) -> None:
        self._write()
        self.jobs[job_id] = StoredJob(request, None)

    async def add_step(self, job_id: str, kind: str, body: dict[str, Any]) -> None:
        self._write()
        self.steps.append((job_id, kind, body))

    async def finish_job(self, result: JobResult) -> None:
        self._write()
        self.jobs[result.id] = StoredJob(self.jobs[result.id].request, result)

    async def keep(self, key: str, body: dict[str, Any]) -> None:
        self._write()
        self.things[key] = body

    async def try_room(self) -> None:
        self._write()

    async def kept(self, key: str) -> dict[str, Any] | None:
        return self.things.get(key)

    def _write(self) -> None:
        if self.broken:
            raise Fault(FaultCode.JOURNAL_FAILED, "the disk is full")
