"""Addresses that cannot be served stand as one alert: the station works without, and somebody should know."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Final, Protocol

from daemon.jobs.observer import JobObserver
from daemon.telemetry.status_line import StatusLine

EVERY_S = 0.5
ALERT: Final = "not_served"
"""Name of the alert in the maintenance catalogue."""


class Part(Protocol):
    """What serves something that nothing needs to move safely."""

    @property
    def trouble(self) -> str | None:
        """What cannot be served, where, and why; None where all is well."""


class UnservedWatch:
    """Raises the alert while a part has no address, says it in the status line, and clears it afterwards."""

    def __init__(self, parts: Sequence[Part], observer: JobObserver, status_line: StatusLine) -> None:
        self._parts, self._observer, self._status_line = parts, observer, status_line
        self._told: str | None = ""
        """What was told last; an alert that a daemon before this one raised is cleared by the first look."""

    async def run(self) -> None:
        """Look now and then, until cancelled."""
        while True:
            self.look()
            await asyncio.sleep(EVERY_S)

    def look(self) -> None:
        """Tell what has changed."""
        message = "; ".join(part.trouble for part in self._parts if part.trouble is not None) or None
        if message == self._told:
            return
        self._told = message
        self._observer.on_flag(ALERT, message)
        self._status_line.without(message)
