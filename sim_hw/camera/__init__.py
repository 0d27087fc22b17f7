"""The camera: its queue, its controls, its socket."""
