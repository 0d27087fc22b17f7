"""Camera: its queue, its controls, its socket."""
