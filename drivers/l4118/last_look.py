"""Last look at a drive: what it showed, and when it was asked; what is told to the drive makes it worthless. Pure."""

import math

from drivers.l4118.contract import AxisStatus


class LastLook:
    """Keeps one look, so that nothing is asked twice in one step."""

    def __init__(self) -> None:
        self.at_s = -math.inf
        """When the drive was asked, by the monotonic clock; minus infinity after a forgotten look."""
        self._status: AxisStatus | None = None
        self._forgotten_s = -math.inf

    def note(self, status: AxisStatus, at_s: float) -> None:
        """Keep a look asked for at a time; one that was on its way when the drive was told something is void."""
        if at_s > self._forgotten_s and at_s >= self.at_s:
            self._status, self.at_s = status, at_s

    def forget(self, now_s: float) -> None:
        """Know nothing: something was told to the drive by now."""
        self._status, self.at_s, self._forgotten_s = None, -math.inf, now_s

    def since(self, since_s: float) -> AxisStatus | None:
        """Give the look if it was taken at that time or later."""
        return self._status if self.at_s >= since_s else None
