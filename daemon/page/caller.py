"""Who asks: the session behind a request, the address, and what may be seen without a session."""

from __future__ import annotations

import ipaddress
from collections.abc import Collection
from dataclasses import dataclass

from starlette.requests import HTTPConnection

from daemon.domain.roles import Role
from daemon.page.sessions import Session, Sessions

COOKIE = "reprobe_page"
HERE = ("localhost", "127.0.0.1", "[::1]")


@dataclass(frozen=True)
class Asker:
    """Somebody at a browser."""

    session: Session | None
    address: str
    here: bool
    """At the machine itself: from its own loopback, by its own name, and through no proxy."""
    kiosk: bool
    """May look without a session."""

    @property
    def may_look(self) -> bool:
        """Whether the station is shown."""
        return self.session is not None or self.kiosk

    @property
    def role(self) -> Role | None:
        """What the person may do; None for nothing at all."""
        if self.session is not None:
            return self.session.role
        return "observe" if self.kiosk else None

    @property
    def by(self) -> str:
        """The person, as the daemon writes it down."""
        name = self.session.name if self.session is not None else "nobody"
        return (name if self.here else f"{name} ({self.address})")[:64]


def who_asks(connection: HTTPConnection, sessions: Sessions, *, kiosk: bool, watchers: Collection[str]) -> Asker:
    """Return who asks. `kiosk`: the machine itself, and `watchers`, addresses, may look without a session."""
    address = connection.client.host if connection.client else ""
    host = connection.headers.get("host", "").rpartition(":")[0] or connection.headers.get("host", "")
    proxied = "forwarded" in connection.headers or "x-forwarded-for" in connection.headers
    here = is_loopback(address) and host.lower() in HERE and not proxied
    session = sessions.find(connection.cookies.get(COOKIE))
    return Asker(session, address, here, kiosk and (here or (address in watchers and not proxied)))


def is_loopback(address: str) -> bool:
    """Tell whether an address is this computer's own; a name is not."""
    try:
        return ipaddress.ip_address(address.strip("[]")).is_loopback
    except ValueError:
        return address == "localhost"
