"""TDEA: test points in the red frame."""

from vision.pads.find import NEEDLE_MARGIN_PX, Seen, TestPoint, find_test_points
from vision.pads.occlusion import needle_hides
from vision.pads.rule_name import RuleName
from vision.pads.rules import RULES, Decided, Hole, SeenObject, Verdict

__all__ = [
    "NEEDLE_MARGIN_PX",
    "RULES",
    "Decided",
    "Hole",
    "RuleName",
    "Seen",
    "SeenObject",
    "TestPoint",
    "Verdict",
    "find_test_points",
    "needle_hides",
]
