"""Limit of open files and sockets of this process."""

from __future__ import annotations

import contextlib
import resource

WANTED, USUAL = 8192, 1024
"""Descriptors a daemon would like, for every client costs one; and what a service manager gives where nobody asks."""


def raise_limit(wanted: int = WANTED) -> int:
    """Raise the soft limit to `wanted`, or as far as the hard one allows; return what it is now."""
    # What a sandbox refuses is lived with: fewer clients are let in.
    with contextlib.suppress(OSError, ValueError):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        if soft != resource.RLIM_INFINITY and soft < most:
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    return limit()


def limit() -> int:
    """Return how many files and sockets this process may hold open; the usual limit where the system does not tell."""
    try:
        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    except (OSError, ValueError):
        return USUAL
    return WANTED if soft == resource.RLIM_INFINITY else soft
