"""Free pin: where the tip is in the picture while nothing pushes it, so that a lift can be seen and not only counted.

A drive that lost steps counts on; a pin that is still pushed in stands higher in the picture than it stood free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from vision import ProbeModel, Tip


@dataclass(frozen=True)
class FreePin:
    """The tip's place in the picture at one stop of X and Y, free, before a surface is touched below it."""

    model: ProbeModel
    tip_px: tuple[float, float]
    within_px: float
    """A tip this near to it is free."""
    z_um: float
    """Z at which it was seen free."""

    def off_px(self, tip: Tip) -> float:
        """Return how far a tip is from its free place."""
        return math.dist((tip.x_px, tip.y_px), self.tip_px)
