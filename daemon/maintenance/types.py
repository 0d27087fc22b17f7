"""Points and findings: what goes into a watch and what comes out of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, Self

Severity = Literal["warning", "serious"]


@dataclass(frozen=True, slots=True)
class Point:
    """One number, when it was measured (touches so far, UTC) and by which job; without a job, by a look at devices."""

    value: float
    touches: int
    at: str
    job: str = ""


@dataclass(frozen=True, slots=True)
class Finding:
    """What a watch found: the figure that is wrong beside what was usual and what would have been allowed.

    rule: by what it was found, in words. since_touches, since_at: where the change seems to have begun.
    evidence: the numbers or job ids it rests on, newest last.
    """

    rule: str
    figure: float
    usual: float | None
    limit: float
    severity: Severity
    since_touches: int
    since_at: str
    evidence: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Self:
        """Return what `to_dict` wrote."""
        return cls(**{**stored, "evidence": tuple(stored["evidence"])})


@dataclass(frozen=True, slots=True)
class WatchState:
    """How a watch stands: how much it has learned (0..1), the present figure, the usual one and the limits."""

    learned: float
    figure: float | None
    usual: float | None
    low: float | None
    high: float | None
