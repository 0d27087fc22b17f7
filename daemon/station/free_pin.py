"""Free pin: where the tip is in the picture while nothing pushes it, so that a lift can be seen and not only counted.

A drive that lost steps counts on; a pin that is still pushed in stands higher in the picture than it stood free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vision import ProbeModel, Tip
from vision.geometry import PoseMap

FLEX_WITHIN_UM = 80.0
"""By so much of a push camera and needle may flex from stop to stop: 3.5 sigma."""
BY_MARKING_PX = 1.4
"""So much less well is a tip known along itself, then or now, by its marking alone: four sigma."""
LOST_STEPS_UM = 240.0
"""So much where no board can be is a Z that stands lower than it counts, or a needle that is not the taught one."""


@dataclass(frozen=True)
class FreePin:
    """The tip's place in the picture at one stop of X and Y, free, before a surface is touched below it."""

    model: ProbeModel
    tip_px: tuple[float, float]
    within_px: float
    """A tip this near to it is free."""
    z_um: float
    """Z at which it was seen free."""
    push_px: tuple[float, float] | None = None
    """Which way a push takes it, of length 1; None: a tip that is off in any direction is not free."""
    away_px: tuple[float, float] | None = None
    """The same, of a tip that is known by its marking alone: across, it is known less well."""
    by_marking: bool = False
    """Whether it was so known when it was seen free."""

    @classmethod
    def by_map(
        cls, pose_map: PoseMap, model: ProbeModel, tip_px: tuple[float, float], push_um: float, z_um: float
    ) -> FreePin:
        """Return the place of a tip from which a push of `push_um` would take it away in the picture."""
        lift_px = float(np.linalg.norm(pose_map.below_tip_px))
        x_px, y_px = -np.array(pose_map.below_tip_px) / lift_px
        per_um = lift_px / pose_map.hover_um
        return cls(model, tip_px, push_um * per_um, z_um, away_px=(float(x_px), float(y_px)))

    @classmethod
    def taught(cls, model: ProbeModel, pose_map: PoseMap, z_um: float) -> FreePin:
        """Return where a free tip stands at any stop, as it was taught; a push below the flex cannot be told so."""
        return cls.by_map(pose_map, model, model.tip_px, FLEX_WITHIN_UM, z_um)

    @classmethod
    def where_no_board_is(cls, model: ProbeModel, pose_map: PoseMap, z_um: float) -> FreePin:
        """Return the same for a height that no board reaches: only a large push counts there, and no flex does."""
        free = cls.by_map(pose_map, model, model.tip_px, LOST_STEPS_UM, z_um)
        return replace(free, push_px=free.away_px)

    def shows_free(self, tip: Tip) -> bool:
        """Whether a tip is so near to its free place that nothing pushes it."""
        if (self.by_marking or tip.by_marking) and self.away_px is not None:
            return self._along_px(tip, self.away_px) <= self.within_px + BY_MARKING_PX
        return self.off_px(tip) <= self.within_px

    def off_px(self, tip: Tip) -> float:
        """Return how far a tip is from its free place, the way that a push takes it."""
        if self.push_px is None:
            return math.hypot(tip.x_px - self.tip_px[0], tip.y_px - self.tip_px[1])
        return self._along_px(tip, self.push_px)

    def _along_px(self, tip: Tip, way: tuple[float, float]) -> float:
        return max(0.0, (tip.x_px - self.tip_px[0]) * way[0] + (tip.y_px - self.tip_px[1]) * way[1])
