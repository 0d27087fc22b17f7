"""What one job does, step by step."""
