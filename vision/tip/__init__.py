"""TEDA: the probe tip in the white frame."""

from vision.tip.find import Tip, find_tip
from vision.tip.probe_model import ProbeModel, needle_outline
from vision.tip.strip import straighten

__all__ = ["ProbeModel", "Tip", "find_tip", "needle_outline", "straighten"]
