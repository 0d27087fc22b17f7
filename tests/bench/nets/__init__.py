"""Bench of whole boards tested by `probe` and `run`: every verdict is judged by the simulated station's truth log."""
