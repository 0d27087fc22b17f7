"""The service: starts the daemon, serves until it is told to stop, and stops it.

It starts in `fault` and stays there until every device is open and the drives say they are homed. A device that is
missing does not end the daemon: it says what is missing, answers, and tries again on `reset`.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import structlog

from daemon.app.housekeeping import keep_house
from daemon.app.runtime import Runtime, put_together
from daemon.config.model import Config
from daemon.domain.errors import Fault
from daemon.domain.results import JobResult
from daemon.platform import early_hangup
from daemon.platform.descriptors import raise_limit
from daemon.platform.memory import few_arenas
from daemon.storage.journal import Journal
from vision.warm import warm_up

AGAIN_S = 30.0
"""Pause before a part that failed is started again."""
log = structlog.get_logger(__name__)


class Service:
    """One daemon. `run` serves until `stop` is called or the process is told to end."""

    def __init__(self, config: Config, path: Path | None = None) -> None:
        """Take the configuration and the file it came from, which SIGHUP reads again."""
        self._config = config
        self._path = path.resolve() if path is not None else None
        self._stop = asyncio.Event()

    def stop(self) -> None:
        """Ask the daemon to end; motion stops, lights go off, everything is written."""
        self._stop.set()

    async def run(self) -> None:
        """Serve until told to stop; whatever was opened is closed again, in the opposite order."""
        few_arenas()
        raise_limit()
        async with AsyncExitStack() as stack:
            runtime = await put_together(self._config, self._path, stack)
            loop = asyncio.get_running_loop()
            for number in (signal.SIGTERM, signal.SIGINT):
                loop.add_signal_handler(number, self.stop)
            loop.add_signal_handler(signal.SIGHUP, runtime.reloader.ask)
            if early_hangup.came():
                runtime.reloader.ask()
            await self._serve(runtime)
        log.info("stopped")

    async def _serve(self, runtime: Runtime) -> None:
        """Report what a stop interrupted, open the devices, then run everything until told to stop."""
        await runtime.journal_watch.look()
        for alert in runtime.monitor.alerts.standing.values():
            runtime.metrics.take("alert", alert.body("raised"))
        answering = asyncio.create_task(runtime.control.serve(), name="control")
        background = _background(runtime)
        working = asyncio.create_task(_open_and_work(runtime), name="jobs")
        stopping = asyncio.create_task(self._stop.wait(), name="stop")
        tasks: set[asyncio.Task[Any]] = {answering, working, stopping, *background}
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        log.info("stopping")
        runtime.latch.closing()
        runtime.notifier.stopping("stopping")
        for task in (*background, working):
            task.cancel()
        await asyncio.wait([working, *background])
        await runtime.runner.refuse_waiting()
        with contextlib.suppress(Fault):  # what cannot be written even now is `interrupted` for the next daemon
            await runtime.runner.write_held_back()
        await runtime.monitor.close()
        await runtime.control.drain(within_s=1.0)
        answering.cancel()
        stopping.cancel()
        await asyncio.wait([answering, stopping])
        for task in done - {stopping}:
            task.result()  # a task that ended by itself ended by an error: let it be seen


def _background(runtime: Runtime) -> list[asyncio.Task[None]]:
    """Start what goes on beside the jobs."""
    latch, settings, forget = runtime.latch, runtime.settings, runtime.supervisor.forget_drawings
    beat = runtime.announcer.beat(lambda: latch.state, lambda: settings.config.api.heartbeat_s)
    return [
        asyncio.create_task(beat, name="heartbeat"),
        asyncio.create_task(runtime.journal_watch.run(), name="journal"),
        asyncio.create_task(runtime.supervisor.run(), name="supervise"),
        asyncio.create_task(runtime.reloader.run(busy=lambda: latch.running is not None), name="reload"),
        asyncio.create_task(
            _lasting("housekeeping", lambda: keep_house(latch, runtime.metrics, forget)), name="housekeeping"
        ),
        asyncio.create_task(_lasting("metrics", runtime.metrics_port.run), name="metrics"),
        asyncio.create_task(_lasting("events", runtime.events.run), name="events"),
        asyncio.create_task(_lasting("unserved", runtime.unserved.run), name="unserved"),
        asyncio.create_task(_lasting("alerts", runtime.fault_alerts.run), name="alerts"),
        *([asyncio.create_task(_lasting("live", runtime.live.run), name="live")] if runtime.live else []),
        asyncio.create_task(_lasting("maintenance", runtime.monitor.run), name="maintenance"),
    ]


async def _lasting(part: str, run: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run a part that nothing needs to move safely; an error of its own starts it again and ends no daemon."""
    while True:
        try:
            return await run()
        except Exception:  # a bug in a part that moves nothing must not end what does
            log.exception("part_failed", part=part, again_in_s=AGAIN_S)
            await asyncio.sleep(AGAIN_S)


async def _open_and_work(runtime: Runtime) -> None:
    await runtime.supervisor.open()
    runtime.status_line.ready(await _last_result(runtime.journal))
    # Jobs come after: the first one would have to wait for it anyway.
    try:
        await asyncio.to_thread(warm_up)
    except Exception:  # what was not loaded now is loaded by the first look, which takes longer
        log.exception("part_failed", part="warming up")
    await runtime.supervisor.first_check(runtime.watchdog)
    await runtime.runner.run()


async def _last_result(journal: Journal) -> JobResult | None:
    """Return the newest result, None if there is none or the journal cannot be read."""
    try:
        return await journal.last_result()
    except Fault:
        return None
