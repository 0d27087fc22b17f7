"""Pure functions: image in, geometry out."""

from vision.annotate import crop, draw_test_points, draw_tip
from vision.circle import View
from vision.controlpoint import Arm, ControlPoint, find_control_point
from vision.notfound import NotFound, Reason
from vision.probe_model import ProbeModel
from vision.rules import RULES, Decided, Hole, SeenObject, Verdict
from vision.testpoint import Seen, TestPoint, find_test_points
from vision.tip import Tip, find_tip

__all__ = [
    "RULES",
    "Arm",
    "ControlPoint",
    "Decided",
    "Hole",
    "NotFound",
    "ProbeModel",
    "Reason",
    "Seen",
    "SeenObject",
    "TestPoint",
    "Tip",
    "Verdict",
    "View",
    "crop",
    "draw_test_points",
    "draw_tip",
    "find_control_point",
    "find_test_points",
    "find_tip",
]
