"""Interface of the maps from the image to the robot: what each takes and gives (thesis 6.2, 6.3).

Two maps stand behind `ImageMap`: `pose_map` (a planar projective model) and `polar_map` (the thesis' array).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vision.geometry.frames import Array

SAME_ANGLE_DEG = 0.02
"""Head angles nearer to each other than this are one: a stop of the head, read back."""


@dataclass(frozen=True)
class MapPoint:
    """One resting target seen from one head position: pixels and the robot's own coordinates."""

    target_px: tuple[float, float]
    x_um: float
    y_um: float
    theta_deg: float


@dataclass(frozen=True)
class Correction:
    """How far the head has to go, robot frame, um, and how well that is known.

    covariance: (2, 2), um^2, robot frame: what the map's fit and the sight of tip and target leave uncertain. How well
    the axes then stop is not in it: that is `ImageMap.residual_um`, which is mostly the stops' scatter.
    """

    dx_um: float
    dy_um: float
    covariance: Array

    @property
    def distance_um(self) -> float:
        """Length of the way."""
        return math.hypot(self.dx_um, self.dy_um)

    @property
    def sigma_um(self) -> float:
        """Root mean square of the distance by which the way may be wrong: the root of the covariance's trace.

        It is a planar figure, so it compares with the repeatability of the axes and with `residual_um` as they stand.
        """
        return math.sqrt(float(np.trace(self.covariance)))


class ImageMap(Protocol):
    """A map from pixels to the way the head has to go."""

    @property
    def radius_um(self) -> float: ...  # noqa: D102  # the names say it
    @property
    def residual_um(self) -> float: ...  # noqa: D102

    def from_tip_um(
        self, points_px: Array, tip_px: tuple[float, float], theta_deg: float, *, height_um: float = 0.0
    ) -> Array:
        """Return where pixels, (2,) or (N, 2), lie from the place below the tip, robot frame, um; shape as given."""

    def correction(
        self,
        target_px: tuple[float, float],
        tip_px: tuple[float, float],
        theta_deg: float,
        sigma_px: float = 0.1,
        *,
        height_um: float = 0.0,
    ) -> Correction:
        """Return the way that brings the tip onto the target."""


def sightings_px(sightings: Sequence[MapPoint]) -> Array:
    """Return the pixels of sightings, (N, 2)."""
    return np.array([s.target_px for s in sightings], dtype=float).reshape(-1, 2)


def sightings_um(sightings: Sequence[MapPoint]) -> Array:
    """Return the head's places of sightings, (N, 2), robot frame."""
    return np.array([(s.x_um, s.y_um) for s in sightings], dtype=float).reshape(-1, 2)


def angle_groups(thetas_deg: Sequence[float]) -> NDArray[np.intp]:
    """Return for each angle the number of its group, 0 .. G-1; angles within `SAME_ANGLE_DEG` are one group."""
    theta = np.asarray(thetas_deg, dtype=float)
    order = np.argsort(theta, kind="stable")
    steps = np.diff(theta[order]) > SAME_ANGLE_DEG
    groups = np.empty(len(theta), dtype=np.intp)
    groups[order] = np.concatenate([[0], np.cumsum(steps)])[: len(theta)]
    return groups
