"""Check of a figure against a known limit: ages, lives, a drive's warning."""

from __future__ import annotations

from typing import Any, Self

from daemon.maintenance.types import Finding, Point, Severity, WatchState


class Limit:
    """Hold one figure against two limits: from `warn` on it is told, from `serious` on it is serious."""

    def __init__(self, rule: str) -> None:
        self._rule = rule
        self.restart()

    def restart(self) -> None:
        """Forget the figure."""
        self.finding: Finding | None = None
        self._figure: float | None = None
        self._warn: float | None = None

    def feed(self, point: Point, warn: float, serious: float, evidence: tuple[str, ...] = ()) -> None:
        """Take the present figure."""
        self._figure, self._warn = point.value, warn
        if point.value < warn:
            self.finding = None
            return
        severity: Severity = "serious" if point.value >= serious else "warning"
        before = self.finding
        self.finding = Finding(
            rule=self._rule,
            figure=point.value,
            usual=None,
            limit=warn,
            severity=severity,
            since_touches=before.since_touches if before else point.touches,
            since_at=before.since_at if before else point.at,
            evidence=evidence,
        )

    @property
    def standing(self) -> WatchState:
        """How it stands."""
        return WatchState(0.0 if self._figure is None else 1.0, self._figure, None, None, self._warn)

    def to_dict(self) -> dict[str, Any]:
        """Return all it knows, for JSON."""
        return {
            "figure": self._figure,
            "warn": self._warn,
            "finding": self.finding.to_dict() if self.finding else None,
        }

    @classmethod
    def from_dict(cls, rule: str, stored: dict[str, Any]) -> Self:
        """Return a limit as it was kept."""
        limit = cls(rule)
        limit._figure, limit._warn = stored["figure"], stored["warn"]
        limit.finding = Finding.from_dict(stored["finding"]) if stored["finding"] else None
        return limit
