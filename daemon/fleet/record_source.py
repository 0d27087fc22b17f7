"""Source of batches: what the daemon has next, by how far the centre has it."""

from __future__ import annotations

import asyncio
from typing import Any, Protocol

import structlog

from daemon.client import NoAnswer, Refused
from daemon.fleet.batch import Batch, batch_of
from daemon.fleet.send_window import Position, SendWindow

EACH_S = 0.05
"""The daemon is asked no more often, whatever the centre says: 2,000 records a second are plenty to catch up with, and
a station that works has other things to do."""
log = structlog.get_logger(__name__)


class Pages(Protocol):
    """Where records are read from: a daemon, asked page by page."""

    async def page(self, position: Position) -> dict[str, Any]:
        """Return one page of records; raise `NoAnswer` or `Refused`."""


class RecordSource:
    """Read a daemon's records on."""

    def __init__(self, pages: Pages) -> None:
        self._pages = pages
        self._silent = False
        """Whether it was said that the daemon is away."""
        self._next_at_s = 0.0

    async def following(self, window: SendWindow) -> Batch | None:
        """Return the batch after what the window has sent; None if there is nothing new, or the daemon is away."""
        while True:
            await self._take_turn()
            asked = window.position
            try:
                page = await self._pages.page(asked)
            except (NoAnswer, Refused) as exc:
                if not self._silent:
                    log.warning("daemon_away", error=str(exc))
                self._silent = True
                return None
            self._silent = False
            if asked == window.position:  # else the centre spoke meanwhile
                break
        if page["journal"] == asked.journal and asked.since > page["next_seq"]:
            log.error("centre_says_nonsense", error=f"number {asked.since - 1} is stored there, and was never written")
            window.disbelieve()
            return None
        return batch_of(page, *asked)

    async def _take_turn(self) -> None:
        """Wait until the daemon may be asked again."""
        loop = asyncio.get_running_loop()
        await asyncio.sleep(max(0.0, self._next_at_s - loop.time()))
        self._next_at_s = loop.time() + EACH_S
