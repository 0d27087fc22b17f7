"""Operations on plans, and on the records of a run's points. The run itself is a job: `jobs`."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from daemon.domain.board_run import BoardRun
from daemon.domain.plan import PLAN_NAME, StoredPlan
from daemon.domain.point_mark import Mark, PointMark
from daemon.domain.point_test import PointRecord
from daemon.domain.results import Told
from daemon.wire.example_parts import AT, RECORD
from daemon.wire.example_runs import PLAN, RUN
from daemon.wire.limits import MAX_SEQ
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.replies import Reply
from daemon.wire.requests import JobId, Name, Request, Whole

PlanName = Annotated[str, Field(pattern=PLAN_NAME)]


class Points(Request):
    """Read the records of a run's points, and how the run stands; page by page."""

    op: Literal["points"]
    run: JobId = Field(description="id of the run, or of any job that worked on it; `last`: the newest")
    since: Whole = Field(default=0, ge=0, le=MAX_SEQ, description="first number wanted")
    limit: Whole = Field(default=100, ge=1, le=1000)


class PlanRequest(Request):
    """Check, store, list, show, approve plans, or learn one's limits from runs on boards that are known to be good.

    To list, show and check needs the role operate, all else maintain.

    A plan's file is TOML or CSV (the README has both) and is read for the station's board; all its mistakes are told in
    one refusal (`invalid_plan`), each with its line, in `detail.mistakes`. Each change is a new version. In CSV, cells
    may be separated by commas, semicolons or tabs; a frame has few commas, so that of a long file tabs are needed.
    """

    op: Literal["plan"]
    action: Literal["check", "store", "list", "show", "learn", "approve"] = "list"
    name: PlanName | None = Field(default=None, description="of the plan; for check and store where the file has none")
    version: Whole | None = Field(default=None, ge=1, description="show, approve: which; none: the newest")
    text: str | None = Field(default=None, max_length=900_000, description="check, store: the file's content")
    form: Literal["toml", "csv"] = Field(default="toml", description="check, store: how it is written")
    learn_from: Annotated[tuple[JobId, ...], Field(strict=False)] | None = Field(
        default=None, min_length=1, max_length=100, description="learn: runs on boards that are known to be good"
    )
    by: str | None = Field(
        default=None,
        min_length=1,
        max_length=64,
        description="who does it; approve needs a person's name, else none is the client's",
    )

    @property
    def only_asks(self) -> bool:
        """Whether no plan is changed by it."""
        return self.action in ("list", "show", "check")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        needs = {"check": ("text",), "store": ("text",), "show": ("name",), "approve": ("name", "by"),
                 "learn": ("name", "learn_from")}  # fmt: skip
        missing = [field for field in needs.get(self.action, ()) if getattr(self, field) is None]
        if missing:
            raise ValueError(f"action {self.action} needs {' and '.join(missing)}")
        return self


class PlanFacts(Told):
    """A plan in the list."""

    name: str
    version: int = Field(description="the newest")
    hash: str
    board: str
    fits: bool = Field(description="it is for the station's board, and for this file of it")
    tests: int
    learned: bool = Field(description="its limits come from measurements")
    approved: bool
    stored_at: str = Field(description="UTC, ISO 8601")


class PlanReply(Reply):
    """The plan asked for, or the list of all."""

    ABSENT = Reply.ABSENT | {"plan", "left_out", "plans"}
    plan: StoredPlan | None = Field(default=None, description="left out for a list; version 0: checked, not stored")
    left_out: dict[str, str] | None = Field(default=None, description="learn: point -> why it is not in the plan")
    plans: list[PlanFacts] | None = Field(
        default=None, description="list: the newest version of every stored plan, by name"
    )
    damaged: list[str] = Field(default=[], description="list: stored plans that cannot be read, with why")


class NumberedRecord(PointRecord):
    """The record of a point, with its number."""

    n: int = Field(description="grows with each point of the station; the next page begins at the last one's plus 1")
    job: str = Field(default="", description="that tested it")
    pictures_id: str | None = Field(
        default=None, description="id under which `pictures` and `picture` have what is kept of it; null: nothing is"
    )


class PointTests(Request):
    """Look back over the tests of one point, newest first: on all boards, or on one."""

    op: Literal["point"]
    test_point: Name
    board_id: Name | None = None
    before: Whole | None = Field(
        default=None, ge=0, le=MAX_SEQ, description="only tests of a lower number: the last one of the page before"
    )
    limit: Whole = Field(default=50, ge=1, le=500)


class MarkPoint(Request):
    """Forbid a point of this station's board to the needle, or approve it again, with a reason.

    It holds from the next touch on, in a run too: there the point is `not_tested`, and the reason is told. What CAD
    says cannot be probed stays so: nobody can approve that.
    """

    op: Literal["mark"]
    test_point: Name
    mark: Mark
    reason: str = Field(min_length=1, max_length=300, pattern=r"\S")


class Marks(Request):
    """Ask which points of this station's board people have forbidden or approved, and why."""

    op: Literal["marks"]


class PointsReply(Reply):
    """Records in the order in which the points were tested."""

    run: BoardRun
    points: list[NumberedRecord]


class PointTestsReply(Reply):
    """Records of one point, newest first."""

    tests: list[NumberedRecord]
    more: bool = Field(description="there are older ones")


class MarkReply(Reply):
    """It was written down."""

    mark: PointMark


class MarksReply(Reply):
    """What counts now of each point that somebody marked, by its name."""

    marks: list[PointMark]


AnyRunQuestion = Points | PointTests | MarkPoint | Marks | PlanRequest
"""Every request of this module that is no job, for the type checker; in the order of the rows."""
_STORED: Final[dict[str, Any]] = {
    "version": 3, "plan": PLAN, "hash": "5d41402abc4b2a76", "stored_at": AT, "stored_by": "tester-1", "approved": None,
}  # fmt: skip
_MARK: Final[dict[str, Any]] = {
    "point": "TP1", "mark": "forbidden", "reason": "its trace lifts", "by": "M. Weber", "at": AT,
}  # fmt: skip
ROWS: Final = (
    Operation(
        request=Points,
        reply=PointsReply,
        least_role="observe",
        deadline=DefaultDeadline.SHORT,
        example={"run": "board17-run-1", "since": 1200},
        example_reply={
            "run": RUN,
            "points": [RECORD | {"n": 1200, "run": "board17-run-1", "plan_hash": RUN["plan_hash"]}],
        },
    ),
    Operation(
        request=PointTests,
        reply=PointTestsReply,
        least_role="observe",
        deadline=DefaultDeadline.SHORT,
        example={"test_point": "TP7", "limit": 20},
        example_reply={
            "tests": [
                RECORD | {"n": 1200, "job": "board17-run-1", "run": "board17-run-1", "plan_hash": RUN["plan_hash"]}
            ],
            "more": True,
        },
    ),
    Operation(
        request=MarkPoint,
        reply=MarkReply,
        least_role="operate",
        deadline=DefaultDeadline.SHORT,
        example={"test_point": "TP1", "mark": "forbidden", "reason": "its trace lifts"},
        example_reply={"mark": _MARK},
    ),
    Operation(
        request=Marks,
        reply=MarksReply,
        least_role="observe",
        deadline=DefaultDeadline.SHORT,
        example_reply={"marks": [_MARK]},
    ),
    Operation(
        request=PlanRequest,
        reply=PlanReply,
        least_role="operate",
        deadline=DefaultDeadline.SHORT,
        example={
            "action": "store",
            "name": "power",
            "text": '[plan]\nboard = "demo"\n[[point]]\nnet = "VCC"\nhigh = "5 ohm"\n',
        },
        example_reply={"plan": _STORED},
    ),
)
"""One row per operation, in the order of the page."""
