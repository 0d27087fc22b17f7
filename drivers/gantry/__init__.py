"""X, Y, Z and theta as one machine."""

from drivers.gantry.contract import GantryConfig, Position, axis_theta_deg
from drivers.gantry.driver import Gantry

__all__ = ["Gantry", "GantryConfig", "Position", "axis_theta_deg"]
