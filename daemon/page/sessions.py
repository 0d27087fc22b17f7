"""Sessions of people who are logged in, in memory: a restart of the page logs everybody out."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable
from dataclasses import dataclass

from daemon.domain.roles import Role
from daemon.page.people import User, Users

IDLE_S, IDLE_HERE_S, LONGEST_S = 30 * 60.0, 10 * 60.0, 12 * 3600.0
"""A session ends after so long without an act of the person, at the machine itself sooner, and in any case."""
MAX_SESSIONS = 200


@dataclass
class Session:
    """A person who is logged in."""

    name: str
    role: Role
    token: str
    """What each order has to carry, so that no other site can give one."""
    here: bool
    began_s: float
    acted_s: float


class Sessions:
    """Sessions by the cookie's value, of which only a digest is kept."""

    def __init__(self, users: Users, clock: Callable[[], float]) -> None:
        self._users, self._clock = users, clock
        self._open: dict[str, Session] = {}

    def begin(self, user: User, *, here: bool) -> tuple[str, Session]:
        """Begin one and return its cookie's value; with too many open, the one quiet for longest ends."""
        self._sweep()
        if len(self._open) >= MAX_SESSIONS:
            del self._open[min(self._open, key=lambda key: self._open[key].acted_s)]
        value, now = secrets.token_urlsafe(32), self._clock()
        session = Session(user.name, user.role, secrets.token_urlsafe(24), here, now, now)
        self._open[_key(value)] = session
        return value, session

    def find(self, value: str | None) -> Session | None:
        """Return the session of a cookie; None if it is over, or if the person is gone or has another role now."""
        session = self._open.get(_key(value)) if value else None
        if session is None:
            return None
        user = self._users.find(session.name)
        if self.left_s(session) <= 0 or user is None or user.role != session.role:
            self.end(value)
            return None
        return session

    def left_s(self, session: Session) -> float:
        """Return how long a session lasts yet if its person does nothing."""
        now, idle_s = self._clock(), IDLE_HERE_S if session.here else IDLE_S
        return min(session.acted_s + idle_s, session.began_s + LONGEST_S) - now

    def acted(self, session: Session) -> None:
        """Note that the person did something."""
        session.acted_s = self._clock()

    def end(self, value: str | None) -> None:
        """End one."""
        if value:
            self._open.pop(_key(value), None)

    def _sweep(self) -> None:
        self._open = {key: session for key, session in self._open.items() if self.left_s(session) > 0}


def _key(value: str) -> str:
    return hashlib.sha256(value.encode()).hexdigest()
