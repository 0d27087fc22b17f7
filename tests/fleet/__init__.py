"""Records of a fleet over the real engines; `make test-fleet` runs these, and nothing else does."""
