"""Occlusion by the probe: a pad behind it cannot be expected to be seen."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.tip import Tip, probe_outline

HIDDEN_SHARE = 0.2
"""A pad of which the probe covers this much need not be found."""
OUTLINE_MARGIN_PX = 3.0
_RINGS = (0.0, 0.35, 0.7, 1.0)
_SPOKES = 12


def probe_hides(tip: Tip, places_px: ArrayLike, radius_px: float) -> list[bool]:
    """Tell for each place (N, 2) px whether the probe covers a good part of a pad of `radius_px` there."""
    outline = probe_outline((tip.x_px, tip.y_px), tip.angle_rad, tip.shape, OUTLINE_MARGIN_PX).astype(np.float32)
    spots = np.array(
        [
            (radius_px * r * math.cos(a), radius_px * r * math.sin(a))
            for r in _RINGS
            for a in np.linspace(0.0, 2.0 * math.pi, _SPOKES, endpoint=False)
        ]
    )
    return [_covered(outline, place + spots) >= HIDDEN_SHARE for place in np.asarray(places_px, float).reshape(-1, 2)]


def _covered(outline: NDArray[np.float32], spots: NDArray[np.float64]) -> float:
    """Return the share of spots inside the outline."""
    inside = [cv2.pointPolygonTest(outline, (float(x), float(y)), measureDist=False) >= 0 for x, y in spots]
    return sum(inside) / len(inside)
