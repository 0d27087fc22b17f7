"""Oblique view of the board: the affine map between the image and the plane of the board.

A circle on the board is an ellipse in the image whose minor axis lies along the probe. Radii are semi-major px.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class View:
    """Hold how obliquely the board is seen: minor over major axis of a circle, direction of the minor axis.

    shape_sigma: how far a pad's own ellipse may differ from that, as a share of its radius (lens, tilt, pad shape).
    """

    ratio: float = 0.87
    minor_rad: float = float(np.arctan2(232.0, 119.0))
    shape_sigma: float = 0.03

    def to_image(self, x_px: float, y_px: float, radius_px: Floats, phi_rad: Floats) -> tuple[Floats, Floats]:
        """Return image points at board radius and angle about a centre; angles count in the flattened image."""
        linear = self.unflattening()
        u, v = radius_px * np.cos(phi_rad), radius_px * np.sin(phi_rad)
        return x_px + linear[0, 0] * u + linear[0, 1] * v, y_px + linear[1, 0] * u + linear[1, 1] * v

    def flattening(self) -> Floats:
        """Return the (2, 2) matrix that turns image offsets into offsets on the board, in semi-major px."""
        return _stretch(self.minor_rad, 1.0 / self.ratio)

    def unflattening(self) -> Floats:
        """Return the (2, 2) matrix that turns offsets on the board into image offsets."""
        return _stretch(self.minor_rad, self.ratio)


@lru_cache(maxsize=64)
def _stretch(along_rad: float, factor: float) -> Floats:
    """Return the matrix (2, 2) that stretches by a factor along a direction."""
    along = np.array([np.cos(along_rad), np.sin(along_rad)])
    matrix: Floats = np.eye(2) + (factor - 1.0) * np.outer(along, along)
    matrix.flags.writeable = False
    return matrix


UNKNOWN_VIEW = View(ratio=0.935, shape_sigma=0.06)
"""Nothing is known of the camera: between a square view and the thesis' oblique one, and either may be true."""


def ellipse_of(matrix: Floats) -> tuple[float, float, float]:
    """Return (semi-major, minor over major, direction of the minor axis in rad) of the unit circle under (2, 2)."""
    (a, b), (c, d) = matrix.tolist()
    xx, xy, yy = a * a + b * b, a * c + b * d, c * c + d * d
    mean, half = (xx + yy) / 2.0, math.hypot((xx - yy) / 2.0, xy)
    most, least = math.sqrt(mean + half), math.sqrt(max(mean - half, 0.0))
    major = 0.5 * math.atan2(2.0 * xy, xx - yy)
    return most, least / max(most, 1e-12), (major + math.pi / 2.0) % math.pi
