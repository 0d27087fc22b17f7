"""A stepper drive: dictionary, power states, modes, slave."""
