"""Operations on the queue and the machine: cancel, reset, and what is asked of state and results."""

from __future__ import annotations

from typing import Any, Final, Literal

from pydantic import Field

from daemon.domain.results import ErrorBody, JobResult, Told
from daemon.wire.example_parts import AT, RESULT
from daemon.wire.limits import MAX_SEQ
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.replies import Reply
from daemon.wire.requests import ImmediateRequest, JobId, Request, Whole


class Cancel(Request):
    """Stop a job safely; without an id, the one that runs."""

    op: Literal["cancel"]
    id: JobId | None = None


class Reset(Request):
    """Clear a latched fault once its cause is gone."""

    op: Literal["reset"]


class Status(ImmediateRequest):
    """Ask for state, fault and queue."""

    op: Literal["status"]


class Snapshot(Request):
    """Ask for all a late joiner needs: status, last result, the next event's seq."""

    op: Literal["snapshot"]


class Result(Request):
    """Ask for the result of one job."""

    op: Literal["result"]
    id: JobId


class Results(Request):
    """Replay results from a seq on."""

    op: Literal["results"]
    since: Whole = Field(default=0, ge=0, le=MAX_SEQ, description="first seq wanted")
    limit: Whole = Field(default=100, ge=1, le=1000)


class Running(Told):
    """The job under way."""

    id: str
    op: str
    progress: dict[str, Any] | None = Field(description="done, total, doing; null if the job does not tell")


class CalibrationState(Told):
    """What is calibrated."""

    tip: bool = Field(description="the probe's tip was taught")
    map_made_at: str | None = Field(description="UTC, ISO 8601")
    made_at: dict[str, str] = Field(description="kind -> when it was made, UTC, ISO 8601")
    aligned: bool = Field(description="this board's pose was measured")
    not_used: dict[str, str] = Field(description="kind -> why its file is not used")


class NeedleState(Told):
    """Where the needle is, as far as the drives have told."""

    place: str = Field(description="up, down (below the height of looks) or unknown")
    z_um: float | None = Field(description="height that Z last reported; null while the place is unknown")


class StatusReply(Reply):
    """What the daemon is doing."""

    station: str
    state: str = Field(description="idle, triggered, look, move, verify or fault")
    lifecycle: str = Field(description="opening (the devices are opened for the first time), ready or closing")
    fault: ErrorBody | None = Field(description="the first cause, while in fault")
    running: Running | None
    queued: int = Field(description="jobs that wait")
    calibration: CalibrationState
    pictures: str = Field(description="kept, or why they are not")
    needle: NeedleState


class Links(Told):
    """Lines and camera, counted since they were opened; empty while the station is not open."""

    buses: dict[str, dict[str, int]] = Field(description="line -> its counts, and whether it is connected")
    camera: dict[str, int]


class SnapshotReply(StatusReply):
    """All a late joiner needs."""

    next_seq: int = Field(description="the number the next event will carry")
    last_result: JobResult | None
    touches: int = Field(description="reported so far, and made by the daemon itself")
    links: Links


class CancelReply(Reply):
    """The job stops."""

    cancelled: str = Field(description="id of the job")


class ResultReply(Reply):
    """What is known of one job."""

    id: str
    done: bool
    result: JobResult | None


class ResultsReply(Reply):
    """Results in the order of their seq."""

    results: list[JobResult]


AnyControl = Cancel | Reset | Status | Snapshot | Result | Results
"""Every request of this module, for the type checker; in the order of the rows."""

_STATUS: Final[dict[str, Any]] = {
    "station": "station-1", "state": "idle", "lifecycle": "ready", "fault": None, "running": None, "queued": 0,
    "pictures": "kept", "needle": NeedleState(place="up", z_um=5200.0).model_dump(),
    "calibration": {"tip": True, "map_made_at": AT, "made_at": {"map": AT}, "aligned": True, "not_used": {}},
}  # fmt: skip
ROWS: Final = (
    Operation(
        request=Cancel,
        reply=CancelReply,
        least_role="operate",
        deadline=DefaultDeadline.SHORT,
        example={"id": "board17-TP7-1"},
        example_reply={"id": "board17-TP7-1", "cancelled": "board17-TP7-1"},
    ),
    Operation(
        request=Reset,
        reply=StatusReply,
        least_role="maintain",
        deadline=DefaultDeadline.SHORT,
        example_reply=_STATUS,
    ),
    Operation(
        request=Status,
        reply=StatusReply,
        least_role="observe",
        deadline=DefaultDeadline.NONE,
        example_reply=_STATUS,
    ),
    Operation(
        request=Snapshot,
        reply=SnapshotReply,
        least_role="observe",
        deadline=DefaultDeadline.NONE,
        example_reply=_STATUS
        | {
            "next_seq": 4712,
            "last_result": RESULT,
            "touches": 48213,
            "links": {"buses": {"main": {"connected": 1, "reconnects": 0}}, "camera": {"frames": 120}},
        },
    ),
    Operation(
        request=Result,
        reply=ResultReply,
        least_role="observe",
        deadline=DefaultDeadline.SHORT,
        example={"id": "board17-TP7-1"},
        example_reply={"id": "board17-TP7-1", "done": True, "result": RESULT},
    ),
    Operation(
        request=Results,
        reply=ResultsReply,
        least_role="observe",
        deadline=DefaultDeadline.SHORT,
        example={"since": 4700, "limit": 100},
        example_reply={"results": [RESULT]},
    ),
)
"""One row per operation, in the order of the page."""
