"""Results of jobs and error bodies, as they are stored, published and answered."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from daemon.domain.errors import Fault
from daemon.domain.no_paths import without_paths

StepKind = Literal["look", "move"]
"""What the journal keeps of a job while it goes on; its table takes no other."""


class Told(BaseModel):
    """Base of what the daemon says: frozen; who reads it ignores fields it does not know, for more may be added."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class ErrorBody(Told):
    """One kind of trouble on the wire."""

    code: int
    name: str
    message: str = Field(description="in a sentence, without file paths; the facts stand in `detail`")
    advice: str
    detail: dict[str, Any] = {}

    @classmethod
    def of(cls, fault: Fault) -> ErrorBody:
        """Turn a fault into its wire form."""
        detail = {key: value for key, value in fault.detail.items() if key != "advice"}
        return cls(
            code=fault.kind.code,
            name=fault.kind.wire_name,
            message=without_paths(fault.message),
            advice=without_paths(fault.advice),
            detail=detail,
        )


class JobResult(Told):
    """How a job ended. The same model is journalled, published and answered."""

    id: str
    op: str
    ok: bool
    seq: int = Field(description="number of the `result` event that carried it")
    station: str
    finished_at: str = Field(description="UTC, ISO 8601")
    outcome: str = Field(description="one of the outcomes in the operation's row, or failed")
    test_point: str | None = None
    error_before_um: float | None = None
    error_after_um: float | None = None
    looks: int = 0
    moves: int = 0
    timing_ms: dict[str, dict[str, float]] = Field(
        default={},
        description="state -> what the time went on (motion, bus, light, exposure, software), in ms",
    )
    pictures: str | None = Field(default=None, description="folder of the kept pictures on the station")
    detail: dict[str, Any] = {}
    error: ErrorBody | None = None
