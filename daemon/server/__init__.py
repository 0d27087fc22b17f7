"""Sockets and who may use them: control, events, keys, rate limits."""
