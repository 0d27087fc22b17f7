"""Authentication of clients: CURVE with an allow-list, or none where only this computer can connect.

CURVE proves which key a connection has; which role the key has, and whether it still has one, is looked up with every
message, so that a key taken back is refused at once, also on a connection that is open.
"""

from __future__ import annotations

from typing import Any

import structlog
import zmq
import zmq.asyncio
from zmq.auth.asyncio import AsyncioAuthenticator

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.roles import Caller, Role
from daemon.server.keyring import Keyring
from daemon.wire.operations.table import OPERATIONS

HEARTBEAT_MS, DEAD_AFTER_MS = 5_000, 20_000
"""How often a quiet connection is asked for life, and when it is given up."""
log = structlog.get_logger(__name__)


class Authenticator:
    """Protect sockets and tell who sent a message."""

    def __init__(self, role: Role, keyring: Keyring | None = None) -> None:
        """Take the role of everybody without CURVE; with a keyring, keys decide instead."""
        self._role = role
        self._keyring = keyring
        self._authenticator: AsyncioAuthenticator | None = None

    @property
    def curve(self) -> bool:
        """Whether keys are asked for."""
        return self._keyring is not None

    @property
    def removals(self) -> int:
        """How often keys have been taken back so far."""
        if self._keyring is None:
            return 0
        self._keyring.refresh()
        return self._keyring.removals

    def start(self, context: zmq.Context[Any]) -> None:
        """Answer the handshakes of all sockets of this context; to be called before they are bound."""
        if self._keyring is None:
            return
        # It stands on a socket of its own, which belongs to a shadow of the context and is closed by `stop`.
        self._authenticator = AsyncioAuthenticator(zmq.Context(context))
        self._authenticator.configure_curve_callback(credentials_provider=self)
        self._authenticator.start()

    def stop(self) -> None:
        """Answer no more handshakes."""
        if self._authenticator is not None:
            self._authenticator.stop()
            self._authenticator = None

    def protect(self, socket: zmq.Socket[Any]) -> None:
        """Set a socket up before it is bound."""
        if self._keyring is None:
            return
        server = self._keyring.server
        socket.setsockopt(zmq.CURVE_SERVER, 1)
        socket.setsockopt(zmq.CURVE_PUBLICKEY, server.public.encode())
        socket.setsockopt(zmq.CURVE_SECRETKEY, server.secret.encode())
        socket.setsockopt(zmq.HEARTBEAT_IVL, HEARTBEAT_MS)
        socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, DEAD_AFTER_MS)

    def callback(self, domain: str, key: bytes) -> bool:
        """Say whether a key may come in; called for each handshake with the public key in Z85."""
        client = self._keyring.find(key.decode()) if self._keyring is not None else None
        log.info("handshake", domain=domain, client=client.name if client else None, public=key.decode())
        return client is not None

    def refusal(self, name: str, op: str) -> Fault | None:
        """Return why a client that was let in may not have its job `op` run any more; None if it may."""
        if self._keyring is None:
            return None
        client = self._keyring.named(name)
        if client is None:
            return Fault(FaultCode.KEY_REVOKED, f"the key of {name!r} was taken back while the job waited")
        try:
            OPERATIONS.require(Caller(client.name, client.role), op)
        except Fault as fault:
            return fault
        return None

    def caller(self, frame: zmq.Frame, connection: bytes) -> Caller:
        """Return who sent a message; raise `Fault` if its key was taken back."""
        if self._keyring is None:
            return Caller(connection.hex(), self._role)
        public = str(frame.get("User-Id"))
        client = self._keyring.find(public)
        if client is None:
            raise Fault(FaultCode.KEY_REVOKED, public=public)
        return Caller(client.name, client.role, client.name)
