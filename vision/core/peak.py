"""Where a peak lies between samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def parabola(values: NDArray[np.float32], k: int) -> float:
    """Return by how much the top of the parabola through three neighbours lies off the middle one, -0.5..0.5.

    values: (N,); k: the highest of them; one at the rim, or no peak, is not refined.
    """
    if not 0 < k < len(values) - 1:
        return 0.0
    left, middle, right = (float(v) for v in values[k - 1 : k + 2])
    bend = left - 2.0 * middle + right
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0
