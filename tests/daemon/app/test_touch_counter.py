"""Each touch of the daemon's own is a row in the journal, whatever the tester reports; a full disk stops none."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, cast

from daemon.app.touch_counter import TouchCounter
from daemon.domain.errors import Fault, FaultCode
from daemon.storage.journal import Journal
from daemon.telemetry.metrics import Metrics


class Monitor:
    """Counts."""

    touches = 0

    def on_own_touch(self) -> None:
        self.touches += 1


class FullDisk:
    """A journal that cannot be written."""

    def __init__(self) -> None:
        self.asked = asyncio.Event()

    async def add_report(self, *_row: Any) -> None:
        self.asked.set()
        raise Fault(FaultCode.JOURNAL_FAILED)


async def test_touches_are_counted_in_journal_monitor_and_metrics(tmp_path: Path) -> None:
    journal, monitor, metrics = await Journal.open(tmp_path / "j.sqlite"), Monitor(), Metrics("s", "0")
    counter = TouchCounter(journal, metrics, lambda: cast("Any", monitor), lambda: "job-1")
    await journal.add_report(None, "pass", 5)
    for _ in range(3):
        counter.touched()
    await counter.settle()
    assert (await journal.touches(), monitor.touches) == (8, 3)
    assert "reprobe_touches_total 3.0" in metrics.text()
    await journal.close()


async def test_a_touch_that_cannot_be_written_stops_nothing() -> None:
    journal, monitor = FullDisk(), Monitor()
    counter = TouchCounter(cast("Any", journal), Metrics("s", "0"), lambda: cast("Any", monitor), lambda: None)
    counter.touched()
    await journal.asked.wait()
    await counter.settle()
    assert monitor.touches == 1
