"""Benchmark of registration: frames of the simulated station's artist, boards displaced, turned, missing, dirty."""
