"""Fault campaign: kills, faults in states, resets and fuzzed messages against a station, judged by the truth."""
