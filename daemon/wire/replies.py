"""Base of all replies: what every reply carries, and the refusal.

The good reply of each operation stands beside its row in `daemon.wire.operations`. The daemon builds its answers of
these models and nothing else, so that what is documented is what is sent. Fields may be added; none changes its meaning
or is removed within a version.
"""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from daemon.domain.results import ErrorBody
from daemon.wire.requests import WIRE_VERSION


class AnyReply(BaseModel):
    """What every reply carries, good or bad."""

    # Not frozen: the socket fills in `id`, `tag` and `version` on its way out.
    model_config = ConfigDict(extra="ignore")
    ABSENT: ClassVar[frozenset[str]] = frozenset({"id", "tag"})
    """Fields that are left out where they are None."""

    v: Literal[1] = WIRE_VERSION
    id: str | None = Field(default=None, description="the request's id; left out where it had none")
    tag: str | None = Field(default=None, description="the request's tag; left out where it had none")
    version: str = Field(default="", description="of the daemon's program")

    def to_json(self) -> bytes:
        """Return it as one frame."""
        absent = {name for name in self.ABSENT if getattr(self, name) is None}
        return self.model_dump_json(exclude=absent).encode()


class Reply(AnyReply):
    """A good reply."""

    ok: Literal[True] = True


class Refusal(AnyReply):
    """The request was not carried out; the reason has a stable code and name."""

    ok: Literal[False] = False
    error: ErrorBody
