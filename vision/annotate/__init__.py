"""Pictures for people: what was seen, drawn over the frame."""
