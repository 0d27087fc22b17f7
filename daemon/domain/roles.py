"""Roles of clients, and the caller of a request.

observe hears and asks, operate works the station as a tester does, maintain also changes what the station believes:
calibrations, homing, a latched fault. Each may do all that the one before it may; the least role of an operation is in
its row, `daemon.wire.operations`.
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

Role = Literal["observe", "operate", "maintain"]
ROLES: Final[tuple[Role, ...]] = ("observe", "operate", "maintain")
"""Least first."""


class Caller(NamedTuple):
    """Who sent a message, as far as the daemon knows."""

    client: str
    """Name of its key; without CURVE, its connection. Queue and rate are shared out by it."""
    role: Role
    key: str = ""
    """Name of its key; empty without CURVE, where nobody can be told from another."""
