"""Gantry, lights and camera as one station."""
