"""Memory pools of the C library: fewer of them, and memory given back."""

from __future__ import annotations

import ctypes

_M_ARENA_MAX = -8
"""`M_ARENA_MAX` of <malloc.h>."""
ARENAS = 2


def few_arenas() -> None:
    """Tell the C library to share few pools among the threads: each would keep the pictures it once held."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_ARENA_MAX, ARENAS)


def give_back_memory() -> None:
    """Give memory that no picture needs any more back to the system; a few ms, to be called where nothing waits."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
