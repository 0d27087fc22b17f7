"""What the camera sees: board, card, needle, light."""
