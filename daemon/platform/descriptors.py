"""Limit of open files and sockets of this process."""

from __future__ import annotations

import contextlib
import resource

WANTED = 8192
"""A service manager's usual limit is 1024, and every client costs one."""


def raise_limit(wanted: int = WANTED) -> int:
    """Raise the soft limit to `wanted`, or as far as the hard one allows; return what it is now."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        # What a sandbox refuses is lived with: fewer clients are let in.
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    return limit()


def limit() -> int:
    """Return how many files and sockets this process may hold open."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return WANTED if soft == resource.RLIM_INFINITY else soft
