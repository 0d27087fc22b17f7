"""Pure functions: image in, geometry out."""

from vision.annotate import crop, draw_test_points, draw_tip
from vision.controlpoint import Arm, ControlPoint, find_control_point
from vision.extrinsics import ExtrinsicsFit, fit_extrinsics
from vision.notfound import NotFound, Reason
from vision.orthophoto import Orthophoto, make_orthophoto
from vision.probe_model import ProbeModel
from vision.projection import Extrinsics, Intrinsics, Plane, back_project, project
from vision.quality import ImageQuality, measure_quality
from vision.rules import RULES, Decided, Hole, SeenObject, Verdict
from vision.testpoint import Seen, TestPoint, find_test_points
from vision.tip import Tip, find_tip
from vision.view import View

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
