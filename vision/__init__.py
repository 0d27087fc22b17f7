"""Machine vision of a probe station: image in, geometry out, by pure functions."""

from vision.annotate import crop, draw_test_points, draw_tip
from vision.control_point import Arm, ControlPoint, find_control_point
from vision.core import ImageQuality, NotFound, Reason, View, measure_quality
from vision.geometry import (
    Extrinsics,
    ExtrinsicsFit,
    Intrinsics,
    Orthophoto,
    Plane,
    back_project,
    fit_extrinsics,
    make_orthophoto,
    project,
)
from vision.pads import RULES, Decided, Hole, Seen, SeenObject, TestPoint, Verdict, find_test_points
from vision.tip import ProbeModel, Tip, find_tip

__all__ = [
    "RULES",
    "Arm",
    "ControlPoint",
    "Decided",
    "Extrinsics",
    "ExtrinsicsFit",
    "Hole",
    "ImageQuality",
    "Intrinsics",
    "NotFound",
    "Orthophoto",
    "Plane",
    "ProbeModel",
    "Reason",
    "Seen",
    "SeenObject",
    "TestPoint",
    "Tip",
    "Verdict",
    "View",
    "back_project",
    "crop",
    "draw_test_points",
    "draw_tip",
    "find_control_point",
    "find_test_points",
    "find_tip",
    "fit_extrinsics",
    "make_orthophoto",
    "measure_quality",
    "project",
]
