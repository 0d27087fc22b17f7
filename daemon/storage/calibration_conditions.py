"""Conditions of a calibration: the heights, the nominal pose and the board for which it was measured.

What was measured under other conditions is not used, with the reason. A record that does not say its conditions is of
an older version and is used; it says them as soon as it is made again.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Literal

from pydantic import BaseModel, ConfigDict

FUTURE_TOLERANCE = timedelta(minutes=5)
"""What clocks may differ by."""
AHEAD = "dated in the future"
SAME_UM, SAME_DEG = 1.0, 0.001
OF_THE_HEIGHT = frozenset({"map", "rotation", "surface", "alignment"})
"""Kinds whose lengths hold for one touching plane."""
OF_THE_BOARD = frozenset({"surface", "alignment"})
"""Kinds that were measured on one board at its place."""


class Conditions(BaseModel):
    """What a station is set to: lengths in um, robot frame; the angle in degrees."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    touch_z_um: float
    origin_x_um: float
    origin_y_um: float
    rotation_deg: float
    board: str
    side: Literal["top", "bottom"]
    board_revision: str
    """Fingerprint of what the board file holds."""

    def against(self, what: str, made: Conditions) -> str | None:
        """Return why a record of a kind, measured under other conditions, is not used here; None if it is."""
        if what in OF_THE_HEIGHT and abs(made.touch_z_um - self.touch_z_um) > SAME_UM:
            planes = f"{made.touch_z_um:.0f} um, now it is at {self.touch_z_um:.0f} um"
            return f"it was measured for the touching plane at {planes}"
        if what not in OF_THE_BOARD:
            return None
        if (made.board, made.side) != (self.board, self.side):
            return f"it is of board {made.board} ({made.side}), now it is {self.board} ({self.side})"
        if made.board_revision != self.board_revision:
            return f"it was measured with another revision of the board file of {self.board}"
        moved_um = max(abs(made.origin_x_um - self.origin_x_um), abs(made.origin_y_um - self.origin_y_um))
        if moved_um > SAME_UM or abs(made.rotation_deg - self.rotation_deg) > SAME_DEG:
            return f"it was measured for another nominal pose of the board (moved by {moved_um:.0f} um)"
        return None


def dated_in_the_future(made_at: str) -> str | None:
    """Return why a date cannot be right; None if it can. ValueError if it is no date."""
    made = datetime.fromisoformat(made_at)
    made = made if made.tzinfo is not None else made.replace(tzinfo=UTC)
    if made > datetime.now(UTC) + FUTURE_TOLERANCE:
        return f"it is {AHEAD} ({made_at}): set the clock, then `reset`, or calibrate again"
    return None
