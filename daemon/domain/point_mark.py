"""Mark of a point: a person forbids it to the needle, or approves it again, and says why."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import Told

Mark = Literal["forbidden", "approved"]


class PointMark(Told):
    """What counts of a point now."""

    point: str
    mark: Mark
    reason: str
    by: str
    at: str = Field(description="UTC, ISO 8601")

    @property
    def forbids(self) -> bool:
        """Whether the needle must not touch the point."""
        return self.mark == "forbidden"

    def refuse(self) -> None:
        """Raise `Fault` where it forbids the point."""
        if self.forbids:
            raise Fault(
                FaultCode.POINT_FORBIDDEN, f"{self.point} was forbidden by {self.by}: {self.reason}",
                test_point=self.point, by=self.by, reason=self.reason, at=self.at,
            )  # fmt: skip
