"""TEDA: the probe tip in the white frame."""
