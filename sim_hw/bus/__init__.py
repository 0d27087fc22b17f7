"""Serial line, its frames, and the light relay on it."""
