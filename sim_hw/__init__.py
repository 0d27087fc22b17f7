"""Simulated station that is reached by the real wires only."""
