"""Machine vision of a probe station: image in, geometry out, by pure functions.

A name is imported from its package when it is first asked for: who wants a transform does not wait for all of it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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
    from vision.pads import RULES, Decided, Hole, Seen, SeenObject, TestPoint, Verdict, confirm_pad, find_test_points
    from vision.tip import KnownTip, ProbeModel, Tip, find_tip

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
    "KnownTip",
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
    "confirm_pad",
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
_NAMES = {
    "vision.annotate": ("crop", "draw_test_points", "draw_tip"),
    "vision.control_point": ("Arm", "ControlPoint", "find_control_point"),
    "vision.core": ("ImageQuality", "NotFound", "Reason", "View", "measure_quality"),
    "vision.geometry": (
        "Extrinsics",
        "ExtrinsicsFit",
        "Intrinsics",
        "Orthophoto",
        "Plane",
        "back_project",
        "fit_extrinsics",
        "make_orthophoto",
        "project",
    ),
    "vision.pads": (
        "RULES",
        "Decided",
        "Hole",
        "Seen",
        "SeenObject",
        "TestPoint",
        "Verdict",
        "confirm_pad",
        "find_test_points",
    ),
    "vision.tip": ("KnownTip", "ProbeModel", "Tip", "find_tip"),
}
_PACKAGES = {name: package for package, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import the package that a name of this face comes from."""
    if name not in _PACKAGES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value = getattr(import_module(_PACKAGES[name]), name)
    return value


def __dir__() -> list[str]:
    """Return what is here, also before it is asked for."""
    return sorted({*globals(), *__all__})
