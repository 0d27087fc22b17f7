"""Preconditions of a job, checked before it is queued; each raises the `Fault` it is refused with."""

from __future__ import annotations

import json

from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody
from daemon.station.needle import Needle
from daemon.wire.operations.jobs import AnyJob


def refuse_in_fault(latched: Fault | None) -> None:
    """Refuse work that a latched fault speaks against, and name its first cause."""
    if latched is None:
        return
    raise Fault(
        FaultCode.IN_FAULT,
        f"the daemon is in fault: {latched.message}",
        advice=latched.advice,
        first_cause=ErrorBody.of(latched).model_dump(),
    )


def refuse_with_needle_down(op: str, needle: Needle) -> None:
    """Refuse all but what raises the needle while it is not known to be up."""
    if op not in FaultCode.NEEDLE_DOWN.cured_by and not needle.is_up:
        raise needle.fault("nothing begins before it was raised")


def refuse_unknown_point(request: AnyJob, board: Board) -> None:
    """Refuse a test point or fiducial that the board has not; what is corrected or touched must be the probe's."""
    name = getattr(request, "test_point", None)
    if name is not None:
        (board.point if request.FOR_NEEDLE else board.find)(name)
    net = getattr(request, "net", None)
    if net is not None and not board.of_net(net):
        why = board.unserved.get(net)
        known = f"cannot be probed: {why}" if why else "is not among those that can be probed"
        raise Fault(FaultCode.UNKNOWN_TEST_POINT, f"net {net} {known}"[:300], net=net)
    for fiducial in getattr(request, "fiducials", None) or ():
        board.find(fiducial)


def refuse_other_request(job_id: str, asked: str, known: str) -> None:
    """Refuse an id that stood for another request; both in their canonical form."""
    if asked != known and _given(asked) != _given(known):
        raise Fault(FaultCode.ID_REUSED, f"id {job_id!r} was used for a different request", id=job_id)


def _given(canonical: str) -> dict[str, object]:
    """Return the fields that say something: a request of an older version lacks those that were added since."""
    return {field: value for field, value in json.loads(canonical).items() if value is not None}
