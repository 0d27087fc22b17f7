"""A job that has ended, and its result in words."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from daemon.domain.errors import Fault
from daemon.domain.results import ErrorBody, JobResult
from daemon.jobs.context import JobContext, Outcome
from daemon.wire.operations.jobs import AnyJob


@dataclass(frozen=True)
class EndedJob:
    """A job that has ended, and how: all that its result tells."""

    request: AnyJob
    job: JobContext
    outcome: Outcome
    fault: Fault | None
    finished_at: str
    timing_ms: dict[str, dict[str, float]]
    folder: Path | None

    def result(self, station: str, seq: int) -> JobResult:
        """Put the result into words, under the number of the event that carries it."""
        job, outcome, fault = self.job, self.outcome, self.fault
        what = getattr(self.request, "what", None)  # of an operation of several kinds; a failed one says nothing itself
        return JobResult(
            id=self.request.id,
            op=self.request.op,
            ok=fault is None,
            seq=seq,
            station=station,
            finished_at=self.finished_at,
            outcome=outcome.outcome if fault is None else "failed",
            test_point=outcome.test_point,
            error_before_um=outcome.error_before_um,
            error_after_um=outcome.error_after_um,
            looks=job.looks,
            moves=job.moves,
            timing_ms=self.timing_ms,
            pictures=str(self.folder) if self.folder and job.looks else None,
            detail={**({} if what is None else {"what": what}), **outcome.detail},
            error=ErrorBody.of(fault) if fault else None,
        )
