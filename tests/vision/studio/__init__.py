"""Independent renderers of camera frames with known truth, to judge detectors on scenes they were not tuned on."""
