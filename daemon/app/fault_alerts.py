"""Fault alerts: faults that mean a danger to probe or board stand as alerts too, for those who watch the station."""

from __future__ import annotations

import asyncio
from typing import Final

from daemon.domain.errors import FaultCode
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.observer import JobObserver

EVERY_S = 0.5
ALERTS: Final = {FaultCode.NEEDLE_DOWN: "needle_down"}
"""Name of the alert in the maintenance catalogue."""


class FaultAlerts:
    """Raises an alert while its fault is latched, wherever in the line of causes, and clears it afterwards."""

    def __init__(self, latch: FaultLatch, observer: JobObserver) -> None:
        self._latch, self._observer = latch, observer
        self._told: dict[FaultCode, str | None] = {}
        """What was told last; an alert that a daemon before this one raised is cleared by the first look."""

    async def run(self) -> None:
        """Look now and then, until cancelled."""
        while True:
            self.look()
            await asyncio.sleep(EVERY_S)

    def look(self) -> None:
        """Tell what has changed. While a job runs nothing has: it may have set the fault aside to cure it."""
        if self._latch.running is not None:
            return
        latched = {cause.kind: cause.message for cause in self._latch.causes}
        for kind, name in ALERTS.items():
            message = latched.get(kind)
            if kind not in self._told or message != self._told[kind]:
                self._told[kind] = message
                self._observer.on_flag(name, message)
