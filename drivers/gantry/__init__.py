"""X, Y, Z and theta as one machine."""

from drivers.gantry.contract import GantryConfig, Position, axis_theta_deg
from drivers.gantry.driver import AXES, Gantry

__all__ = ["AXES", "Gantry", "GantryConfig", "Position", "axis_theta_deg"]
