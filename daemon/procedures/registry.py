"""Table of procedures: the body of each kind of job, by operation."""

from __future__ import annotations

from collections.abc import Mapping

from daemon.jobs.context import JobContext, Outcome, Procedure, ProcedureFor, RequestT, StationContext
from daemon.procedures.align import align
from daemon.procedures.basic import home, look, place
from daemon.procedures.calibrate.dispatch import calibrate
from daemon.procedures.correct import correct
from daemon.wire.requests import Align, Calibrate, Correct, Home, Look, Place


def procedure(kind: type[RequestT], body: ProcedureFor[RequestT]) -> Procedure:
    """Return `body` as a procedure of any job, which hands it the job's request; TypeError for another kind of request.

    The types of `kind` and `body` have to agree, which the type checker sees to.
    """

    async def run(job: JobContext, context: StationContext) -> Outcome:
        if not isinstance(job.request, kind):
            raise TypeError(f"a request {job.request.op!r} is not for the procedure of {kind.__name__}")
        return await body(job, context, job.request)

    return run


PROCEDURES: Mapping[str, Procedure] = {
    "correct": procedure(Correct, correct),
    "place": procedure(Place, place),
    "look": procedure(Look, look),
    "align": procedure(Align, align),
    "calibrate": procedure(Calibrate, calibrate),
    "home": procedure(Home, home),
}
