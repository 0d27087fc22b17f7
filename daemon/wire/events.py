"""Events by topic, as models. What is published is built of these, so that it is what the page says."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, Literal

from pydantic import ConfigDict, Field

from daemon.domain.point_test import PointRecord
from daemon.domain.results import ErrorBody, JobResult, Told
from daemon.wire.requests import WIRE_VERSION

Topic = Literal["state", "result", "alert", "heartbeat", "progress", "contact", "point", "log"]


class EventMessage(Told):
    """What every event carries. It says by itself whose it is and when it was, for it may be forwarded."""

    # The daemon must not say what is not written here; who listens ignores what it does not know.
    model_config = ConfigDict(frozen=True, extra="forbid")

    v: Literal[1] = WIRE_VERSION
    topic: Topic
    seq: int = Field(description="counts every event of every topic, without gaps; after a restart it goes on higher")
    time: str = Field(description="UTC, ISO 8601")
    station: str


class StateEvent(EventMessage):
    """The machine went from one state to another."""

    topic: Literal["state"]
    state: str
    was: str
    event: str = Field(description="what made it change")
    job: str | None = Field(description="id of the job under way")
    fault: ErrorBody | None = Field(description="why, in state fault")


class ResultEvent(JobResult, EventMessage):
    """A job ended: its result, as it is answered and kept."""

    topic: Literal["result"]


class Acknowledged(Told):
    """A person knows of it."""

    by: str
    at: str = Field(description="UTC, ISO 8601")
    note: str


class AlertFacts(Told):
    """What is wrong, how badly, since when, by which evidence, and what to do."""

    name: str = Field(description="what it is about; the same while it is raised and when it is cleared")
    group: str
    what: str
    message: str = Field(description="all of it in a sentence")
    severity: Literal["warning", "serious"]
    figure: float = Field(description="what is found now, in `unit`")
    usual: float | None = Field(description="what this station had before; null where the limit is known beforehand")
    limit: float
    unit: str
    rule: str = Field(description="by what it was found")
    since_touches: int = Field(description="touches after which it seems to have begun")
    since_at: str = Field(description="the same as time, UTC, ISO 8601")
    evidence: tuple[str, ...] = Field(description="numbers and job ids it rests on, newest last")
    advice: str
    raised_at: str = Field(description="UTC, ISO 8601")
    updated_at: str = Field(description="UTC, ISO 8601")
    acknowledged: Acknowledged | None = Field(description="null while nobody knows")


class AlertEvent(AlertFacts, EventMessage):
    """Something needs a person, or does not any more."""

    topic: Literal["alert"]
    raised: bool = Field(description="it stands; false: the trouble is gone")
    change: Literal["raised", "worse", "acknowledged", "cleared"]


class HeartbeatEvent(EventMessage):
    """The daemon lives; it comes at a steady pace, so that its absence says something."""

    topic: Literal["heartbeat"]
    state: str
    version: str = Field(description="of the daemon's program")


class ProgressEvent(EventMessage):
    """How far a job of minutes is."""

    topic: Literal["progress"]
    job: str
    op: str
    done: int
    total: int
    doing: str


class ContactEvent(EventMessage):
    """The needle made contact, or was lifted again."""

    topic: Literal["contact"]
    change: Literal["made", "lifted"]
    job: str
    press: int = Field(default=1, description="which press of the job, from 1")
    test_point: str
    board_id: str | None
    z_um: float = Field(description="where Z stood")
    pressed_um: float
    force_n: float


class PointEvent(PointRecord, EventMessage):
    """A point was tested: its record."""

    topic: Literal["point"]
    job: str


class LogEvent(EventMessage):
    """Something that matters to whoever runs the station; the facts stand beside, by their own names."""

    model_config = ConfigDict(frozen=True, extra="allow")
    topic: Literal["log"]
    event: str = Field(description="what happened, such as configuration_taken or configuration_refused")


TOPICS: Final[Mapping[str, type[EventMessage]]] = MappingProxyType(
    {
        "state": StateEvent,
        "result": ResultEvent,
        "alert": AlertEvent,
        "heartbeat": HeartbeatEvent,
        "progress": ProgressEvent,
        "contact": ContactEvent,
        "point": PointEvent,
        "log": LogEvent,
    }
)


def event(topic: Topic, seq: int, time: str, station: str, body: dict[str, Any]) -> EventMessage:
    """Build an event from what is particular to it; raise ValueError for a field its model has not."""
    return TOPICS[topic](**{**body, "topic": topic, "seq": seq, "time": time, "station": station})
