"""X, Y, Z and theta as one machine."""

from drivers.gantry.contract import (
    AxisCondition,
    AxisSettings,
    GantryAxis,
    GantryConfig,
    Position,
    SelfTest,
    axis_theta_deg,
)
from drivers.gantry.driver import AXES, Gantry

__all__ = [
    "AXES",
    "AxisCondition",
    "AxisSettings",
    "Gantry",
    "GantryAxis",
    "GantryConfig",
    "Position",
    "SelfTest",
    "axis_theta_deg",
]
