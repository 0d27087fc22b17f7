"""Keyring of the running daemon; read again whenever the allow-list changes."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path

import structlog

from daemon.wire.curve_keys import (
    ANY_OF_OTHERS,
    CLIENTS,
    SERVER_FILE,
    WRITE_OF_OTHERS,
    ClientKey,
    KeyTrouble,
    PrivateKey,
    read_client,
    read_private,
    require_mode,
)

CREDENTIALS = "CREDENTIALS_DIRECTORY"
"""Where a service manager puts what only this service may read."""
UNSETTLED_NS = 50_000_000
"""A folder's time is this coarse at worst: a change that soon after the last one may leave it as it was."""
log = structlog.get_logger(__name__)


class Keyring:
    """The station's key and the clients that may come in.

    The station's key is `server.key` of the service's credentials, else of the folder. The allow-list is `clients/` of
    the folder, else the credentials named `clients_*`: a change of the folder counts from the next message on, one of
    credentials from the next start on.
    """

    def __init__(self, folder: Path, environment: Mapping[str, str] = os.environ) -> None:
        self._credentials = Path(environment[CREDENTIALS]) if environment.get(CREDENTIALS) else None
        self._list = folder / CLIENTS
        self._follows = True
        self._read_ns = 0
        self._stamp_ns = -1
        self._clients: dict[str, ClientKey] = {}
        self.removals = 0
        """How often clients were taken off the list: who holds connections open compares."""
        self.server = self._server_key(folder)
        self._first_list()

    def find(self, public: str) -> ClientKey | None:
        """Return the client of this public key, or None if it may not come in (any more)."""
        self.refresh()
        return self._clients.get(public)

    def named(self, name: str) -> ClientKey | None:
        """Return the client of this name, or None if it may not come in (any more)."""
        self.refresh()
        return next((client for client in self._clients.values() if client.name == name), None)

    def refresh(self) -> None:
        """Read the allow-list again if it may have changed; a file that cannot be trusted lets nobody in."""
        if not self._follows:
            return
        try:
            stamp_ns = self._list.stat().st_mtime_ns
        except OSError as exc:
            if self._clients:
                log.error("allow_list_lost", folder=str(self._list), error=str(exc))
            self._replace({})
            self._stamp_ns = -1
            return
        if stamp_ns == self._stamp_ns and self._read_ns - stamp_ns > UNSETTLED_NS:
            return
        self._stamp_ns, self._read_ns = stamp_ns, time.time_ns()
        self._replace(self._listed())

    def _replace(self, clients: dict[str, ClientKey]) -> None:
        if any(clients.get(public) != key for public, key in self._clients.items()):
            self.removals += 1
        self._clients = clients

    def _listed(self) -> dict[str, ClientKey]:
        """Read the folder, leaving out what cannot be trusted."""
        found: dict[str, ClientKey] = {}
        try:
            require_mode(self._list, WRITE_OF_OTHERS)
        except KeyTrouble as exc:
            log.error("allow_list_not_used", error=str(exc), advice=exc.advice)
            return found
        for path in self._list.glob("*.toml"):
            try:
                key = read_client(path)
            except KeyTrouble as exc:
                log.error("client_key_not_used", error=str(exc), advice=exc.advice)
            else:
                found[key.public] = key
        return found

    def _server_key(self, folder: Path) -> PrivateKey:
        if self._credentials is not None and (self._credentials / SERVER_FILE).exists():
            return read_private(self._credentials / SERVER_FILE, kept_by_system=True)
        require_mode(folder, ANY_OF_OTHERS)
        return read_private(folder / SERVER_FILE)

    def _first_list(self) -> None:
        """Read the list for the first time, strictly: at start a file that is too open is refused, not skipped."""
        given = sorted(self._credentials.glob(f"{CLIENTS}_*")) if self._credentials is not None else []
        # Root may keep the folder to itself: then what the service manager handed over is the list.
        if self._credentials is not None and not os.access(self._list, os.R_OK | os.X_OK):
            self._follows = False
            keys = [read_client(path, kept_by_system=True) for path in given]
            self._clients = {key.public: key for key in keys}
            if not keys:
                log.warning("allow_list_empty", advice="`reprobe keys new`, then restart the service")
            return
        require_mode(self._list, WRITE_OF_OTHERS)
        for path in self._list.glob("*.toml"):
            read_client(path)
        self.refresh()
