"""Probe: one point tested to its verdict, from wherever the head is."""

from __future__ import annotations

from daemon.domain.board import BoardPoint
from daemon.domain.point_test import PointTest
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.procedures.press_readers import TesterHold
from daemon.procedures.probe_point import admit_probing, probe_point
from daemon.wire.operations.jobs import Probe


async def probe(job: JobContext, context: StationContext, request: Probe) -> Outcome:
    """Test the point, or the best one of the net; a `Fault` says what kept it from any verdict."""
    point = _point_of(request, context)
    job.partial.test_point = point.name
    hold = TesterHold(request.hold_ms, request.lease_ms) if request.measure == "tester" else None
    context.station.needle.stand.forget()
    await admit_probing(job, context, request.board_id, tester=hold is not None)
    job.fire(Event.ACCEPTED)
    test = PointTest(
        point=point.name, net=request.net, method=request.method, limits=request.limits, theta_deg=request.theta_deg,
        look=request.look, touches=request.touches,
    )  # fmt: skip
    record = await probe_point(job, context, test, request.board_id, hold=hold)
    return Outcome(
        record.verdict.value,
        test_point=point.name,
        error_before_um=record.error_um,
        detail={"record": record.model_dump(mode="json"), **job.touching.held.last_said()},
    )


def _point_of(request: Probe, context: StationContext) -> BoardPoint:
    if request.test_point is not None:
        return context.board.point(request.test_point)
    return context.board.of_net(str(request.net))[0]
