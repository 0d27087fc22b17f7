"""Active alerts: raised once, kept up to date, acknowledged by a person, cleared when their cause is gone."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, Self

from daemon.maintenance.types import Finding, Severity

Change = Literal["raised", "worse", "acknowledged", "cleared"]


@dataclass(frozen=True)
class Alert:
    """One thing that is wrong. figure, usual, limit are in `unit`; evidence: numbers and job ids, newest last."""

    name: str
    group: str
    what: str
    severity: Severity
    figure: float
    usual: float | None
    limit: float
    unit: str
    rule: str
    since_touches: int
    since_at: str
    evidence: tuple[str, ...]
    advice: str
    raised_at: str
    updated_at: str
    acknowledged: dict[str, str] | None = field(default=None)
    """Who (`by`), when (`at`) and what they said (`note`); None while nobody has."""

    @property
    def message(self) -> str:
        """Say it in a sentence."""
        if not self.unit and self.usual is None:
            return self.what
        unit = f" {self.unit}" if self.unit else ""
        usual = "" if self.usual is None else f", usually {self.usual:.4g}"
        return f"{self.what}: {self.figure:.4g}{unit}{usual}, limit {self.limit:.4g} ({self.rule})"

    def body(self, change: Change) -> dict[str, Any]:
        """Return it as event and journal have it. `raised` is true as long as it stands."""
        return {"raised": change != "cleared", "change": change, "message": self.message, **asdict(self)}

    def to_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {"message": self.message, **asdict(self)}

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Self:
        """Return what `to_dict` wrote; TypeError or KeyError if it is damaged."""
        facts = {key: value for key, value in stored.items() if key != "message"}
        return cls(**{**facts, "evidence": tuple(facts["evidence"])})


@dataclass(frozen=True)
class AlertNews:
    """A change that is to be published and kept."""

    change: Change
    alert: Alert

    @property
    def body(self) -> dict[str, Any]:
        """The event."""
        return self.alert.body(self.change)


class ActiveAlerts:
    """The alerts that stand, by name."""

    def __init__(self) -> None:
        self.standing: dict[str, Alert] = {}

    def find(
        self, name: str, group: str, what: str, unit: str, advice: str, finding: Finding, at: str
    ) -> AlertNews | None:
        """Raise an alert, or bring the one that stands up to date; return what is news: that it is there, or worse."""
        before = self.standing.get(name)
        alert = Alert(
            name=name, group=group, what=what, severity=finding.severity, figure=finding.figure, usual=finding.usual,
            limit=finding.limit, unit=unit, rule=finding.rule, since_touches=finding.since_touches,
            since_at=finding.since_at, evidence=finding.evidence, advice=advice,
            raised_at=before.raised_at if before else at, updated_at=at,
            acknowledged=before.acknowledged if before else None,
        )  # fmt: skip
        if before is not None and replace(alert, updated_at=before.updated_at) == before:
            return None
        self.standing[name] = alert
        if before is None:
            return AlertNews("raised", alert)
        worse = before.severity == "warning" and alert.severity == "serious"
        return AlertNews("worse", alert) if worse else None

    def clear(self, name: str, at: str) -> AlertNews | None:
        """Take an alert away; return that as news, if it stood."""
        alert = self.standing.pop(name, None)
        return AlertNews("cleared", replace(alert, updated_at=at)) if alert is not None else None

    def acknowledge(self, name: str, by: str, note: str, at: str) -> AlertNews | None:
        """Write down that a person knows; return None if there is no such alert."""
        alert = self.standing.get(name)
        if alert is None:
            return None
        self.standing[name] = known = replace(alert, acknowledged={"by": by, "at": at, "note": note}, updated_at=at)
        return AlertNews("acknowledged", known)
