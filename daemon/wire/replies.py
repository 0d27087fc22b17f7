"""What the control socket answers, as models: a reply to each operation, and the refusal.

Operations build these and nothing else, so that the documented wire and the spoken one are the same. Fields may be
added; none changes its meaning or goes away within a version.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from daemon.domain.results import ErrorBody, JobResult, Told
from daemon.domain.roles import Role
from daemon.wire.events import AlertFacts
from daemon.wire.requests import WIRE_VERSION


class AnyReply(BaseModel):
    """What every reply carries, good or bad."""

    # Not frozen: the socket fills in `id` and `version` on its way out.
    model_config = ConfigDict(extra="ignore")
    ABSENT: ClassVar[frozenset[str]] = frozenset({"id"})
    """Fields that are left out where they are None."""

    v: Literal[1] = WIRE_VERSION
    id: str | None = Field(default=None, description="the request's id; left out where it had none")
    version: str = Field(default="", description="of the daemon's program")

    def to_json(self) -> bytes:
        """Return it as one frame."""
        absent = {name for name in self.ABSENT if getattr(self, name) is None}
        return self.model_dump_json(exclude=absent).encode()


class Reply(AnyReply):
    """A good reply."""

    ok: Literal[True] = True


class Refusal(AnyReply):
    """The request was not carried out; the reason has a stable code and name."""

    ok: Literal[False] = False
    error: ErrorBody


class JobReply(Reply):
    """The job was taken; with `wait`, or for an id that is done already, it carries the result."""

    ABSENT = frozenset({"id", "result"})
    accepted: Literal[True] = True
    result: JobResult | None = Field(default=None, description="left out while there is none")


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


class Links(Told):
    """Lines and camera, counted since they were opened; empty while the station is not open."""

    buses: dict[str, dict[str, int]] = Field(description="line -> its counts, and whether it is connected")
    camera: dict[str, int]


class SnapshotReply(StatusReply):
    """All a late joiner needs."""

    next_seq: int = Field(description="the number the next event will carry")
    last_result: JobResult | None
    touches: int = Field(description="reported so far")
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


class PastAlert(Told):
    """An alert event as the journal has it; what else it carried stands beside."""

    model_config = ConfigDict(frozen=True, extra="allow")
    seq: int = Field(description="number of the `alert` event")
    time: str = Field(description="UTC, ISO 8601")
    name: str
    raised: bool
    message: str


class WatchFacts(Told):
    """How one watch of the station's health stands."""

    name: str
    group: str
    what: str
    unit: str
    state: Literal["learning", "good", "alert"]
    learned: float = Field(description="how much of what it needs to judge it has seen, 0..1")
    figure: float | None
    usual: float | None
    low: float | None = Field(description="allowed from here on; none: not bounded from below")
    high: float | None


class AlertsReply(Reply):
    """Past alerts in the order of their seq, those that stand, and every watch."""

    alerts: list[PastAlert]
    healthy: bool = Field(description="no alert stands")
    touches: int
    standing: list[AlertFacts]
    watches: list[WatchFacts]
    off: list[str] = Field(description="watches and groups that are switched off")


class AcknowledgeReply(Reply):
    """It was written down."""

    alert: AlertFacts


class ReportReply(Reply):
    """It was written down."""

    touches: int = Field(description="reported so far")


class TestPoint(Told):
    """One point that can be probed; lengths in um, board frame."""

    name: str
    kind: str = Field(description="via or site")
    x_um: float
    y_um: float
    diameter_um: float
    hole_um: float | None
    net: str | None


class BoardFacts(Told):
    """The board under test."""

    name: str
    side: str
    width_um: float
    height_um: float
    test_points: list[TestPoint]
    not_probeable: dict[str, str] = Field(description="name -> why not")


class ErrorFacts(Told):
    """One kind of trouble."""

    code: int
    name: str
    cause: str
    advice: str


class You(Told):
    """Who the daemon takes the asking client for."""

    client: str = Field(description="name of its key; without CURVE, of its connection")
    role: Role
    ops: list[str] = Field(description="what this role may ask")


class Limits(Told):
    """What one client may ask of the daemon."""

    max_message_bytes: int
    rate_per_s: float = Field(description="requests of one client, in the long run")
    rate_burst: int = Field(description="requests of one client at once")
    queue_length: int = Field(description="jobs that may wait")
    queue_per_client: int = Field(description="jobs of one client that may wait")


class DescribeReply(Reply):
    """Who this station is and what it can do."""

    station: str
    ops: list[str]
    events: str = Field(description="endpoint of the event socket, as the station binds it")
    board: BoardFacts
    errors: list[ErrorFacts]
    versions: list[int] = Field(description="versions of the wire this daemon speaks")
    topics: list[str]
    you: You
    limits: Limits


REPLIES: dict[str, type[Reply]] = {
    "correct": JobReply,
    "place": JobReply,
    "look": JobReply,
    "align": JobReply,
    "calibrate": JobReply,
    "home": JobReply,
    "cancel": CancelReply,
    "reset": StatusReply,
    "status": StatusReply,
    "snapshot": SnapshotReply,
    "result": ResultReply,
    "results": ResultsReply,
    "alerts": AlertsReply,
    "acknowledge": AcknowledgeReply,
    "report": ReportReply,
    "describe": DescribeReply,
}
"""Operation -> its good reply."""
