"""Broker: where it is, how it is reached, and what may not be done. Without TLS only on this computer."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import aiomqtt

KEEPALIVE_S = 10
CALL_S = 5.0
QUEUED = 2000
"""Messages that wait to be stored at most; what comes beyond is dropped and sent again."""
AGAIN_S, AGAIN_MOST_S = 0.2, 2.0
"""How soon a lost connection is tried again, first and at most."""
HERE = frozenset({"localhost", "127.0.0.1", "::1"})


class BadConnection(ValueError):
    """A broker or database must not be reached like that; `advice` says what to do."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


@dataclass(frozen=True)
class Broker:
    """Where the broker is; raise `BadConnection` for one that is reached in clear over a network."""

    host: str
    port: int
    ca: Path | None = None
    """Certificate of who signed the broker's; None: no TLS."""
    certificate: Path | None = None
    certificate_key: Path | None = None

    def __post_init__(self) -> None:
        """Check what belongs together."""
        if bool(self.certificate) != bool(self.certificate_key):
            raise BadConnection("a certificate needs its key, and the key its certificate", "give both, or neither")
        if self.ca is None and self.certificate is not None:
            raise BadConnection(
                "a certificate without --ca is used by nobody", "name the file of who signed the broker's by --ca"
            )
        if self.ca is None and not is_here(self.host):
            raise BadConnection(
                f"{self.host} is another computer, and records would go over the network in clear",
                "give --ca, --certificate and --certificate-key",
            )

    @classmethod
    def of(cls, text: str, ca: Path | None, certificate: Path | None, certificate_key: Path | None) -> Broker:
        """Return the broker of HOST or HOST:PORT; raise `BadConnection`."""
        host, colon, port = text.rpartition(":")
        if not colon or text.endswith("]"):
            host, port = text, "1883" if ca is None else "8883"
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise BadConnection(f"{text[:100]!r} is no broker", "write HOST or HOST:PORT, such as broker.plant:8883")
        return cls(host.strip("[]"), int(port), ca, certificate, certificate_key)

    def client(self, identifier: str, will: aiomqtt.Will | None = None) -> aiomqtt.Client:
        """Return a client that is not connected yet; raise `BadConnection` for certificates that cannot be used."""
        return aiomqtt.Client(
            self.host, self.port, identifier=identifier, will=will, protocol=aiomqtt.ProtocolVersion.V5,
            keepalive=KEEPALIVE_S, timeout=CALL_S, max_queued_incoming_messages=QUEUED, clean_start=True,
            tls_context=self._tls(), logger=logging.getLogger("reprobe.mqtt"),
        )  # fmt: skip

    def _tls(self) -> ssl.SSLContext | None:
        if self.ca is None:
            return None
        try:
            context = ssl.create_default_context(cafile=self.ca)
            if self.certificate is not None:
                context.load_cert_chain(self.certificate, self.certificate_key)
        except (OSError, ssl.SSLError) as exc:
            raise BadConnection(
                f"the certificates cannot be used: {exc}", "see that the files are PEM and that this user may read them"
            ) from exc
        return context


def is_here(host: str) -> bool:
    """Whether a host is this computer."""
    try:
        return host in HERE or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@asynccontextmanager
async def connected(client: aiomqtt.Client) -> AsyncIterator[aiomqtt.Client]:
    """Be connected; raise MqttError. Who is told to end meanwhile ends, also where the broker hears no goodbye.

    The task's own count of cancellations would not do: a task group leaves it raised in Python 3.11 (its issue 116720).
    """
    told: asyncio.CancelledError | None = None
    try:
        async with client:
            try:
                yield client
            except asyncio.CancelledError as exc:
                told = exc
                raise
    except aiomqtt.MqttError:
        if told is not None:
            raise told from None
        raise


class Patience:
    """How long to wait before a lost connection is tried again: longer each time, and little after it worked."""

    def __init__(self) -> None:
        self._next_s = AGAIN_S

    def worked(self) -> None:
        """Start again from the shortest wait."""
        self._next_s = AGAIN_S

    def take(self) -> float:
        """Return how long to wait now."""
        now_s = self._next_s
        self._next_s = min(2 * now_s, AGAIN_MOST_S)
        return now_s
