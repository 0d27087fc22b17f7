"""Run-out of the head: where the tip is, a perfect circle plus what a real head adds (thesis, appendix D)."""

from __future__ import annotations

import math
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

TIP_RADIUS_UM = 14938.26
"""Distance of the tip from the head's axis and its angle at theta = 0: least-squares circle of appendix D."""
TIP_PHASE_DEG = -3.054

_DATA = Path(__file__).parent / "data" / "head_runout.csv"


@cache
def _table() -> npt.NDArray[np.float64]:
    """Return the residuals, shape (3, N): theta_deg, dx_um, dy_um."""
    return np.loadtxt(_DATA, delimiter=",", skiprows=4, unpack=True)


@lru_cache(maxsize=1024)
def runout_um(theta_deg: float) -> tuple[float, float]:
    """Return the run-out (dx_um, dy_um) in the robot frame at a head angle, periodic, linear between the rows."""
    theta, dx_um, dy_um = _table()
    return (
        float(np.interp(theta_deg, theta, dx_um, period=360.0)),
        float(np.interp(theta_deg, theta, dy_um, period=360.0)),
    )


def tip_offset_um(theta_deg: float, runout_scale: float = 1.0) -> tuple[float, float]:
    """Return the tip's offset from (X, Y) in the robot frame, in um."""
    dx_um, dy_um = runout_um(theta_deg)
    angle = math.radians(theta_deg + TIP_PHASE_DEG)
    return (
        TIP_RADIUS_UM * math.cos(angle) + runout_scale * dx_um,
        TIP_RADIUS_UM * math.sin(angle) + runout_scale * dy_um,
    )
