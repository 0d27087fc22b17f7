"""What is said on the sockets: requests, replies, events, keys."""
