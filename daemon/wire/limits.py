"""Limits of both sockets that no configuration changes."""

from __future__ import annotations

HARD_LIMIT = 16 * 1024 * 1024
"""ZeroMQ drops a peer beyond this without a word; up to it a message is answered with an error."""
MAX_COMMAS, MAX_FIELDS, MAX_LISTED = 2_000, 64, 16
"""What a refusal may cost: of a request with more commas nothing is read, of one with more fields none is looked at,
and of bad fields no more are listed. No good request comes near, with all its texts full of commas."""
GLANCE_BYTES = 2048
"""Of a request that is refused before it is read, one no longer than this is read for its `id` and `tag` all the same:
that costs some 20 us at most."""
MAX_PENDING, MAX_HELD = 1000, 100
"""Replies that may be held at once for clients that wait: for all, and for one."""
EVENT_QUEUE = 1000
"""Events kept for a subscriber that is slow; beyond these it loses events, never the daemon."""
MAX_SEQ = 2**63 - 1
"""Largest event number that the journal can be asked for."""
