"""What is true: axes, pose, needle, lamps, faults; time is an argument."""
