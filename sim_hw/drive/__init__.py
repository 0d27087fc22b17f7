"""Stepper drive: dictionary, power states, modes, slave."""
