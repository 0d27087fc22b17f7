"""Pure functions: image in, geometry out."""

from vision.annotate.draw import crop, draw_test_points, draw_tip
from vision.control_point.find import Arm, ControlPoint, find_control_point
from vision.core.image_quality import ImageQuality, measure_quality
from vision.core.not_found import NotFound, Reason
from vision.core.view import View
from vision.geometry.camera_model import Extrinsics, Intrinsics, Plane, back_project, project
from vision.geometry.extrinsics import ExtrinsicsFit, fit_extrinsics
from vision.geometry.orthophoto import Orthophoto, make_orthophoto
from vision.pads.find import Seen, TestPoint, find_test_points
from vision.pads.rules import RULES, Decided, Hole, SeenObject, Verdict
from vision.tip.find import Tip, find_tip
from vision.tip.probe_model import ProbeModel

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
