"""Stand of the head: over which point it was put, by whom, and whether the eye has seen the point below the tip.

A place is a stand as long as the head has not moved since, but straight up and down; the drives tell. A press uses the
look up: before the next press at the point somebody looks again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from daemon.domain.errors import Fault, FaultCode
from drivers.gantry import Position

STILL_UM, STILL_DEG = 2.0, 0.05
"""What axes at rest may report beside the place to which they came; 0.05625 deg is the head's step."""


@dataclass(frozen=True)
class _Stand:
    """Where the head was put."""

    point: str
    key: str
    position: Position
    seen: bool
    at_s: float
    beside_um: float | None = None
    """So far beside the tip the point was seen, where that is too far to touch it."""


class Stand:
    """Of one station, over reloads of its configuration."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._known: _Stand | None = None

    def came(self, point: str, key: str, position: Position, *, seen: bool) -> None:
        """Hear that a client put the head over a point; `seen`: a look has just shown the point below the tip."""
        self._known = _Stand(point, key, position, seen, self._now_s())

    def pressed(self) -> None:
        """Hear of a press: what was seen before it counts no longer."""
        if self._known is not None:
            self._known = replace(self._known, seen=False)

    def beside(self, point: str, away_um: float) -> None:
        """Hear that a look has shown a point too far beside the tip to be touched."""
        if self._known is not None and self._known.point == point:
            self._known = replace(self._known, seen=False, beside_um=away_um)

    def refused(self, point: str) -> None:
        """Hear that a look for a point has not shown it: nobody knows any more that the head stands over it."""
        if self._known is not None and self._known.point == point:
            self.forget()

    def forget(self) -> None:
        """Hear that nobody knows where the head stands."""
        self._known = None

    def require(self, point: str, key: str, here: Position, within_s: float) -> bool:
        """Return whether the point was seen below the tip since its last press; raise `Fault` if the head is elsewhere.

        Raises `Fault` (look_needed) too where a look has shown the point beside the tip.

        `here`: where the drives say the head is. `within_s`: so long ago it may have come at most.
        """
        known = self._known
        if known is None or known.point != point:
            raise _not_there(f"nobody put the head over {point}")
        if known.key != key:
            raise _not_there(f"another client put the head over {point}")
        away_um = math.dist((known.position.x_um, known.position.y_um), (here.x_um, here.y_um))
        turned_deg = abs((here.theta_deg - known.position.theta_deg + 180.0) % 360.0 - 180.0)
        if away_um > STILL_UM or turned_deg > STILL_DEG:
            raise _not_there(f"the head has moved since it was put over {point} ({away_um:.0f} um)")
        age_s = self._now_s() - known.at_s
        if age_s > within_s:
            raise _not_there(f"the head was put over {point} {age_s:.0f} s ago, and {within_s:g} s are allowed")
        if known.beside_um is not None:
            raise Fault(FaultCode.LOOK_NEEDED, f"{point} was seen {known.beside_um:.0f} um beside the tip")
        return known.seen


def _not_there(why: str) -> Fault:
    return Fault(FaultCode.NOT_AT_TEST_POINT, why, advice="send `place` or `correct` for it first")
