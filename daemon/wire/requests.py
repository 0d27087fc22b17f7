"""The wire, as models: requests a client may send, replies and events the daemon sends.

Every request is one JSON object `{"v": 1, "op": ..., ...}`; unknown fields are refused by name. Requests that start
work carry `id`, the caller's idempotency key. Lengths are um, angles degrees, times ms, as the names say.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from daemon.domain.errors import Fault, FaultCode

WIRE_VERSION: Literal[1] = 1
VERSIONS: tuple[int, ...] = (WIRE_VERSION,)
"""All versions this daemon speaks; `describe` and the refusal of any other list them."""

Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[\w.+:/@#-]+$")]
JobId = Annotated[str, Field(min_length=1, max_length=128, description="the caller's idempotency key")]
Px = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]
Um = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]


class Wire(BaseModel):
    """Base of everything on the wire: frozen, nothing unknown."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Request(Wire):
    """What every request carries."""

    v: Literal[1] = Field(default=WIRE_VERSION, description="version of the wire")
    deadline_ms: float | None = Field(
        default=None,
        allow_inf_nan=False,
        description="budget in ms from the request's arrival; from 1e11 on, Unix time in ms",
    )


class JobRequest(Request):
    """A request that starts work on the station."""

    id: JobId
    wait: bool = Field(default=False, description="hold the reply until the result is there")


class Correct(JobRequest):
    """Look, move the tip onto the test point, verify."""

    op: Literal["correct"]
    test_point: Name = Field(description="name of the point over which the head stands, as the board file has it")


class Place(JobRequest):
    """Put the tip over a test point or a place, by the head model and the board's nominal pose, at working height."""

    op: Literal["place"]
    test_point: Name | None = None
    board_um: tuple[Um, Um] | None = Field(default=None, description="instead of a test point: a place, board frame")
    theta_deg: float = Field(default=0.0, ge=0.0, lt=360.0, allow_inf_nan=False, description="head angle")

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


class Calibrate(JobRequest):
    """Teach the probe's tip, or measure the map, the head's rotation, the surface's plane, or the axes' play."""

    op: Literal["calibrate"]
    what: Literal["tip", "map", "rotation", "surface", "backlash"]
    tip_px: tuple[Px, Px] | None = Field(default=None, description="tip: where the needle's end is in the picture")
    test_point: Name | None = Field(
        default=None, description="map, backlash: the round target to look at; none: the control point"
    )
    theta_deg: float = Field(
        default=0.0, ge=0.0, lt=360.0, allow_inf_nan=False, description="map, surface, backlash: head angle"
    )
    angles: int | None = Field(default=None, ge=6, le=1000, description="rotation: so many angles, evenly spread")
    every_deg: float | None = Field(
        default=None, ge=0.5, le=45.0, allow_inf_nan=False, description="rotation: instead, an angle at every so many"
    )
    model: Literal["auto", "fourier", "array", "circle"] = Field(default="auto", description="rotation: what to fit")
    resume: bool = Field(default=True, description="rotation: go on where an interrupted run ended")
    places: int = Field(default=12, ge=4, le=200, description="surface: how many places to touch")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.what == "tip" and self.tip_px is None:
            raise ValueError("what=tip needs tip_px")
        if self.angles is not None and self.every_deg is not None:
            raise ValueError("give either angles or every_deg")
        return self


class Align(JobRequest):
    """See where the board lies: look at three or more fiducials and store the board's pose."""

    op: Literal["align"]
    fiducials: tuple[Name, ...] | None = Field(
        default=None, min_length=3, max_length=50, description="round targets; none: the board's fiducials"
    )
    thetas_deg: tuple[Annotated[float, Field(ge=0.0, lt=360.0, allow_inf_nan=False)], ...] = Field(
        default=(0.0, 180.0), min_length=1, max_length=8, description="head angles from which each is looked at"
    )


class Home(JobRequest):
    """Home all axes; the only request that leaves the fault `not_homed`."""

    op: Literal["home"]


class Cancel(Request):
    """Stop a job safely; without an id, the one that runs."""

    op: Literal["cancel"]
    id: JobId | None = None


class Reset(Request):
    """Clear a latched fault once its cause is gone."""

    op: Literal["reset"]


class Status(Request):
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
    since: int = Field(default=0, ge=0, description="first seq wanted")
    limit: int = Field(default=100, ge=1, le=1000)


class Alerts(Request):
    """Ask what stands against the station and how every watch of its health stands; replay alerts from a seq on."""

    op: Literal["alerts"]
    since: int = Field(default=0, ge=0, description="first seq wanted")
    limit: int = Field(default=100, ge=1, le=1000)


class Report(Request):
    """Tell what the tester saw: the re-test after a job, and touches made since the last report."""

    op: Literal["report"]
    id: JobId | None = Field(default=None, description="the job whose point was tested again")
    retest: Literal["pass", "open"] | None = None
    touches: int = Field(default=0, ge=0, le=10_000_000, description="touches since the last report")


class Acknowledge(Request):
    """Say that a person knows of an alert."""

    op: Literal["acknowledge"]
    alert: Name
    by: str = Field(min_length=1, max_length=64, description="who knows")
    note: str = Field(default="", max_length=500)
    mended: bool = Field(default=False, description="the cause is gone: clear it, and learn anew what is usual")


class Describe(Request):
    """Ask who this station is, what it can do and which test points it knows."""

    op: Literal["describe"]


AnyJob = Correct | Place | Look | Align | Calibrate | Home
AnyRequest = AnyJob | Cancel | Reset | Status | Snapshot | Result | Results | Alerts | Acknowledge | Report | Describe

REQUESTS: TypeAdapter[AnyRequest] = TypeAdapter(Annotated[AnyRequest, Field(discriminator="op")])
OPS: tuple[str, ...] = tuple(
    model.model_fields["op"].annotation.__args__[0]  # type: ignore[union-attr]  # a Literal of one string
    for model in (
        Correct, Place, Look, Align, Calibrate, Home, Cancel, Reset, Status, Snapshot, Result, Results, Alerts,
        Acknowledge, Report, Describe,
    )
)  # fmt: skip


def parse_request(raw: Any) -> AnyRequest:
    """Validate a decoded JSON value; raise `Fault` with every bad field named."""
    if not isinstance(raw, dict):
        raise Fault(FaultCode.BAD_JSON, "the message is not a JSON object", got=type(raw).__name__)
    version = raw.get("v", WIRE_VERSION)
    if type(version) is not int or version not in VERSIONS:
        raise Fault(
            FaultCode.UNSUPPORTED_VERSION, f"version {version!r}"[:200] + " is not spoken here", supported=VERSIONS
        )
    op = raw.get("op")
    if op not in OPS:
        raise Fault(FaultCode.UNKNOWN_OP, f"there is no operation {op!r}"[:200], ops=list(OPS))
    try:
        return REQUESTS.validate_python(raw)
    except ValidationError as exc:
        raise Fault(FaultCode.INVALID_REQUEST, fields=_fields(exc)) from exc


def _fields(error: ValidationError) -> list[dict[str, str]]:
    """List each bad field with its trouble; the op that discriminates the union is no part of the path."""
    return [
        {"field": ".".join(str(p) for p in e["loc"][1:]) or "(message)", "problem": e["msg"]} for e in error.errors()
    ]
