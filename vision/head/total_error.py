"""Total error of one rotational calibration, for maintenance (thesis eq. 6.7, 6.8, 6.9).

How the equations are read. With eq. 6.7 the error at one angle is the distance between where the head should have
stood with the tip on the control point, x_R, and where it did, x_r,i. Eq. 6.8 sums the squares and takes the root at
the end. Eq. 6.9 says "more specifically" over which angles (the forbidden ones are not there) but prints plain
distances under the root, whose unit would be the root of a micrometre: the square is missing. So both are one number,
`total_um`. It grows with the number of angles, so `rms_um` stands beside it: only that may be compared between
calibrations, and only that is worth a threshold. The thesis does not say what x_R is; take a perfect circle's
positions to judge the mechanics, or an earlier calibration's to see drift (`head_positions_um`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vision.head.circle import planar


@dataclass(frozen=True)
class TotalError:
    """Total error of a calibration, um: root of the sum (eq. 6.8, 6.9) and of the mean of squared distances."""

    total_um: float
    rms_um: float
    worst_um: float


def total_error_um(x_um: ArrayLike, y_um: ArrayLike, reference_um: ArrayLike) -> TotalError:
    """Compare recorded head positions (N,), (N,) with those of a reference, (N, 2) or one place (2,), um.

    Raises ValueError for wrong shapes, no rows, or numbers that are not finite.
    """
    points = planar(x_um, y_um)
    reference = np.asarray(reference_um, dtype=float)
    if len(points) == 0 or reference.shape not in {points.shape, (2,)} or not np.isfinite(reference).all():
        raise ValueError(
            f"{len(points)} rows against a reference of shape {reference.shape}; give one finite place each"
        )
    off = np.hypot(*(points - reference).T)
    total = math.sqrt(float((off**2).sum()))
    return TotalError(total, total / math.sqrt(len(points)), float(off.max()))
