"""Frames, maps and cameras: from pixels to micrometres."""
