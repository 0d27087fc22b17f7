"""Circle through the recorded head positions, and the rigid rotation along it (thesis figure 6.6).

Two questions that are easily taken for one: how round is the record (`fit_circle`, which asks nothing of the angles),
and how well does a perfect head explain it (`fit_rotation`: one radius, angle = theta + constant). Appendix D is round
to 42 um rms and rotates to 117 um rms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.head.model import Array

Complex = NDArray[np.complex128]
LEAST_POINTS = 3


@dataclass(frozen=True)
class HeadCircleFit:
    """A circle through points: centre (x, y), radius, and the rms of the distances from it, um."""

    centre_um: tuple[float, float]
    radius_um: float
    rms_um: float


def fit_circle(x_um: ArrayLike, y_um: ArrayLike) -> HeadCircleFit:
    """Fit a circle to points (N,), (N,): geometric least squares, so that `rms_um` is of radial distances.

    Raises ValueError for fewer than three points, numbers that are not finite, or points on a line.
    """
    from scipy.optimize import least_squares  # noqa: PLC0415  # slow to load, and only calibrations need it

    points = planar(x_um, y_um)
    if len(points) < LEAST_POINTS:
        raise ValueError(f"{len(points)} points; a circle needs at least {LEAST_POINTS}")
    middle = points.mean(axis=0)
    size = float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean()))
    if size == 0:
        raise ValueError("all points are one; turn the head between them")
    near = (points - middle) / size
    # Algebraic start (x^2 + y^2 = 2ax + 2by + c); with three points it is the answer.
    start, _, rank, _ = np.linalg.lstsq(np.c_[2.0 * near, np.ones(len(near))], (near**2).sum(axis=1), rcond=1e-9)
    if rank < LEAST_POINTS:
        raise ValueError("the points lie on a line; turn the head between them")
    first = np.r_[start[:2], np.sqrt(start[2] + start[0] ** 2 + start[1] ** 2)]

    def off(circle: Array) -> Array:
        return np.asarray(np.hypot(*(near - circle[:2]).T) - circle[2], dtype=float)

    fit = least_squares(off, first, method="lm", xtol=1e-14, ftol=1e-14)
    centre = middle + size * fit.x[:2]
    rms = size * float(np.sqrt((off(fit.x) ** 2).mean()))
    return HeadCircleFit((float(centre[0]), float(centre[1])), size * abs(float(fit.x[2])), rms)


def fit_rotation(theta_deg: Array, place: Complex, weight: Array | None = None) -> tuple[complex, complex]:
    """Fit `place = centre + arm exp(i theta)`, both (N,); return (centre, arm) in um as complex numbers."""
    root = np.ones(len(theta_deg)) if weight is None else np.sqrt(weight)
    design = np.c_[np.ones(len(theta_deg)), np.exp(1j * np.radians(theta_deg))]
    centre, arm = np.linalg.lstsq(design * root[:, None], place * root, rcond=None)[0]
    return complex(centre), complex(arm)


def planar(x_um: ArrayLike, y_um: ArrayLike) -> Array:
    """Return x and y as points (N, 2); ValueError for unequal or wrong shapes and numbers that are not finite."""
    x, y = np.asarray(x_um, dtype=float), np.asarray(y_um, dtype=float)
    if x.ndim != 1 or x.shape != y.shape:
        raise ValueError(f"x has shape {x.shape} and y {y.shape}; both must be (N,)")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        bad = int(np.flatnonzero(~(np.isfinite(x) & np.isfinite(y)))[0])
        raise ValueError(f"row {bad} is not finite; measure it again or leave it out")
    return np.column_stack([x, y])
