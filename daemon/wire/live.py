"""Live pictures: what a message of the live socket says. They have no `seq`, and no place in the journal."""

from __future__ import annotations

from typing import Final

from pydantic import Field

from daemon.domain.results import Told

TOPIC: Final = b"frame"
"""First frame of each message; then the header as JSON, then the picture, JPEG."""


class LiveAim(Told):
    """What the last look showed of target and needle, px of the picture; told until the head moves."""

    at_px: tuple[float, float] = Field(description="the place on the board below the needle's end")
    target_px: tuple[float, float]
    tolerance_px: float = Field(description="radius about the target within which a landing is good")
    off_um: float = Field(description="between both places")


class LiveHeader(Told):
    """What stands beside a live picture; coordinates are its own: x right, y down, pixel centres at integers."""

    n: int = Field(description="counts the pictures published since the daemon started")
    exposed_at: str = Field(description="UTC, ISO 8601: when the exposure began")
    width_px: int
    height_px: int
    state: str = Field(description="of the station: idle, look and so on")
    tip_px: tuple[float, float] | None = Field(description="where the needle's end was taught; null if it was not")
    aim: LiveAim | None = Field(default=None, description="null where no look since the last move has shown a target")
