"""Mutation testing: random small faults in the core files, and whether each file's own tests catch them."""
