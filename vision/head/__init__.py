"""The tip on the turning head."""
