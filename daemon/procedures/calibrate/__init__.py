"""Procedures of the calibrations; start at `dispatch`."""
