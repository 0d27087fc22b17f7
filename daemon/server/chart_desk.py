"""Answers to `charts`: the courses of a month, drawn by the process that draws the page of `reprobe month`.

Drawing takes seconds of the processor: one request is drawn at a time, at a lower priority than jobs have, and the
same charts are not drawn twice within a minute.
"""

from __future__ import annotations

import asyncio
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.no_paths import without_paths
from daemon.platform.clock import utc_now
from daemon.platform.subprocess import draw
from daemon.wire.operations.health import ChartFacts, ChartsReply

DRAWN_WITHIN_S, NICER = 120.0, 10
LASTS_S = 60.0


class ChartDesk:
    """Hand out the charts of one station."""

    def __init__(self, station: str, journal: Path, now_s: Callable[[], float] = time.monotonic) -> None:
        self._station, self._journal, self._now_s = station, journal, now_s
        self._one = asyncio.Lock()
        self._drawn: tuple[float, ChartsReply] | None = None

    async def charts(self, month: str) -> ChartsReply:
        """Answer the charts of a month; raise `Fault` if they cannot be drawn."""
        async with self._one:
            if self._drawn is not None and self._drawn[1].month == month and self._now_s() - self._drawn[0] < LASTS_S:
                return self._drawn[1]
            drawn_at = utc_now()
            reply = ChartsReply(month=month, drawn_at=drawn_at, charts=await self._draw(month))
            self._drawn = self._now_s(), reply
            return reply

    async def _draw(self, month: str) -> list[ChartFacts]:
        with tempfile.TemporaryDirectory(prefix="reprobe-charts-") as folder:
            file = Path(folder) / "charts.json"
            arguments = ["--journal", str(self._journal), "--month", month, "--station", self._station,
                         "--charts", "-o", str(file)]  # fmt: skip
            status, words = await draw("daemon.tools.report.month", arguments, DRAWN_WITHIN_S, NICER)
            if status:
                raise Fault(FaultCode.CHARTS_NOT_DRAWN, without_paths(words))
            text = await asyncio.to_thread(file.read_text)
        return [ChartFacts.model_validate(one) for one in json.loads(text)]
