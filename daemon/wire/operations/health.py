"""Operations on the station's health: alerts, acknowledge, and the tester's report."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import ConfigDict, Field

from daemon.domain.results import ErrorBody, Told
from daemon.wire.events import AlertFacts
from daemon.wire.example_parts import ALERT, AT
from daemon.wire.limits import MAX_SEQ
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.replies import Reply
from daemon.wire.requests import JobId, Name, Request, Whole


class Alerts(Request):
    """Ask what stands against the station and how every watch of its health stands; replay alerts from a seq on."""

    op: Literal["alerts"]
    since: Whole = Field(default=0, ge=0, le=MAX_SEQ, description="first seq wanted")
    limit: Whole = Field(default=100, ge=1, le=1000)


class Acknowledge(Request):
    """Say that a person knows of an alert."""

    op: Literal["acknowledge"]
    alert: Name
    by: str = Field(min_length=1, max_length=64, description="who knows")
    note: str = Field(default="", max_length=500)
    mended: bool = Field(
        default=False, description="the cause is gone: clear it, and learn anew what is usual; needs the role maintain"
    )


class Charts(Request):
    """Ask for the charts of a month: the courses of all watches, as the page of `reprobe month` shows them."""

    op: Literal["charts"]
    month: str = Field(pattern=r"^\d{4}-(0[1-9]|1[0-2])$", description="such as 2026-11, UTC")


class Report(Request):
    """Tell what the tester saw: the re-test after a job, and touches made since the last report."""

    op: Literal["report"]
    id: JobId | None = Field(default=None, description="the job whose point was tested again")
    retest: Literal["pass", "open"] | None = None
    touches: Whole = Field(default=0, ge=0, le=10_000_000, description="touches since the last report")


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
    healthy: bool = Field(
        description="no alert stands, no fault, and it is calibrated: a station that is not homed is not healthy"
    )
    fault: ErrorBody | None = Field(default=None, description="the first cause, while in fault")
    not_calibrated: list[str] = Field(default=[], description="what is missing of `tip` and `map`: it corrects nothing")
    touches: int
    standing: list[AlertFacts]
    watches: list[WatchFacts]
    off: list[str] = Field(description="watches and groups that are switched off")


class AcknowledgeReply(Reply):
    """It was written down."""

    alert: AlertFacts


class ChartFacts(Told):
    """The watches of one group over a month."""

    group: str = Field(description="of its watches, as `alerts` has it")
    title: str
    caption: str
    svg: str = Field(description="a picture as SVG, whole, light or dark as its reader wants it")


class ChartsReply(Reply):
    """Charts, one a group that has numbers in the month."""

    month: str
    drawn_at: str = Field(description="UTC, ISO 8601: what came later is not in them")
    charts: list[ChartFacts]


class ReportReply(Reply):
    """It was written down."""

    touches: int = Field(description="reported so far")


AnyHealth = Alerts | Acknowledge | Report | Charts
"""Every request of this module, for the type checker; in the order of the rows."""

ROWS: Final = (
    Operation(
        request=Alerts,
        reply=AlertsReply,
        least_role="observe",
        deadline=DefaultDeadline.SHORT,
        example={"since": 4700},
        example_reply={
            "alerts": [{"seq": 4702, "time": AT, "raised": True, "change": "raised", **ALERT}], "healthy": False,
            "touches": 48213, "standing": [ALERT], "off": [],
            "watches": [{"name": "light_white", "group": "light", "what": "the white ring's brightness on the needle",
                         "unit": "levels", "state": "alert", "learned": 1.0, "figure": 131.2, "usual": 148.0,
                         "low": 139.4, "high": 156.6}],
        },
    ),
    Operation(
        request=Acknowledge,
        reply=AcknowledgeReply,
        least_role="operate",
        deadline=DefaultDeadline.SHORT,
        example={"alert": "light_white", "by": "M. Weber", "note": "ring is ordered"},
        example_reply={
            "alert": ALERT | {"acknowledged": {"by": "M. Weber", "at": AT, "note": "ring is ordered"}},
        },
    ),
    Operation(
        request=Report,
        reply=ReportReply,
        least_role="operate",
        deadline=DefaultDeadline.SHORT,
        example={"id": "board17-TP7-1", "retest": "pass", "touches": 20},
        example_reply={"id": "board17-TP7-1", "touches": 48213},
    ),
    Operation(
        request=Charts,
        reply=ChartsReply,
        least_role="observe",
        deadline=DefaultDeadline.NONE,
        example={"month": "2026-11"},
        example_reply={
            "month": "2026-11", "drawn_at": AT,
            "charts": [{"group": "light", "title": "Light on the needle", "caption": "Over the days of the month.",
                        "svg": '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>'}],
        },
    ),
)  # fmt: skip
"""One row per operation, in the order of the page."""
