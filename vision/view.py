"""How obliquely the board is seen: the affine map between the picture and the plane of the board.

A circle on the board is an ellipse in the picture whose minor axis lies along the needle. Radii are semi-major px.
"""

from __future__ import annotations

from dataclasses import dataclass

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
        """Return image points at board radius and angle about a centre; angles count in the flattened picture."""
        linear = self.unflattening()
        u, v = radius_px * np.cos(phi_rad), radius_px * np.sin(phi_rad)
        return x_px + linear[0, 0] * u + linear[0, 1] * v, y_px + linear[1, 0] * u + linear[1, 1] * v

    def flattening(self) -> Floats:
        """Return the (2, 2) matrix that turns image offsets into offsets on the board, in semi-major px."""
        return self._stretch(1.0 / self.ratio)

    def unflattening(self) -> Floats:
        """Return the (2, 2) matrix that turns offsets on the board into image offsets."""
        return self._stretch(self.ratio)

    def _stretch(self, factor: float) -> Floats:
        minor = np.array([np.cos(self.minor_rad), np.sin(self.minor_rad)])
        return np.asarray(np.eye(2) + (factor - 1.0) * np.outer(minor, minor))


# Nothing is known of the camera: between a square view and the thesis' oblique one, and either may be true.
UNKNOWN_VIEW = View(ratio=0.935, shape_sigma=0.06)


def ellipse_of(shape: Floats) -> tuple[float, float, float]:
    """Return (semi-major, minor over major, direction of the minor axis in rad) of contour offsets (N, 2) px.

    The least-squares conic x^T A x = 1 about the origin; N >= 3 points that go round it.
    """
    x, y = shape[:, 0], shape[:, 1]
    design = np.stack([x * x, 2.0 * x * y, y * y], axis=1)
    a, b, c = (float(v) for v in np.linalg.solve(design.T @ design, design.sum(axis=0)))
    values, vectors = np.linalg.eigh(np.array([[a, b], [b, c]]))
    least, most = max(float(values[0]), 1e-12), max(float(values[1]), 1e-12)
    direction = float(np.arctan2(vectors[1, 1], vectors[0, 1]))
    return 1.0 / least**0.5, (least / most) ** 0.5, direction % np.pi
