"""The station's configuration: its model, and another one while the daemon runs."""
