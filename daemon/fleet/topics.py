"""Topics of the fleet at the MQTT broker: one branch a station, by site, line and name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

ROOT = "reprobe/v1"
RESERVED = frozenset("/+#$\0")
MAX_NAME = 64
Leaf = Literal["records", "stored", "state"]
"""Upward: batches of records; how far they are stored, downward and retained; how the station is, retained."""


class BadName(ValueError):
    """A site, line or station has a name that no topic can bear; `advice` says what to do."""

    advice = "use up to 64 letters, none of them / + # or $"


@dataclass(frozen=True, order=True)
class StationPath:
    """Which station; raise `BadName` for a name that no topic can bear."""

    site: str
    line: str
    station: str

    def __post_init__(self) -> None:
        """Check the three names."""
        for what, name in (("site", self.site), ("line", self.line), ("station", self.station)):
            if not 0 < len(name) <= MAX_NAME or RESERVED & set(name) or not name.isprintable():
                raise BadName(f"{name[:80]!r} cannot be the name of a {what} at a broker")

    def topic(self, leaf: Leaf) -> str:
        """Return one of its topics."""
        return f"{ROOT}/{self.site}/{self.line}/{self.station}/{leaf}"

    @classmethod
    def of(cls, topic: str) -> Self:
        """Return the station of a topic; raise `BadName` if it is of none."""
        parts = topic.split("/")
        if len(parts) != 6 or "/".join(parts[:2]) != ROOT:
            raise BadName(f"{topic[:200]!r} is no topic of a station")
        return cls(*parts[2:5])


def everywhere(leaf: Leaf) -> str:
    """Return the pattern that matches one topic of every station."""
    return f"{ROOT}/+/+/+/{leaf}"
