"""Truth of the station: axes, pose, card, lamps, faults; time is an argument."""
