"""A supervisor and a job runner on devices that answer at once."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from daemon.app.supervisor import StationSupervisor
from daemon.config.current import CurrentSettings
from daemon.config.model import load_config
from daemon.domain.board import Board
from daemon.domain.errors import Fault
from daemon.jobs.context import Outcome
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.runner import JobRunner
from daemon.jobs.station_lock import StationLock
from daemon.storage.calibration_store import Calibrations
from daemon.tools.demo.settings import Places, write_settings
from daemon.wire.operations.table import OPERATIONS
from tests.daemon.app.fake_hardware import FakeHardware, Gate, hardware
from tests.daemon.jobs.memory_journal import MemoryJournal
from tests.daemon.jobs.surroundings import surroundings

JOBS: dict[str, dict[str, Any]] = {
    "correct": {"test_point": "TP1"},
    "place": {"test_point": "TP1"},
    "look": {},
    "align": {},
    "calibrate": {"what": "backlash"},
    "home": {},
    "lift": {},
}


class Images:
    full = None

    def folder_for(self, _request: Any, *, failed: bool) -> None:  # noqa: ARG002
        return


class Station:
    """A supervisor and a job runner on devices that answer at once."""

    def __init__(self, folder: Path, journal: MemoryJournal | None = None) -> None:
        config = load_config(write_settings(Places(folder, folder)))
        board = cast("Board", AnyBoard())
        self.journal, self.latch, self.lock = journal or MemoryJournal(), FaultLatch(), StationLock()
        self.hardware = hardware()
        self.opened: list[FakeHardware] = []
        self.open_error: Exception | None = None
        self.asked_to_rest: list[list[str]] = []
        self.answering: set[str] = set()
        self.began: list[str] = []
        self.settings = CurrentSettings(config, board)
        self.supervisor = StationSupervisor(
            self.settings, self.latch, self.lock, Calibrations(folder / "calibration", "demo"),
            cast("Any", self.journal), self._open, stop_unopened=self._stop_unopened,
        )  # fmt: skip
        self.runner = JobRunner(
            surroundings(
                latch=self.latch, lock=self.lock, journal=self.journal, images=Images(),
                context=self.supervisor.context, procedures=dict.fromkeys(JOBS, self._procedure),
            )
        )  # fmt: skip

    def check_every(self, seconds: float) -> None:
        """Have the drives checked at rest that often."""
        config = self.settings.config
        often = config.maintenance.model_copy(update={"idle_check_s": seconds})
        changed = config.model_copy(update={"maintenance": often})
        self.settings.replace(cast("Any", SimpleNamespace(config=changed, board=self.settings.board)))

    async def _open(self, _config: Any, _deadline: Any) -> Any:
        if self.open_error is not None:
            raise self.open_error
        self.opened.append(self.hardware)
        return self.hardware

    async def _stop_unopened(self, _config: Any, names: Iterable[str]) -> frozenset[str]:
        assert self.lock.holder == "stop", "a reset would open the same lines"
        self.asked_to_rest.append(list(names))
        return frozenset(self.answering & set(names))

    async def _procedure(self, job: Any, _context: Any) -> Outcome:
        self.began.append(job.request.op)
        return Outcome("done")

    def watch(self, gate: Gate) -> None:
        """Have every question to a device pass a gate from here on."""
        self.hardware.gate = gate

    async def submit(self, op: str, job_id: str) -> str:
        """Send a job and return how it was taken."""
        try:
            await self.runner.submit(OPERATIONS.parse({"op": op, "id": job_id, **JOBS[op]}))  # type: ignore[arg-type]
        except Fault as fault:
            return fault.kind.wire_name
        return "accepted"


class AnyBoard:
    """A board that has every point."""

    name, side, revision = "any", "top", "1"
    layers, points = None, ()

    def point(self, _name: str) -> None:
        return

    find = point


async def turns(count: int = 30) -> None:
    for _ in range(count):
        await asyncio.sleep(0)


async def until(holds: Callable[[], bool]) -> None:
    """Let others have their turn until something is true."""
    async with asyncio.timeout(30.0):
        while not holds():  # noqa: ASYNC110  # what is waited for has no event of its own
            await asyncio.sleep(0)


async def let_pass(_what: str) -> None:
    return
