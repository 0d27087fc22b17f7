"""Pure functions: image in, geometry out."""
