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


class Configuration(ImmediateRequest):
    """Ask which settings are in force, and which of them stand in the station's file. No secret and no path is told."""

    op: Literal["config"]


class Setting(Told):
    """One setting."""

    name: str = Field(description="as the file has it: section and key")
    value: str | float | bool | None = Field(description="in force; null where it is not set")
    source: Literal["file", "default"]


class ConfigurationReply(Reply):
    """What is in force."""

    settings: list[Setting]
    refused: list[str] = Field(
        description="what is wrong with the file since the last reload, or needs a restart; then these settings stay"
    )


class TestPoint(Told):
    """One point that can be probed; lengths in um, board frame."""

    name: str
    kind: str = Field(description="via, site (a pad of no part), pad or pin of a part")
    x_um: float
    y_um: float
    diameter_um: float | None = Field(description="of its bare metal where that is round")
    hole_um: float | None
    net: str | None
    part: str | None = None
    pin: str | None = None
    shape: str = Field(default="round", description="round, rectangle, oblong, polygon or ring")
    room_um: float | None = Field(default=None, description="radius of free bare metal about (x_um, y_um)")
    stands_um: float | None = Field(default=None, description="how far it stands above the board, where that is known")
    rank: int | None = Field(default=None, description="place in the order of preference within its net, 0 the best")


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
    live: str = Field(default="", description="endpoint of the live pictures, as the station binds it; empty: none")
    board: BoardFacts
    errors: list[ErrorFacts]
    versions: list[int] = Field(description="versions of the wire this daemon speaks")
    topics: list[str]
    you: You
    limits: Limits


AnyDescription = Describe | Configuration
"""Every request of this module, for the type checker; in the order of the rows."""

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
    Operation(
        request=Configuration,
        reply=ConfigurationReply,
        least_role="observe",
        deadline=DefaultDeadline.NONE,
        example_reply={
            "settings": [{"name": "servo.tolerance_um", "value": 20.0, "source": "file"}], "refused": [],
        },
    ),
)  # fmt: skip
"""One row per operation, in the order of the page."""
