"""Search for test points in the red image (TDEA, thesis 5.4)."""

from vision.pads.find import PROBE_MARGIN_PX, Seen, TestPoint, find_test_points
from vision.pads.occlusion import probe_hides
from vision.pads.rule_name import RuleName
from vision.pads.rules import RULES, Decided, Hole, SeenObject, Verdict

__all__ = [
    "PROBE_MARGIN_PX",
    "RULES",
    "Decided",
    "Hole",
    "RuleName",
    "Seen",
    "SeenObject",
    "TestPoint",
    "Verdict",
    "find_test_points",
    "probe_hides",
]
