"""Demonstration of the fleet: ten stations, what was planted at them, and the answers that the centre gives."""
