"""Operation describe: who the station is, its board, its errors, and what the client may ask."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import Field

from daemon.domain.results import Told
from daemon.domain.roles import Role
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.replies import Reply
from daemon.wire.requests import ImmediateRequest


class Describe(ImmediateRequest):
    """Ask who this station is, what it can do and which test points it knows."""

    op: Literal["describe"]


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


ROWS: Final = (
    Operation(
        request=Describe,
        reply=DescribeReply,
        least_role="observe",
        deadline=DefaultDeadline.NONE,
        example_reply={
            "station": "station-1", "ops": ["status"], "events": "tcp://127.0.0.1:5556", "versions": [1],
            "topics": ["state"], "errors": [{"code": 1003, "name": "unknown_op", "cause": "...", "advice": "..."}],
            "board": {"name": "demo", "side": "top", "width_um": 50000.0, "height_um": 40000.0,
                      "test_points": [{"name": "TP7", "kind": "site", "x_um": 12000.0, "y_um": 8000.0,
                                       "diameter_um": 400.0, "hole_um": None, "net": "VCC"}], "not_probeable": {}},
            "you": {"client": "tester-1", "role": "observe", "ops": ["status"]},
            "limits": {"max_message_bytes": 1000000, "rate_per_s": 2000.0, "rate_burst": 2000, "queue_length": 16,
                       "queue_per_client": 8},
        },
    ),
)  # fmt: skip
"""The one row of this module."""
