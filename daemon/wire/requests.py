"""Base of all requests: the wire's version, types of their fields, and what every request carries.

A request is one JSON object `{"v": 1, "op": ..., ...}`; unknown fields are refused by name, and so is a value of
another JSON type than the field's: `true` and `"5000"` are no numbers, `"yes"` is no boolean. The request of each
operation stands beside its row in `daemon.wire.operations`. Lengths are um, angles degrees, times ms, as the names say.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

WIRE_VERSION: Literal[1] = 1
VERSIONS: tuple[int, ...] = (WIRE_VERSION,)
"""All versions this daemon speaks; `describe` and the refusal of any other list them."""

MAX_TAG = 128
"""Letters of a tag at most."""
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[\w.+:/@#-]+$")]
JobId = Annotated[str, Field(min_length=1, max_length=128, description="the caller's idempotency key")]


def whole(value: Any) -> Any:
    """Return a number that is written with a point, but is whole, as JSON has it: `5.0` is an integer."""
    return int(value) if type(value) is float and value.is_integer() else value


Whole = Annotated[int, BeforeValidator(whole)]
Px = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]
LeaseMs = Annotated[float, Field(ge=200, le=30_000, allow_inf_nan=False)]
"""How long a needle is held down without a sign of life from who holds it."""
Um = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]


class Request(BaseModel):
    """What every request carries."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    v: Literal[1] = Field(default=WIRE_VERSION, description="version of the wire")
    # Never written out: it is no part of what is asked, so that the same id with another tag is the same request.
    tag: str | None = Field(
        default=None,
        max_length=MAX_TAG,
        exclude=True,
        description="any text; the answer carries it, so that it can be told apart",
    )
    by: str | None = Field(
        default=None,
        min_length=1,
        max_length=64,
        exclude=True,
        description="the person on whose behalf it is sent; of an order it is written down, see `audit`",
    )
    deadline_ms: float | None = Field(
        default=None,
        allow_inf_nan=False,
        description="budget in ms from the request's arrival; from 1e11 on, Unix time in ms",
    )

    @property
    def only_asks(self) -> bool:
        """Whether it changes nothing although its operation can: then nobody writes it down as an order."""
        return False


class ImmediateRequest(Request):
    """A request whose answer needs no waiting; it is given on the spot."""


class JobRequest(Request):
    """A request that starts work on the station."""

    ENDS_OVER_POINT: ClassVar[Literal["placed", "seen"] | None] = None
    """How a job that succeeded leaves the tip over its test point: by calibration alone, or as a look has shown."""

    ALONE: ClassVar[bool] = False
    """Whether it is refused while anything runs or waits: nobody may queue it."""
    FOR_NEEDLE: ClassVar[bool] = False
    """Whether its test point has to be one that the needle may touch."""
    TOUCHES: ClassVar[bool] = False
    """Whether the needle goes down on a pad in it; then it may be held, lifted and counted."""

    @property
    def held_ms(self) -> float:
        """How long the needle may be held for the tester in all; it is not the job that takes this time."""
        return 0.0

    id: JobId
    wait: bool = Field(default=False, description="hold the reply until the result is there")
