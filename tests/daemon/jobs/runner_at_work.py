"""A job runner at work on devices that answer at once; its procedures are given by the test."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome
from daemon.jobs.observer import JobObserver
from daemon.jobs.runner import JobRunner
from daemon.station.needle import Needle
from daemon.wire.operations.jobs import AnyJob, Home
from daemon.wire.operations.table import OPERATIONS
from drivers.gantry import Position
from tests.daemon.jobs.memory_journal import MemoryJournal
from tests.daemon.jobs.surroundings import LIMITS, Published, idle_latch, surroundings

SAFE_UM, WORK_UM, TOUCH_UM, PRESSED_UM = 12_000.0, 5_200.0, 5_000.0, 4_900.0
OPS = ("home", "lift", "place", "look", "correct", "touch", "run", "jog")
HOME = Home(op="home", id="a")
WRITTEN = HOME.model_dump_json(exclude={"wait", "deadline_ms"})
Body = Callable[[JobContext], Awaitable[Outcome]]


class FakeStation:
    """The devices, as far as the runner asks them itself."""

    exchanges = 0
    moving = False

    def __init__(self, did: list[str]) -> None:
        self._did = did
        self.lamp_error: Exception | None = None
        self.lift_error: Exception | None = None
        self.is_homed = True
        self.needle = Needle()
        self.needle.adopt(lambda _at: WORK_UM, lambda _at: TOUCH_UM)
        self.at(SAFE_UM)

    def at(self, z_um: float) -> None:
        """Have the drives report a height."""
        self.needle.reported(Position(0.0, 0.0, z_um, 0.0))

    async def homed(self, _deadline: Any) -> bool:
        return self.is_homed

    async def retract(self, _deadline: Any) -> None:
        self._did.append("raise")
        if self.lift_error is not None:
            raise self.lift_error
        self.at(SAFE_UM)

    async def stop(self) -> None:
        self._did.append("stop")

    async def lights_off(self, *_: Any) -> None:
        self._did.append("dark")
        if self.lamp_error is not None:
            raise self.lamp_error


class Observer(JobObserver):
    """Keeps what maintenance would hear."""

    def __init__(self, did: list[str]) -> None:
        self._did = did
        self.steps: list[tuple[str, str]] = []
        self.flags: list[tuple[str, str | None]] = []

    def on_step(self, job_id: str, kind: str, body: Any) -> None:  # noqa: ARG002
        self.steps.append((job_id, kind))

    def on_result(self, job: JobContext, result: JobResult) -> None:  # noqa: ARG002
        self._did.append("observed")

    def on_flag(self, name: str, message: str | None) -> None:
        self.flags.append((name, message))


class Images:
    """The archive: a folder for every job, and what was kept."""

    full: str | None = None

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.kept: list[str] = []
        self.failed: list[bool] = []

    def folder_for(self, request: AnyJob, *, failed: bool) -> Path:
        self.failed.append(failed)
        return self._folder / request.id

    async def keep(self, folder: Path, _job: JobContext, _result: JobResult) -> None:
        self.kept.append(folder.name)


class Line:
    """A runner at work whose procedures are given by the test."""

    def __init__(self, folder: Path, body: Body | None = None, **more: Any) -> None:
        self.did: list[str] = []
        self.body = body
        self.latch, self.journal, self.published = idle_latch(), MemoryJournal(), Published()
        self.station, self.observer, self.images = FakeStation(self.did), Observer(self.did), Images(folder)
        self.results: list[JobResult] = []
        self.open = True
        board = SimpleNamespace(point=self._point, find=self._point)
        self.context = cast("Any", SimpleNamespace(station=self.station, board=board))
        self.runner = JobRunner(
            surroundings(
                latch=self.latch, journal=self.journal, publisher=self.published, images=self.images,
                observer=self.observer, context=lambda: self.context if self.open else None,
                on_result=self.results.append, procedures=dict.fromkeys(OPS, self._run),
                limits=lambda: replace(LIMITS, queue_length=30, queue_per_client=30), **more,
            )
        )  # fmt: skip

    @staticmethod
    def _point(name: str) -> None:
        if name == "nowhere":
            raise Fault(FaultCode.UNKNOWN_TEST_POINT)

    async def _run(self, job: JobContext, _context: Any) -> Outcome:
        self.did.append(f"run {job.request.id}")
        assert self.body is not None
        return await self.body(job)

    async def ask(self, op: str = "look", job_id: str = "j", client: str = "", **fields: Any) -> asyncio.Future[Any]:
        request = OPERATIONS.parse({"op": op, "id": job_id, **fields})
        return await self.runner.submit(cast("AnyJob", request), client)

    async def do(self, op: str = "look", job_id: str = "j", **fields: Any) -> JobResult:
        async with asyncio.timeout(30.0):
            return cast("JobResult", await (await self.ask(op, job_id, **fields)))


@asynccontextmanager
async def at_work(folder: Path, body: Body | None = None, **more: Any) -> AsyncIterator[Line]:
    line = Line(folder, body, **more)
    loop = asyncio.create_task(line.runner.run())
    try:
        yield line
    finally:
        loop.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await loop


def raising(error: Exception, *before: Event) -> Body:
    async def body(job: JobContext) -> Outcome:
        for event in before:
            job.fire(event)
        raise error

    return body


async def looked(job: JobContext) -> Outcome:
    job.fire(Event.ACCEPTED)
    return Outcome("looked", test_point="TP1", error_before_um=3.0, detail={"n": 1})


class Gate:
    """A procedure that begins, and ends when it is let."""

    def __init__(self) -> None:
        self.began, self.may_end = asyncio.Event(), asyncio.Event()

    async def __call__(self, job: JobContext) -> Outcome:
        job.fire(Event.ACCEPTED)
        self.began.set()
        await self.may_end.wait()
        return Outcome("looked")
