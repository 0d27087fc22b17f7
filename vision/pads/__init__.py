"""Search for test points in the red image (TDEA, thesis 5.4)."""

from vision.pads.confirm import confirm_pad
from vision.pads.find import PROBE_MARGIN_PX, find_test_points
from vision.pads.occlusion import probe_hides
from vision.pads.rule_name import RuleName
from vision.pads.rules import RULES, Decided, Hole, SeenObject, Verdict
from vision.pads.seen import Seen, TestPoint

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
    "confirm_pad",
    "find_test_points",
    "probe_hides",
]
