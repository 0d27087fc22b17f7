"""The announcer: what is said of the daemon as a whole is said whatever the disk does."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any, cast

from daemon.app.announcer import Announcer
from daemon.domain.states import State
from daemon.jobs.fault_latch import FaultLatch
from daemon.platform.systemd_notify import Notifier
from daemon.telemetry.status_line import StatusLine
from tests.daemon.jobs.memory_journal import MemoryJournal
from tests.daemon.jobs.surroundings import Published


def _announcer(journal: MemoryJournal, published: Published) -> Announcer:
    notifier = Notifier()
    line = StatusLine(FaultLatch(), notifier)
    return Announcer(published, cast("Any", journal), line, notifier, "s", "1.0")


async def test_the_heart_beats_on_while_the_disk_is_full() -> None:
    journal, published = MemoryJournal(), Published()
    journal.broken = True
    beating = asyncio.create_task(_announcer(journal, published).beat(lambda: State.FAULT, lambda: 0.0))
    async with asyncio.timeout(10.0):
        while len(published.events) < 3 and not beating.done():  # noqa: ASYNC110  # what is waited for has no event
            await asyncio.sleep(0)
    assert not beating.done(), "a task that ends ends the daemon"
    assert published.events[0] == ("heartbeat", {"state": "fault", "version": "1.0"})
    beating.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await beating


async def test_a_reload_is_told_of_while_the_disk_is_full() -> None:
    journal, published = MemoryJournal(), Published()
    journal.broken = True
    await _announcer(journal, published).tell_of_reload("taken", {"changed": []})
    assert published.events == [("log", {"event": "configuration_taken", "changed": []})]
