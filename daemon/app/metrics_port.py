"""The port of the metrics: served as soon as it is free; one that is in use keeps no station from its work."""

from __future__ import annotations

import asyncio

import structlog

from daemon.jobs.observer import Publisher
from daemon.telemetry.metrics import Metrics

AGAIN_S = 60.0
log = structlog.get_logger(__name__)


class MetricsPort:
    """Serves the metrics of one daemon, if they are wanted."""

    def __init__(self, metrics: Metrics, port: int, publisher: Publisher) -> None:
        """Take the port, 0 for none, and to whom it is told how it goes."""
        self._metrics, self._port = metrics, port
        self._publisher = publisher
        self.trouble: str | None = None
        """Why nobody can read them; None where somebody can, or nobody wants to."""

    def open(self) -> None:
        """Serve if that is wanted and can be. Trouble is told once."""
        if not self._port or self._metrics.address is not None:
            return
        try:
            self._metrics.serve(self._port)
        except (OSError, RuntimeError) as exc:
            if self.trouble is None:
                advice = f"free the port: it is tried again every {AGAIN_S:.0f} s; or choose another, then restart"
                self._tell("metrics_not_served", error=str(exc), advice=advice)
            self.trouble = f"metrics (metrics.port, {self._port}): {exc}"
            return
        if self.trouble is not None:
            self.trouble = None
            self._tell("metrics_served")

    async def run(self, every_s: float = AGAIN_S) -> None:
        """Try again now and then, until cancelled."""
        while True:
            self.open()
            await asyncio.sleep(every_s)

    def _tell(self, event: str, **facts: str) -> None:
        say = log.error if facts else log.info
        say(event, port=self._port, **facts)
        self._publisher.publish("log", {"event": event, "port": self._port, **facts})
