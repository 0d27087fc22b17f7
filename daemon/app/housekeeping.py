"""Housekeeping beside the jobs: lag of the event loop, and memory given back to the system."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from daemon.jobs.fault_latch import FaultLatch
from daemon.platform.memory import give_back_memory
from daemon.telemetry.metrics import Metrics

EVERY_S = 0.5
REST_TURNS, AGAIN_TURNS = 4, 60
"""Memory is given back when nothing has run for so many turns, for a tester's next job would ask for it again at once;
and then now and again, for what a job leaves to do (pictures, a page) ends later than the job."""
FORGET_TURNS = 60
"""After so many, what was drawn of the board is given up too: between the boards of a line it is wanted again."""


async def keep_house(latch: FaultLatch, metrics: Metrics, forget: Callable[[], None]) -> None:
    """Measure the loop's lag and give memory back, until cancelled; `forget` gives up what can be made again."""
    loop = asyncio.get_running_loop()
    resting = 0
    while True:
        due_s = loop.time() + EVERY_S
        await asyncio.sleep(EVERY_S)
        metrics.lag(max(0.0, loop.time() - due_s))
        resting = 0 if latch.running is not None else resting + 1
        if resting == FORGET_TURNS:
            forget()
        if resting % AGAIN_TURNS == REST_TURNS:
            await asyncio.to_thread(give_back_memory)
