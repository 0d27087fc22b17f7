"""Operations that are jobs: correct, place, look, align, calibrate, home, lift, jog, touch, probe, run.

Their bodies are `daemon.procedures`. The request carries `id`, the caller's idempotency key.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, Self, TypeVar

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from daemon.domain.contact import ContactFacts
from daemon.domain.point_test import UNIT_OF_METHOD, Limits, PointMethod, PointVerdict
from daemon.domain.results import JobResult, Told
from daemon.wire.example_parts import CONTACT, RECORD, RESULT
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.operations.runs import PlanName
from daemon.wire.replies import Reply
from daemon.wire.requests import JobRequest, LeaseMs, Name, Px, Um, Whole, whole

POINTS_AT_ONCE = 1500
"""Points that one request may name; more of them make a plan."""
T = TypeVar("T")
Pair = Annotated[tuple[T, T], Field(strict=False)]
"""Two numbers. JSON has arrays and no tuples: the array is taken as one, its numbers stay strict."""

_WHICH_BOARD = "which board lies in the nest, a serial number for example; refused (not_aligned) unless it was aligned"


MOST_JOG_UM, MOST_JOG_DEG = 1000.0, 5.0
"""Of one step."""
LEAST_JOG_UM, LEAST_JOG_DEG = 5.0, 0.1
"""What is less an axis may leave undone."""
MOST_HOLDS = 8
"""Presses of one point in which the needle is held for the tester."""
AFTER_THE_TIP = {
    "map": "calibrate map", "rotation": "calibrate rotation", "alignment": "align", "surface": "calibrate surface",
}  # fmt: skip
"""Kind of a calibration -> the operation that makes it, in the order in which they follow a taught tip."""


class Correct(JobRequest):
    """Look, move the tip onto the test point, verify.

    The result's `detail` tells the board's height as that of `place` does.
    """

    ENDS_OVER_POINT = "seen"
    FOR_NEEDLE = True
    op: Literal["correct"]
    test_point: Name = Field(description="name of the point over which the head stands, as the board file has it")
    board_id: Name | None = Field(default=None, description=_WHICH_BOARD)


class Place(JobRequest):
    """Put the tip over a test point or a place, by the head model and the board's nominal pose.

    The needle hovers at working height over the measured surface, higher over a pad that is told to stand above it;
    where this board's was not measured, above the highest that is possible. With a map, a look sees there that the pin
    is free; where the tip is not seen, it is raised until it is. In the result's `detail`: `height` (`measured` or
    `unknown`), `height_um` or `height_within_um`, `pad_stands_um` where the board file tells how high the pad stands,
    `pad_height` (`unknown`) of a soldered one of which it does not, and `parallax_um`, how far aside a look may see a
    pad whose height is unknown; `confirmed_by`: `picture`, the tip was seen there by the board's CAD, `off_um` and
    `away_um` tell how far off; or `drives`, where nobody could see it or it was seen farther off than a first landing
    may end, `unconfirmed` tells why (`name`, `message`, `advice`), also where tip or map is missing.
    """

    ENDS_OVER_POINT = "placed"
    op: Literal["place"]
    test_point: Name | None = None
    board_um: Pair[Um] | None = Field(default=None, description="instead of a test point: a place, board frame")
    theta_deg: float = Field(default=0.0, ge=0.0, lt=360.0, allow_inf_nan=False, description="head angle")
    board_id: Name | None = Field(default=None, description=_WHICH_BOARD)

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.test_point is None) == (self.board_um is None):
            raise ValueError("give either test_point or board_um")
        return self


class Look(JobRequest):
    """Look once, where the head is, and say what is seen; nothing moves."""

    op: Literal["look"]
    test_point: Name | None = None
    pictures: bool = Field(default=False, description="keep the pictures and name their folder in the result")


class Align(JobRequest):
    """See where the board lies: look at three or more places of it and store the board's pose.

    Where the board file has layers, these are places whose surroundings are found once on the board, so that board,
    side and turn are settled as well: the result's `detail` then has `seat`, with `verified`, `places` and the least
    `agreement`. Otherwise they are its fiducials. From its first look on the old pose is void: until one passes, no
    correction is made.
    """

    op: Literal["align"]
    fiducials: Annotated[tuple[Name, ...], Field(strict=False)] | None = Field(
        default=None,
        min_length=3,
        max_length=50,
        description="targets to look at, round ones where the board file has no layers; none: as said above",
    )
    thetas_deg: tuple[Annotated[float, Field(ge=0.0, lt=360.0, allow_inf_nan=False)], ...] = Field(
        default=(0.0, 180.0),
        min_length=1,
        max_length=8,
        strict=False,
        description="head angles from which each is looked at",
    )
    board_id: Name | None = Field(
        default=None, description="which board lies in the nest; later requests may name it, another one is refused"
    )


class Calibrate(JobRequest):
    """Teach the probe's tip, or measure the map, the head's rotation, the surface's plane, or the axes' play.

    A new tip makes map, rotation and surface void. In `detail` of its result: `void`, those that were in force, and
    `next`, what is to be done now, in this order.
    """

    op: Literal["calibrate"]
    what: Literal["tip", "map", "rotation", "surface", "backlash"]
    tip_px: Pair[Px] | None = Field(default=None, description="tip: where the needle's end is in the picture")
    test_point: Name | None = Field(
        default=None, description="map, backlash: the round target to look at; none: the control point"
    )
    theta_deg: float = Field(
        default=0.0, ge=0.0, lt=360.0, allow_inf_nan=False, description="map, surface, backlash: head angle"
    )
    angles: Annotated[int, Field(ge=6, le=1000), BeforeValidator(whole)] | None = Field(
        default=None, description="rotation: so many angles, evenly spread"
    )
    every_deg: float | None = Field(
        default=None, ge=0.5, le=45.0, allow_inf_nan=False, description="rotation: instead, an angle at every so many"
    )
    model: Literal["auto", "fourier", "array", "circle"] = Field(default="auto", description="rotation: what to fit")
    resume: bool = Field(default=True, description="rotation: go on where an interrupted run ended")
    places: Whole = Field(default=12, ge=4, le=200, description="surface: how many places to touch")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.what == "tip" and self.tip_px is None:
            raise ValueError("what=tip needs tip_px")
        if self.angles is not None and self.every_deg is not None:
            raise ValueError("give either angles or every_deg")
        return self


class Home(JobRequest):
    """Home all axes, Z first and up; the only request that leaves the fault `not_homed`."""

    op: Literal["home"]


class Lift(JobRequest):
    """End a touch, or raise the needle straight up from wherever it is; leaves the fault `needle_down`.

    With the id of a touch: the needle is lifted, and the answer is the touch's result with what the tester measured in
    it; sent again, it answers the same. What came too late to be kept, or differs from what was said first, is refused
    (verdict_not_kept). A probe may press again while an answer is under way: with `press`, the number that `contact`
    told, a word counts for that press alone, and one of any other press is refused (another_press); the needle stays as
    it is. With keys, only the client that touched may do that. With any other id it is a job of its own, and goes up to
    the safe height.
    """

    op: Literal["lift"]
    verdict: Name | None = Field(default=None, description="of the tester on what it touched, in its own word")
    value: float | None = Field(default=None, allow_inf_nan=False, description="what it measured")
    unit: Name | None = Field(default=None, description="of the value")
    press: Whole | None = Field(
        default=None, ge=1, description="in which it was measured, as `contact` told it; none: the one that stands"
    )

    @property
    def measured(self) -> dict[str, Any]:
        """What the tester said, without what it did not."""
        return self.model_dump(include={"verdict", "value", "unit"}, exclude_none=True)


class Jog(JobRequest):
    """Move one axis by one small step, for maintenance.

    Refused (busy) while anything runs or waits. X, Y and the head turn only while Z is at the safe height (`lift`), and
    Z goes down, slowly, no lower than where the needle is free of any surface that is possible. Refused too where an
    axis is not homed, the needle is not known to be up, or was not seen free since its last press.
    """

    ALONE = True
    op: Literal["jog"]
    axis: Literal["x", "y", "z", "theta"]
    by_um: float | None = Field(
        default=None, ge=-MOST_JOG_UM, le=MOST_JOG_UM, allow_inf_nan=False, description="x, y, z: so far, at least 5 um"
    )
    by_deg: float | None = Field(
        default=None, ge=-MOST_JOG_DEG, le=MOST_JOG_DEG, allow_inf_nan=False, description="theta: so far, at least 0.1"
    )

    @model_validator(mode="after")
    def _one_step(self) -> Self:
        steps = (self.by_um, self.by_deg, LEAST_JOG_UM)
        step, other, least = steps if self.axis != "theta" else (self.by_deg, self.by_um, LEAST_JOG_DEG)
        if step is None or other is not None:
            raise ValueError("theta needs by_deg, every other axis by_um, and neither the other one")
        if abs(step) < least:
            raise ValueError(f"a step is at least {least:g}")
        return self


class Touch(JobRequest):
    """Lower the needle onto the test point below it, slowly, until the pin is pushed in; with `hold_ms`, hold it there.

    The client has put the head over the point by `place` or `correct` just before, and nothing has moved since; this
    board's surface is measured there. A point that was pressed before must have been seen since, and one that a look
    has shown beside the tip is not touched from there: `correct` it first. A held needle is lifted by `lift`, at the
    end of `hold_ms`, by `cancel`, and when nobody renews its lease by `hold`.
    `detail` of the result: `contact`, `ended_by` (`at_once`, `hold_ms` or `lift`), `measured`, and `touches_of_pad`.
    """

    FOR_NEEDLE = TOUCHES = True
    op: Literal["touch"]
    test_point: Name = Field(description="name of the point over which the head stands, as the board file has it")
    press_um: float | None = Field(
        default=None, ge=20, le=1000, allow_inf_nan=False,
        description="how far the pin is to be pushed in; none: as the configuration has it",
    )  # fmt: skip
    hold_ms: float = Field(
        default=0.0, ge=0, le=600_000, allow_inf_nan=False, description="held at most so long; 0: lifted at once"
    )
    lease_ms: LeaseMs = Field(default=2000.0, description="lifted when no `hold` comes for so long")
    board_id: Name | None = Field(default=None, description=_WHICH_BOARD + "; none: the one that was aligned")
    wait: bool | Literal["contact"] = Field(  # type: ignore[assignment]  # it may say more than other jobs' does
        default=False, description="hold the reply until the result is there, or until the needle stands"
    )

    @property
    def held_ms(self) -> float:
        """How long the needle may be held."""
        return self.hold_ms


class Probe(JobRequest):
    """Test one point: place, touch, measure, and where that is no pass look, correct, pump, and touch again.

    What is done in which order is `[ladder]` of the configuration. No pad is pressed a second time before the eye has
    seen it below the tip, and an open is accused only with contact proved in the same press. The outcome is the
    verdict, and `detail.record` of the result tells it: `verdict`, `reason`, `recovered_by`, `cause`, `readings`.

    `measure`: the station's own instrument, or the `tester`: then the needle is held for it in each press, as in a
    `touch`, and its `lift` says `pass`, `fail` or `open`, or a `value` that the limits judge. The answer of such a
    `lift` is the result, or `contact`: the point was touched again, and is to be measured again. A `lift` that says
    nothing leaves the point `not_tested` (but for `insert`); what is said before the needle stands is not taken.
    """

    FOR_NEEDLE = TOUCHES = True
    op: Literal["probe"]
    test_point: Name | None = Field(default=None, description="name of the point, as the board file has it")
    net: str | None = Field(
        default=None, min_length=1, max_length=120, description="instead of a point: the best point of this net"
    )
    theta_deg: float | None = Field(
        default=None, ge=0.0, lt=360.0, allow_inf_nan=False, description="head angle; none: any that reaches it"
    )
    method: PointMethod = "continuity"
    limits: Limits | None = Field(
        default=None, description="of the value; none: a whole net, or any value that is no open"
    )
    look: Literal["first", "on_open"] = Field(default="on_open", description="look before the first touch, or after")
    touches: Annotated[int, Field(ge=1, le=100), BeforeValidator(whole)] | None = Field(
        default=None, description="descents onto the pad at most; none: as the configuration has it"
    )
    measure: Literal["station", "tester"] = "station"
    hold_ms: float = Field(
        default=30_000.0,
        ge=200,
        le=600_000,
        allow_inf_nan=False,
        description="tester: held at most so long, each press",
    )
    lease_ms: LeaseMs = Field(default=2000.0, description="tester: lifted when no `hold` comes for so long")
    board_id: Name | None = Field(default=None, description=_WHICH_BOARD + "; the pad's touches are counted by it")
    wait: bool | Literal["contact"] = Field(  # type: ignore[assignment]  # it may say more than other jobs' does
        default=False, description="hold the reply until the result is there, or until the needle stands for the tester"
    )

    @property
    def held_ms(self) -> float:
        """How long the needle may be held for the tester in all."""
        return self.hold_ms * MOST_HOLDS if self.measure == "tester" else 0.0

    @model_validator(mode="after")
    def _one_point(self) -> Self:
        if (self.test_point is None) == (self.net is None):
            raise ValueError("give either test_point or net")
        unit = UNIT_OF_METHOD[self.method]
        if self.limits is not None and self.limits.unit != unit:
            raise ValueError(f"{self.method} is measured in {unit or 'nothing'}, limits are in {self.limits.unit}")
        if self.method == "insert" and self.measure != "tester":
            raise ValueError('method insert is the tester\'s: it needs "measure": "tester"')
        return self


class StopRules(Told):
    """When a run stops by itself, besides a bad needle and a fault, which always stop it; points of this job count."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    contact_not_made: Annotated[int, Field(ge=1, le=5000), BeforeValidator(whole)] | None = Field(
        default=5, description="after so many points one after the other without contact; null: never"
    )
    failed: Annotated[int, Field(ge=1, le=5000), BeforeValidator(whole)] | None = Field(
        default=None, description="after so many points in all that failed, or are open; null: never"
    )


class Run(JobRequest):
    """Walk a plan, or a list of points, over a board: test point by point, and tell each as soon as it has a verdict.

    `board_id` is required, for touches of pads are counted by it, and so is what is left of a run. What no point could
    be tested without (tip, map, the board's alignment, its surface) is refused before anything moves. A run that a
    kill, a cancel or a fault left unfinished is gone on with by another `run` with `resume`: no point that has a
    verdict is touched again, and plan and order stay those of its beginning. While one of this board is unfinished,
    another is refused (`run_unfinished`); `abandon` ends the old one as it is. A list of `points` asks only for
    contact. The result's `detail` tells `run` (its id, that of the job that began it) and `summary`.
    """

    TOUCHES = True
    op: Literal["run"]
    plan: PlanName | None = Field(default=None, description="name of a stored plan")
    version: Whole | None = Field(default=None, ge=1, description="of the plan; none: the newest")
    points: Annotated[tuple[Name, ...], Field(strict=False)] | None = Field(
        default=None, min_length=1, max_length=POINTS_AT_ONCE, description="instead of a plan: names of test points"
    )
    board_id: Name = Field(
        description="which board lies in the nest, a serial number for example; it was aligned by it"
    )
    order: Literal["given", "short"] = Field(
        default="short", description="in which points are walked: as the plan has them, or by the shortest time"
    )
    resume: bool = Field(default=False, description="go on with this board's unfinished run")
    abandon: bool = Field(default=False, description="end this board's unfinished run as it is, and begin another")
    stop: StopRules = Field(default=StopRules(), description="when it stops by itself")

    @model_validator(mode="before")
    @classmethod
    def _whose(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("board_id") is None:
            raise ValueError("a run needs board_id: which board lies in the nest, its serial number for example")
        return given

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if self.plan is not None and self.points is not None:
            raise ValueError("give either plan or points")
        if self.plan is None and self.points is None and not self.resume:
            raise ValueError("give a plan or points, or resume an unfinished run")
        if self.resume and self.abandon:
            raise ValueError("give either resume or abandon")
        if self.version is not None and self.plan is None:
            raise ValueError("version is that of a plan: give plan, too")
        return self


class JobReply(Reply):
    """The job was taken; with `wait`, or for an id that is done already, it carries the result."""

    ABSENT = Reply.ABSENT | {"result", "contact"}
    accepted: Literal[True] = True
    result: JobResult | None = Field(default=None, description="left out while there is none")
    contact: ContactFacts | None = Field(
        default=None,
        description='with `"wait": "contact"`, and of a `lift` after which a probe touched again: it stands',
    )


AnyJob = Correct | Place | Look | Align | Calibrate | Home | Lift | Jog | Touch | Probe | Run
"""Every request of a job, for the type checker; in the order of the rows."""

_TAKEN: Final[dict[str, Any]] = {"accepted": True}
ROWS: Final = (
    Operation(
        request=Correct,
        reply=JobReply,
        least_role="operate",
        deadline=DefaultDeadline.JOB,
        outcomes=("corrected", "already_on_target"),
        example={"id": "board17-TP7-1", "test_point": "TP7", "wait": True, "deadline_ms": 10_000},
        example_reply=_TAKEN | {"id": "board17-TP7-1", "result": RESULT},
    ),
    Operation(
        request=Place,
        reply=JobReply,
        least_role="operate",
        deadline=DefaultDeadline.JOB,
        outcomes=("placed",),
        example={"id": "board17-TP7-0", "test_point": "TP7", "theta_deg": 45.0},
        example_reply=_TAKEN | {"id": "board17-TP7-0"},
    ),
    Operation(
        request=Look,
        reply=JobReply,
        least_role="operate",
        deadline=DefaultDeadline.JOB,
        outcomes=("looked",),
        example={"id": "look-3", "pictures": True},
        example_reply=_TAKEN | {"id": "look-3"},
    ),
    Operation(
        request=Align,
        reply=JobReply,
        least_role="operate",
        deadline=DefaultDeadline.LENGTHY_JOB,
        outcomes=("aligned",),
        example={"id": "board17-align"},
        example_reply=_TAKEN | {"id": "board17-align"},
    ),
    Operation(
        request=Calibrate,
        reply=JobReply,
        least_role="maintain",
        deadline=DefaultDeadline.LENGTHY_JOB,
        outcomes=("calibrated",),
        example={"id": "map-2025-03-04", "what": "map"},
        example_reply=_TAKEN | {"id": "map-2025-03-04"},
    ),
    Operation(
        request=Home,
        reply=JobReply,
        least_role="maintain",
        deadline=DefaultDeadline.JOB,
        outcomes=("homed",),
        example={"id": "home-1", "wait": True},
        example_reply=_TAKEN
        | {
            "id": "home-1",
            "result": RESULT
            | {
                "id": "home-1", "op": "home", "outcome": "homed", "test_point": None, "error_before_um": None,
                "error_after_um": None, "looks": 0,
            },
        },
    ),
    Operation(
        request=Lift,
        reply=JobReply,
        least_role="operate",
        deadline=DefaultDeadline.JOB,
        outcomes=("lifted",),
        example={"id": "lift-1"},
        example_reply=_TAKEN | {"id": "lift-1"},
    ),
    Operation(
        request=Jog,
        reply=JobReply,
        least_role="maintain",
        deadline=DefaultDeadline.JOB,
        outcomes=("jogged",),
        example={"id": "jog-1", "axis": "x", "by_um": -100.0},
        example_reply=_TAKEN | {"id": "jog-1"},
    ),
    Operation(
        request=Touch,
        reply=JobReply,
        least_role="operate",
        deadline=DefaultDeadline.JOB,
        outcomes=("touched",),
        example={"id": "board17-TP7-2", "test_point": "TP7", "hold_ms": 5000, "wait": "contact"},
        example_reply=_TAKEN | {"id": "board17-TP7-2", "contact": CONTACT},
    ),
    Operation(
        request=Probe,
        reply=JobReply,
        least_role="operate",
        deadline=DefaultDeadline.JOB,
        outcomes=tuple(verdict.value for verdict in PointVerdict),
        example={
            "id": "board17-TP7-3", "test_point": "TP7", "limits": {"high": 5.0, "unit": "ohm"}, "board_id": "board17",
            "wait": True,
        },
        example_reply=_TAKEN
        | {
            "id": "board17-TP7-3",
            "result": RESULT
            | {"id": "board17-TP7-3", "op": "probe", "outcome": "pass_recovered", "detail": {"record": RECORD}},
        },
    ),
    Operation(
        request=Run,
        reply=JobReply,
        least_role="operate",
        deadline=DefaultDeadline.RUN,
        outcomes=("run_done", "run_stopped"),
        example={"id": "board17-run-1", "plan": "power", "board_id": "board17"},
        example_reply=_TAKEN | {"id": "board17-run-1"},
    ),
)  # fmt: skip
"""One row per job, in the order of the page."""
