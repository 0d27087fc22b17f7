"""The board that lies on the bench, read from its Gerber files."""
