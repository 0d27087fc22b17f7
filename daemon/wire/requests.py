"""Base of all requests: the wire's version, types of their fields, and what every request carries.

A request is one JSON object `{"v": 1, "op": ..., ...}`; unknown fields are refused by name. The request of each
operation stands beside its row in `daemon.wire.operations`. Lengths are um, angles degrees, times ms, as the names say.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

WIRE_VERSION: Literal[1] = 1
VERSIONS: tuple[int, ...] = (WIRE_VERSION,)
"""All versions this daemon speaks; `describe` and the refusal of any other list them."""

Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[\w.+:/@#-]+$")]
JobId = Annotated[str, Field(min_length=1, max_length=128, description="the caller's idempotency key")]
Px = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]
Um = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]


class Request(BaseModel):
    """What every request carries."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    v: Literal[1] = Field(default=WIRE_VERSION, description="version of the wire")
    deadline_ms: float | None = Field(
        default=None,
        allow_inf_nan=False,
        description="budget in ms from the request's arrival; from 1e11 on, Unix time in ms",
    )


class ImmediateRequest(Request):
    """A request whose answer needs no waiting; it is given on the spot."""


class JobRequest(Request):
    """A request that starts work on the station."""

    id: JobId
    wait: bool = Field(default=False, description="hold the reply until the result is there")
