"""The control point: the four-arm calibration mark (appendix C)."""

from vision.control_point.find import Arm, ControlPoint, find_control_point

__all__ = ["Arm", "ControlPoint", "find_control_point"]
