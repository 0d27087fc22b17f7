"""Operations on the queue and the machine: cancel, hold, reset, and what is asked of state and results."""

from __future__ import annotations

from typing import Any, Final, Literal

from pydantic import Field

from daemon.domain.contact import ContactFacts
from daemon.domain.results import ErrorBody, JobResult, Told
from daemon.wire.example_parts import AT, CONTACT, RESULT
from daemon.wire.limits import MAX_SEQ
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.replies import Reply
from daemon.wire.requests import ImmediateRequest, JobId, LeaseMs, Request, Whole


class Cancel(Request):
    """Stop a job safely; without an id, the one that runs."""

    op: Literal["cancel"]
    id: JobId | None = None


class Pause(Request):
    """Have a run end after the point under test, which gets its verdict; `run` with `resume` goes on with it.

    Without an id, the run that is under way.
    """

    op: Literal["pause"]
    id: JobId | None = None


class Hold(ImmediateRequest):
    """Renew the lease of a touch: the needle stays down. With keys, only the client that touched may."""

    op: Literal["hold"]
    id: JobId
    lease_ms: LeaseMs = Field(default=2000.0, description="from now on")


class Reset(Request):
    """Clear a latched fault once its cause is gone."""

    op: Literal["reset"]


class LightUp(Request):
    """Have a lamp on for a while, to see something in the live picture.

    Refused (busy) while anything works at the station. It goes dark when the lease ends, a job begins, or in fault.
    """

    op: Literal["light"]
    colour: Literal["white", "red", "off"]
    lease_ms: LeaseMs = Field(default=10_000.0, description="from now on; sent again before its end, it stays on")


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
    z_um: float | None = Field(description="height that Z last reported; null where it is unknown, and in a move")


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
    configuration_refused: list[str] = Field(
        default=[], description="what is wrong with the file since the last reload; the one before it is in force"
    )


class Links(Told):
    """Lines and camera, counted since they were opened; empty while the station is not open."""

    buses: dict[str, dict[str, int]] = Field(description="line -> its counts, and whether it is connected")
    camera: dict[str, int]


class RunFacts(Told):
    """The newest run over a board, in short; `points` tells it whole."""

    id: str
    board_id: str
    plan: str
    plan_version: int | None = Field(description="null where points were named instead of a plan")
    state: str = Field(description="unfinished, done or abandoned")
    begun_at: str = Field(description="UTC, ISO 8601")
    ended_at: str | None
    stopped_by: str = Field(description="why the last job left it unfinished")
    points: int = Field(description="of the plan")
    done: int = Field(description="with a record")


class SnapshotReply(StatusReply):
    """All a late joiner needs."""

    next_seq: int = Field(description="the number the next event will carry")
    journal: str = Field(default="", description="id of the journal that is written now, see `records`")
    last_result: JobResult | None
    contact: ContactFacts | None = Field(description="the touch by which the needle is held down; null while none is")
    touches: int = Field(description="reported so far, and made by the daemon itself")
    links: Links
    board_revision: str = Field(default="", description="fingerprint of the board file: another one, ask `describe`")
    run: RunFacts | None = Field(default=None, description="the newest; null where there was none")


class CancelReply(Reply):
    """The job stops."""

    cancelled: str = Field(description="id of the job")


class PauseReply(Reply):
    """The run ends after this point."""

    paused: str = Field(description="id of the job")


class HoldReply(Reply):
    """The needle stands and stays."""

    until_ms: float = Field(description="from now on; lifted then, unless it is held again")
    contact: ContactFacts


class LightUpReply(Reply):
    """It is so."""

    colour: str
    until_ms: float = Field(description="from now on")


class ResultReply(Reply):
    """What is known of one job."""

    id: str
    done: bool
    result: JobResult | None


class ResultsReply(Reply):
    """Results in the order of their seq."""

    results: list[JobResult]


AnyControl = Cancel | Pause | Hold | Reset | LightUp | Status | Snapshot | Result | Results
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
        request=Pause,
        reply=PauseReply,
        least_role="operate",
        deadline=DefaultDeadline.SHORT,
        example={"id": "board17-run-1"},
        example_reply={"id": "board17-run-1", "paused": "board17-run-1"},
    ),
    Operation(
        request=Hold,
        reply=HoldReply,
        least_role="operate",
        deadline=DefaultDeadline.NONE,
        example={"id": "board17-TP7-2", "lease_ms": 2000},
        example_reply={"id": "board17-TP7-2", "until_ms": 2000.0, "contact": CONTACT},
    ),
    Operation(
        request=Reset,
        reply=StatusReply,
        least_role="maintain",
        deadline=DefaultDeadline.SHORT,
        example_reply=_STATUS,
    ),
    Operation(
        request=LightUp,
        reply=LightUpReply,
        least_role="operate",
        deadline=DefaultDeadline.SHORT,
        example={"colour": "white", "lease_ms": 10_000},
        example_reply={"colour": "white", "until_ms": 10_000.0},
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
            "contact": None,
            "touches": 48213,
            "links": {"buses": {"main": {"connected": 1, "reconnects": 0}}, "camera": {"frames": 120}},
            "board_revision": "9c2f1b7e44d0a853",
            "run": {
                "id": "board17-run-1",
                "board_id": "board17",
                "plan": "power",
                "plan_version": 3,
                "state": "done",
                "begun_at": AT,
                "ended_at": AT,
                "stopped_by": "",
                "points": 26,
                "done": 26,
            },
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
