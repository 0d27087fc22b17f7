"""Search for the probe tip in the white image (TEDA, thesis 5.3)."""

from vision.tip.carried import KnownTip
from vision.tip.find import Tip, find_tip
from vision.tip.probe_model import ProbeModel, probe_outline
from vision.tip.strip import straighten

__all__ = ["KnownTip", "ProbeModel", "Tip", "find_tip", "probe_outline", "straighten"]
