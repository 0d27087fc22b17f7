"""Work on the journal's database, as the rooms that keep a part of it order it."""

from __future__ import annotations

import sqlite3
from collections.abc import Awaitable, Callable
from typing import Protocol, TypeVar

T = TypeVar("T")


class Work(Protocol):
    """Does something with the database, in the thread that owns it; raises `Fault` where the disk fails."""

    def __call__(self, work: Callable[[sqlite3.Connection], T]) -> Awaitable[T]:
        """Do it."""
