"""The control point: the four-arm calibration mark (appendix C)."""
