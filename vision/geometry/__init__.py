"""Transforms, maps and cameras: from pixels to micrometres."""

from vision.geometry.board_alignment import Alignment, align, require_span
from vision.geometry.camera_model import Extrinsics, Intrinsics, Plane, back_project, project
from vision.geometry.constellation import ConstellationMatch, match_near, match_target
from vision.geometry.extrinsics import ExtrinsicsFit, fit_extrinsics
from vision.geometry.frames import Array, Rigid2, rotation
from vision.geometry.homography import jacobian
from vision.geometry.image_map import Correction, MapPoint
from vision.geometry.orthophoto import Orthophoto, make_orthophoto
from vision.geometry.pose_map import PoseMap, fit_pose_map, worst_shrink
from vision.geometry.surface_plane import Surface, fit_plane

__all__ = [
    "Alignment",
    "Array",
    "ConstellationMatch",
    "Correction",
    "Extrinsics",
    "ExtrinsicsFit",
    "Intrinsics",
    "MapPoint",
    "Orthophoto",
    "Plane",
    "PoseMap",
    "Rigid2",
    "Surface",
    "align",
    "back_project",
    "fit_extrinsics",
    "fit_plane",
    "fit_pose_map",
    "jacobian",
    "make_orthophoto",
    "match_near",
    "match_target",
    "project",
    "require_span",
    "rotation",
    "worst_shrink",
]
