"""Jobs of any kind: queue, preconditions, running, ending, what is kept of them."""
