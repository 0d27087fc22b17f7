"""Wide view: what was learned of a pose map's far parts, as long as that map is in force.

A look from another height sees the board larger or smaller, which the map leaves out: 0.4 mm are 0.7 % of a camera's
distance of 60 mm, and 30 um at the rim of what registration compares. So each height has its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from vision.geometry import Array, PoseMap

SAME_HEIGHT_UM = 50.0
"""Less than a thousandth of a camera's distance: 4 um at the rim of what is compared."""
HEIGHTS_KEPT = 16


@dataclass(frozen=True, eq=False)
class Bend:
    """By which homography, px to px, the far parts of the picture differ from the map.

    height_um: of the surface below the tip that was seen, as the pose map counts it.
    """

    homography: Array
    height_um: float

    def holds_at(self, height_um: float) -> bool:
        """Whether it was learned from as high; from elsewhere it is only nearer to the truth than none."""
        return abs(self.height_um - height_um) <= SAME_HEIGHT_UM


@dataclass
class WideView:
    """Remember the bends of the map in force. Used from the event loop alone."""

    _pose_map: PoseMap | None = None
    _bends: list[Bend] = field(default_factory=list)

    def of(self, pose_map: PoseMap, height_um: float) -> Bend | None:
        """Return the bend of this map that was learned nearest to a height; None where none was learned."""
        known = self._bends if self._pose_map is pose_map else []
        return min(known, key=lambda bend: abs(bend.height_um - height_um), default=None)

    def learned(self, pose_map: PoseMap, bend: Bend) -> None:
        """Keep it, instead of what was known at its height; another map's are forgotten."""
        known = self._bends if self._pose_map is pose_map else []
        others = [one for one in known if not one.holds_at(bend.height_um)]
        self._pose_map, self._bends = pose_map, [*others[1 - HEIGHTS_KEPT :], bend]
