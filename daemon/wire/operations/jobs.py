"""Operations that are jobs: correct, place, look, align, calibrate, home, lift. Their bodies are `daemon.procedures`.

The request carries `id`, the caller's idempotency key.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, Self, TypeVar

from pydantic import BeforeValidator, Field, model_validator

from daemon.domain.results import JobResult
from daemon.wire.example_parts import RESULT
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.replies import Reply
from daemon.wire.requests import JobRequest, Name, Px, Um, Whole, whole

T = TypeVar("T")
Pair = Annotated[tuple[T, T], Field(strict=False)]
"""Two numbers. JSON has arrays and no tuples: the array is taken as one, its numbers stay strict."""

_WHICH_BOARD = "which board lies in the nest, a serial number for example; refused (not_aligned) unless it was aligned"


class Correct(JobRequest):
    """Look, move the tip onto the test point, verify.

    The result's `detail` tells the board's height as that of `place` does.
    """

    op: Literal["correct"]
    test_point: Name = Field(description="name of the point over which the head stands, as the board file has it")
    board_id: Name | None = Field(default=None, description=_WHICH_BOARD)


class Place(JobRequest):
    """Put the tip over a test point or a place, by the head model and the board's nominal pose.

    The needle hovers at working height over the measured surface; where this board's was not measured, above the
    highest that is possible. In the result's `detail`: `height` (`measured` or `unknown`), `height_um` or
    `height_within_um`, and `parallax_um`, how far aside a look may see a pad whose height is unknown; `confirmed_by` is
    `drives`, for nobody looked where the tip is.
    """

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
    """See where the board lies: look at three or more fiducials and store the board's pose.

    From its first look on the old pose is void: until one passes, no correction is made.
    """

    op: Literal["align"]
    fiducials: Annotated[tuple[Name, ...], Field(strict=False)] | None = Field(
        default=None, min_length=3, max_length=50, description="round targets; none: the board's fiducials"
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
    """Teach the probe's tip, or measure the map, the head's rotation, the surface's plane, or the axes' play."""

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
    """Raise the needle straight up to the safe height from wherever it is; leaves the fault `needle_down`."""

    op: Literal["lift"]


class JobReply(Reply):
    """The job was taken; with `wait`, or for an id that is done already, it carries the result."""

    ABSENT = Reply.ABSENT | {"result"}
    accepted: Literal[True] = True
    result: JobResult | None = Field(default=None, description="left out while there is none")


AnyJob = Correct | Place | Look | Align | Calibrate | Home | Lift
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
)  # fmt: skip
"""One row per job, in the order of the page."""
