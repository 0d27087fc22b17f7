"""Hardware drivers: bytes and volts, nothing of what images mean."""
