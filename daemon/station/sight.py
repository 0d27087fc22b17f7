"""Sight: what a look showed last of target and needle, in the picture; it holds while the head stands."""

from __future__ import annotations

from typing import NamedTuple


class Sight(NamedTuple):
    """Where the target was seen, and where the needle would come down; px, pixel centres at integers."""

    at_px: tuple[float, float]
    """The place on the board below the needle's end."""
    target_px: tuple[float, float]
    tolerance_px: float
    """Radius about the target within which a landing is good."""
    off_um: float
    since_s: float
    """When the look's first exposure began, monotonic: an earlier picture shows the head elsewhere."""
