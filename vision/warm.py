"""Late imports: what the first look needs and a start does not; a daemon loads it once it is ready.

Imports in functions (LAPACK, special functions) cost a third of the time a process takes to start, and nothing once
they have been done.
"""

from __future__ import annotations

import importlib

LATE = ("scipy.fft", "scipy.linalg.lapack", "scipy.special")


def warm_up() -> None:
    """Load them; from any thread."""
    for name in LATE:
        importlib.import_module(name)
