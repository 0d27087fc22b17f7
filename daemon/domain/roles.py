"""Who may ask what: three roles, each with all that the one before it may.

observe hears and asks, operate works the station as a tester does, maintain also changes what the station believes:
calibrations, homing, a latched fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, NamedTuple

from daemon.domain.errors import Fault, FaultCode

Role = Literal["observe", "operate", "maintain"]
ROLES: Final[tuple[Role, ...]] = ("observe", "operate", "maintain")
"""Least first."""
LEAST_ROLE: Final[Mapping[str, Role]] = {
    "status": "observe",
    "snapshot": "observe",
    "result": "observe",
    "results": "observe",
    "alerts": "observe",
    "describe": "observe",
    "correct": "operate",
    "place": "operate",
    "look": "operate",
    "align": "operate",
    "cancel": "operate",
    "report": "operate",
    "calibrate": "maintain",
    "home": "maintain",
    "reset": "maintain",
    "acknowledge": "maintain",
}
"""Operation -> the least role that may ask it."""


class Caller(NamedTuple):
    """Who sent a message, as far as the daemon knows."""

    client: str
    """Name of its key; without CURVE, its connection. Queue and rate are shared out by it."""
    role: Role


def least_role(op: str) -> Role:
    """Return the least role that may ask for `op`; what is not listed only `maintain` may."""
    return LEAST_ROLE.get(op, "maintain")


def may(role: Role, op: str) -> bool:
    """Whether a role may ask for an operation."""
    return ROLES.index(role) >= ROLES.index(least_role(op))


def require(caller: Caller, op: str) -> None:
    """Raise `Fault` if the caller may not ask for `op`."""
    if not may(caller.role, op):
        needs = least_role(op)
        raise Fault(FaultCode.NOT_ALLOWED, f"{op} needs the role {needs}, this key has {caller.role}", needs=needs,
                    role=caller.role)  # fmt: skip
