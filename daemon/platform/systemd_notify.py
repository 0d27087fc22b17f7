"""Notifications to the service manager: systemd's protocol, by hand (man 3 sd_notify).

One datagram of `KEY=value` lines to the socket that `NOTIFY_SOCKET` names. Without that variable, on a terminal or in a
test, everything here is silent. Nothing here raises and nothing blocks for longer than a moment: a service manager that
does not listen is no reason to stop working.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Mapping
from typing import Self

import structlog

SEND_WITHIN_S = 0.2
"""Longest wait for room in the manager's queue, of words that are said once; the others come again."""
STATUS_AT_MOST = 500
"""Characters of a status line."""
log = structlog.get_logger(__name__)


class Notifier:
    """The way to the service manager; one a process."""

    def __init__(self, address: str | None = None, watchdog_s: float | None = None) -> None:
        """Take the socket's address (None: nobody listens) and how long the watchdog waits (None: there is none)."""
        self.watchdog_s = watchdog_s
        self._address = _as_bytes(address) if address else None
        self._socket: socket.socket | None = None
        self._status = ""
        self._deaf = False

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ) -> Self:
        """Read what systemd set for this process; a watchdog that is meant for another process is none."""
        return cls(environment.get("NOTIFY_SOCKET"), _watchdog_s(environment))

    @property
    def feed_every_s(self) -> float | None:
        """How often the watchdog wants to be fed: twice as often as it must."""
        return self.watchdog_s / 2 if self.watchdog_s is not None else None

    @property
    def deaf(self) -> bool:
        """Whether the manager did not take the last line."""
        return self._deaf

    def ready(self, status: str) -> None:
        """Say that the start, or a reload, is over."""
        self._status = _one_line(status)
        self._send("READY=1", f"STATUS={self._status}", wait_s=SEND_WITHIN_S)

    def status(self, status: str) -> None:
        """Say in a line what the daemon does; the same line twice is sent once."""
        line = _one_line(status)
        if line != self._status and self._send(f"STATUS={line}"):
            self._status = line

    def reloading(self) -> None:
        """Say that the configuration is being read again; `ready` ends it."""
        now_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
        self._send("RELOADING=1", f"MONOTONIC_USEC={now_us}", wait_s=SEND_WITHIN_S)

    def stopping(self, status: str) -> None:
        """Say that the end has begun."""
        self._status = _one_line(status)
        self._send("STOPPING=1", f"STATUS={self._status}", wait_s=SEND_WITHIN_S)

    def feed(self) -> None:
        """Feed the watchdog. Only who has just proved that the daemon works may call this."""
        if self.watchdog_s is not None:
            self._send("WATCHDOG=1")

    def close(self) -> None:
        """Let go of the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, *lines: str, wait_s: float = 0.0) -> bool:
        """Send one datagram; return whether it went out."""
        if self._address is None:
            return False
        try:
            if self._socket is None:
                self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.settimeout(wait_s)
            self._socket.sendto("\n".join(lines).encode(), self._address)
        except OSError as exc:
            if not self._deaf:
                log.warning("service_manager_does_not_listen", cause=str(exc))
            self._deaf = True
        else:
            self._deaf = False
        return not self._deaf


def _as_bytes(address: str) -> bytes:
    """Return the socket's address; one that begins with @ is in the abstract name space."""
    raw = os.fsencode(address)
    return b"\0" + raw[1:] if raw.startswith(b"@") else raw


def _watchdog_s(environment: Mapping[str, str]) -> float | None:
    """Return the watchdog's patience, if there is one and it is for this process."""
    meant_for = environment.get("WATCHDOG_PID")
    if meant_for is not None and meant_for != str(os.getpid()):
        return None
    try:
        patience_us = int(environment.get("WATCHDOG_USEC", "0"))
    except ValueError:
        return None
    return patience_us / 1e6 if patience_us > 0 else None


def _one_line(text: str) -> str:
    """Make a status line of any text: a line break would begin another variable."""
    return " ".join(text.split())[:STATUS_AT_MOST]
