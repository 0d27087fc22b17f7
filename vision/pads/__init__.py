"""TDEA: test points in the red frame."""
