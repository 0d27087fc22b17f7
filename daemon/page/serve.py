"""Serving the page: what it may be bound to, and the process around the application."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import uvicorn
import zmq.asyncio

from daemon.domain.roles import ROLES, Role
from daemon.page.app import Page, Settings, make_app
from daemon.page.ask import Ask
from daemon.page.caller import HERE, is_loopback
from daemon.page.hub import Hub
from daemon.page.people import USERS_FILE, Users
from daemon.wire.curve_keys import PrivateKey, read_private

GRACE_S = 1
CREDENTIALS = "CREDENTIALS_DIRECTORY"
"""Environment variable by which systemd names the folder of keys."""
KEY_NAMES: Mapping[Role, str] = {role: f"page-{role}" for role in ROLES}
"""Of the page's keys, one a role, so that the daemon itself refuses what a role may not."""


class BadServing(ValueError):
    """The page must not be served like that; `advice` says what to do."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


@dataclass(frozen=True)
class Serving:
    """How the page is served."""

    station: str
    """Control socket of the daemon."""
    keys: Path | None
    """Folder with the page's three private keys; None where the daemon asks for none."""
    state: Path
    """Folder of the users' file."""
    host: str = "127.0.0.1"
    port: int = 8460
    names: tuple[str, ...] = ()
    """More names by which browsers call it, such as those of a proxy."""
    certificate: Path | None = None
    certificate_key: Path | None = None
    kiosk: bool = False
    watchers: tuple[str, ...] = ()

    @property
    def url(self) -> str:
        """Address for a browser on this computer."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.certificate else 'http'}://{host}:{self.port}/"

    def all_names(self) -> tuple[str, ...]:
        """Return every value of Host that is taken."""
        bare = {*self.names}
        with_port = {f"{name}:{self.port}" for name in (*HERE, *self.names)}
        own = {f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"}
        return tuple(sorted(bare | with_port | own))


def refuse_unsafe(serving: Serving, users: Users) -> None:
    """Raise `BadServing` for an address that others reach without TLS, or where nobody could log in."""
    if bool(serving.certificate) != bool(serving.certificate_key):
        raise BadServing("a certificate needs its key, and the key its certificate", "give both, or neither")
    if is_loopback(serving.host):
        return
    if serving.certificate is None:
        raise BadServing(
            f"{serving.host} is reached from outside, and passwords would go over the wire in clear",
            "give --certificate and --certificate-key, or listen on 127.0.0.1 behind a proxy with TLS (--name)",
        )
    if not users.all():
        raise BadServing("nobody could log in", "add somebody first: reprobe page user add NAME --role operate")


def read_keys(folder: Path | None) -> dict[Role, PrivateKey] | None:
    """Return the page's keys by role; raise `KeyTrouble` if one cannot be used.

    None where the daemon asks for none: no folder is given, or systemd hands over an empty one.
    """
    if folder is None:
        return None
    by_system = str(folder) == os.environ.get(CREDENTIALS)
    # systemd puts the name of the folder it took them from before each.
    files = {role: folder / f"{'page_' if by_system else ''}{name}.key" for role, name in KEY_NAMES.items()}
    if by_system and not any(file.exists() for file in files.values()):
        return None
    return {role: read_private(file, kept_by_system=by_system and file.exists()) for role, file in files.items()}


async def serve(serving: Serving) -> None:
    """Serve until SIGTERM or Ctrl-C; raise `BadServing`, `KeyTrouble`, or OSError if that cannot be."""
    users = Users(serving.state / USERS_FILE)
    refuse_unsafe(serving, users)
    keys = read_keys(serving.keys)
    listening = _listen(serving)
    context = zmq.asyncio.Context()
    ask = Ask(context, serving.station, keys)
    try:
        hub = Hub(context, ask, serving.station, keys["observe"] if keys else None)
        settings = Settings(serving.all_names(), serving.certificate is not None, serving.kiosk, serving.watchers)
        server = uvicorn.Server(
            uvicorn.Config(
                make_app(Page(settings, hub, ask, users)),
                log_config=None, access_log=False, server_header=False, proxy_headers=False, ws="websockets-sansio",
                ws_max_size=1024, timeout_graceful_shutdown=GRACE_S, limit_concurrency=256, lifespan="on",
                ssl_certfile=serving.certificate, ssl_keyfile=serving.certificate_key,
            )
        )  # fmt: skip
        await server.serve(sockets=[listening])
    finally:
        ask.close()
        context.destroy(linger=0)
        listening.close()


def _listen(serving: Serving) -> socket.socket:
    """Return the bound socket; raise OSError if the address is taken or not ours."""
    family = socket.AF_INET6 if ":" in serving.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((serving.host, serving.port))
    except OSError:
        listening.close()
        raise
    return listening


def run(serving: Serving) -> None:
    """Serve in an event loop of its own."""
    asyncio.run(serve(serving))
