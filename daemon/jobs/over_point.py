"""Stand kept over a job: what a job that puts the head over a point, or looks for one, leaves of the stand."""

from __future__ import annotations

from collections.abc import Awaitable

from daemon.jobs.context import Outcome
from daemon.station.needle import Needle
from daemon.wire.operations.jobs import AnyJob, Look


async def keep_stand(request: AnyJob, key: str, needle: Needle, procedure: Awaitable[Outcome]) -> Outcome:
    """Run a job's procedure and remember over which point the client of this key put the head.

    One that fails leaves nothing of a stand of before: where the eye has just refused a point nobody touches it.
    """
    if request.ENDS_OVER_POINT is not None:
        needle.stand.forget()
    try:
        outcome = await procedure
    except BaseException:
        if isinstance(request, Look) and request.test_point is not None:
            needle.stand.refused(request.test_point)
        raise
    _note(request, key, needle, outcome)
    return outcome


def _note(request: AnyJob, key: str, needle: Needle, outcome: Outcome) -> None:
    point, how, position = outcome.test_point, request.ENDS_OVER_POINT, needle.position
    if point is not None and how is not None and position is not None:
        needle.stand.came(point, key, position, seen=how == "seen")
    if point is not None and outcome.beside_um is not None:
        needle.stand.beside(point, outcome.beside_um)
