"""X, Y, Z and theta as one machine."""

from drivers.gantry.contract import (
    THETA_FIRST_DEG,
    THETA_LAST_DEG,
    Approach,
    AxisCondition,
    AxisSettings,
    ClearHeight,
    GantryAxis,
    GantryConfig,
    Position,
    SelfTest,
    axis_theta_deg,
)
from drivers.gantry.driver import AXES, Gantry

__all__ = [
    "AXES",
    "THETA_FIRST_DEG",
    "THETA_LAST_DEG",
    "Approach",
    "AxisCondition",
    "AxisSettings",
    "ClearHeight",
    "Gantry",
    "GantryAxis",
    "GantryConfig",
    "Position",
    "SelfTest",
    "axis_theta_deg",
]
