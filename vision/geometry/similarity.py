"""Similarity transform: a turn, a scale and a shift of the plane, fitted by least squares (thesis eq. 3.23)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vision.geometry.camera_model import check_points
from vision.geometry.frames import Array


@dataclass(frozen=True)
class Similarity2:
    """A turn, a scale and a shift of the plane: `x' = c x - s y + tx, y' = s x + c y + ty` (eq. 3.23).

    rms: root mean square of the distances that the fit left, in the unit of the targets.
    """

    c: float
    s: float
    tx: float
    ty: float
    rms: float

    @property
    def theta_deg(self) -> float:
        """Return the turn, counter-clockwise where y points up."""
        return math.degrees(math.atan2(self.s, self.c))

    @property
    def scale(self) -> float:
        """Return the factor of lengths; 1 for a rigid transformation."""
        return math.hypot(self.c, self.s)

    def apply(self, points: ArrayLike) -> Array:
        """Map points, (2,) or (N, 2)."""
        p = check_points(points, "points", 2)
        return np.asarray(p @ [[self.c, self.s], [-self.s, self.c]] + (self.tx, self.ty))

    def inverse(self) -> Similarity2:
        """Return the transform the other way; its rms is in the unit of the points. ValueError if all became one."""
        square = self.c**2 + self.s**2
        if not square > 0.0:
            raise ValueError("a similarity of scale 0 has no way back; fit it to points that differ")
        c, s = self.c / square, -self.s / square
        tx, ty = -c * self.tx + s * self.ty, -s * self.tx - c * self.ty
        return Similarity2(c, s, tx, ty, self.rms / math.sqrt(square))


def fit_similarity(points: ArrayLike, targets: ArrayLike) -> Similarity2:
    """Fit eq. 3.23 (A x = b for c, s, tx, ty) to pairs, (N, 2) each; least squares, no outlier rejection.

    c and s are free in eq. 3.23, so it finds a scale as well; a scale that is not 1 between two um frames says that one
    of them is wrong. Both frames must have the same handedness. Raises ValueError if the arrays do not pair up, are not
    finite, or are fewer than two different points.
    """
    a, b = check_points(points, "points", 2), check_points(targets, "targets", 2)
    if a.ndim != 2 or a.shape != b.shape or len(a) < 2:
        raise ValueError(f"points and targets must be two or more pairs, shape (N, 2), got {a.shape} and {b.shape}")
    with np.errstate(over="ignore", invalid="ignore"):
        mean = a.mean(axis=0)
        x, y = (a - mean).T
        spread = float(np.hypot(x, y).max())
        if not 1e-9 < spread < 1e100 or not np.abs(b).max() < 1e100:
            raise ValueError("points must differ, and no coordinate may be beyond all bounds")
        one, zero = np.ones_like(x), np.zeros_like(x)
        system = np.vstack([np.column_stack([x, -y, one, zero]), np.column_stack([y, x, zero, one])])
        c, s, tx, ty = np.linalg.lstsq(system / (spread, spread, 1, 1), b.T.ravel(), rcond=None)[0]
    c, s = float(c / spread), float(s / spread)
    found = Similarity2(c, s, float(tx - c * mean[0] + s * mean[1]), float(ty - s * mean[0] - c * mean[1]), 0.0)
    rms = float(np.sqrt(((found.apply(a) - b) ** 2).sum(axis=1).mean()))
    return Similarity2(c, s, found.tx, found.ty, rms)
