"""The demonstration: simulated station, daemon and tester as three processes, judged by the truth log."""
