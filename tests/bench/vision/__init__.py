"""The vision benchmark: our finders and their peers on the same scenes, side by side."""
