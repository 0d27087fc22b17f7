"""Cycle budget: what an operation takes, the floor of its own facts, and where the rest went."""
