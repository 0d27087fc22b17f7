"""Free pin: where the tip is in the picture while nothing pushes it, so that a lift can be seen and not only counted.

A drive that lost steps counts on; a pin that is still pushed in stands higher in the picture than it stood free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vision import ProbeModel, Tip
from vision.geometry import PoseMap

FLEX_WITHIN_UM = 80.0
"""By so much of a push camera and needle may flex from stop to stop: 3.5 sigma."""


@dataclass(frozen=True)
class FreePin:
    """The tip's place in the picture at one stop of X and Y, free, before a surface is touched below it."""

    model: ProbeModel
    tip_px: tuple[float, float]
    within_px: float
    """A tip this near to it is free."""
    z_um: float
    """Z at which it was seen free."""

    @classmethod
    def by_map(
        cls, pose_map: PoseMap, model: ProbeModel, tip_px: tuple[float, float], push_um: float, z_um: float
    ) -> FreePin:
        """Return the place of a tip from which a push of `push_um` would take it away in the picture."""
        per_um = float(np.linalg.norm(pose_map.below_tip_px)) / pose_map.hover_um
        return cls(model, tip_px, push_um * per_um, z_um)

    @classmethod
    def taught(cls, model: ProbeModel, pose_map: PoseMap, z_um: float) -> FreePin:
        """Return where a free tip stands at any stop, as it was taught; a push below the flex cannot be told so."""
        return cls.by_map(pose_map, model, model.tip_px, FLEX_WITHIN_UM, z_um)

    def off_px(self, tip: Tip) -> float:
        """Return how far a tip is from its free place."""
        return math.dist((tip.x_px, tip.y_px), self.tip_px)
