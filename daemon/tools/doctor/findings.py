"""Results of an examination: one line a check, with what to do."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Verdict = Literal["ok", "warn", "fail"]


@dataclass(frozen=True)
class CheckResult:
    """One check: what it was about, how it stands, what was found, what to do."""

    about: str
    verdict: Verdict
    found: str
    advice: str = ""


@dataclass
class CheckResults:
    """All of them, in the order in which they were made."""

    checks: list[CheckResult] = field(default_factory=list)

    def ok(self, about: str, found: str) -> None:
        """Note what is well."""
        self.checks.append(CheckResult(about, "ok", found))

    def warn(self, about: str, found: str, advice: str) -> None:
        """Note what a person should know; the station works."""
        self.checks.append(CheckResult(about, "warn", found, advice))

    def fail(self, about: str, found: str, advice: str) -> None:
        """Note what keeps the station from working."""
        self.checks.append(CheckResult(about, "fail", found, advice))

    def judge(self, about: str, found: str, *, good: bool, advice: str, otherwise: Verdict = "fail") -> None:
        """Note one or the other."""
        self.checks.append(CheckResult(about, "ok" if good else otherwise, found, "" if good else advice))

    @property
    def good(self) -> bool:
        """Tell whether nothing failed."""
        return all(check.verdict != "fail" for check in self.checks)

    def as_json(self) -> dict[str, Any]:
        """Return all of it for machines."""
        return {"ok": self.good, "checks": [asdict(check) for check in self.checks]}
