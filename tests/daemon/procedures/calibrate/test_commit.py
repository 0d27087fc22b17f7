"""However a calibration ends, its answer says which one is in force, and that is the one on disk."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, cast
from unittest.mock import patch

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, Procedure, StationContext
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.image_archive import ImageArchive
from daemon.jobs.runner import JobRunner
from daemon.jobs.station_lock import StationLock
from daemon.jobs.surroundings import JobLimits, Surroundings
from daemon.procedures.calibrate import commit
from daemon.procedures.calibrate.commit import keep, on_disk, tell_old
from daemon.station.needle import Needle
from daemon.storage.calibration_records import Record
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal
from daemon.wire.operations.jobs import Calibrate
from drivers.gantry import Position
from tests.daemon.tools.report.synthetic import backlash_record, rotation_record

STATION = "s1"
FIRST = "2026-03-04T05:06:07.000+00:00"
SECOND = "2026-05-04T07:00:00+00:00"
DEADLINE_MS = 1500.0
PATIENCE_S = 60.0
NO_SPACE = OSError(28, "No space left on device")


class SlowDisk(Calibrations):
    """Calibrations whose writing takes as long as the test wants."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, STATION)
        self.may_go_on = threading.Event()
        self.may_go_on.set()
        self.writes = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    def store(self, record: Record) -> Path | None:
        """Store once that is allowed."""
        self._loop.call_soon_threadsafe(self.writes.set)
        assert self.may_go_on.wait(PATIENCE_S)
        return super().store(record)


class Drawing:
    """Stands for the process that draws the page."""

    def __init__(self, *, ends: bool) -> None:
        self.began = asyncio.Event()
        self._ends = ends

    async def draw(self, *_: Any) -> tuple[int, str]:
        """Draw, perhaps without end."""
        self.began.set()
        if not self._ends:
            await asyncio.Event().wait()
        return 0, ""


class Nobody:
    """Hears events and does nothing with them."""

    def publish(self, *_: Any) -> int:
        """Number an event."""
        return 0

    async def publish_written(self, _topic: str, write: Callable[[int], Awaitable[Any]]) -> int:
        """Have an event written."""
        await write(1)
        return 1


@pytest.fixture
async def calibrations(tmp_path: Path) -> SlowDisk:
    """A station with a rotation and the play of its axes."""
    before = Calibrations(tmp_path / "calibration", STATION)
    before.store(backlash_record(station=STATION, made_at=FIRST))
    before.store(rotation_record(station=STATION, probe="", made_at=FIRST))
    slow = SlowDisk(tmp_path / "calibration")
    slow.load()
    return slow


@pytest.fixture(autouse=True)
def drawing(monkeypatch: pytest.MonkeyPatch) -> Drawing:
    """A page that is never done; a test may say otherwise."""
    slow = Drawing(ends=False)
    monkeypatch.setattr(commit, "draw", slow.draw)
    return slow


def _record(what: str) -> Record:
    facts: dict[str, Any] = {"station": STATION, "probe": "", "made_at": SECOND}
    return backlash_record(seed=7, **facts) if what == "backlash" else rotation_record(seed=7, **facts)


def _storing(*kinds: str) -> Procedure:
    """Return a calibration that measures nothing and keeps these kinds, one after the other."""

    async def procedure(job: JobContext, context: StationContext) -> Outcome:
        assert isinstance(job.request, Calibrate)
        tell_old(job, context, job.request.what)
        job.fire(Event.ACCEPTED)
        detail: dict[str, object] = {}
        for what in kinds:
            detail = await keep(job, context, _record(what))
        return Outcome("calibrated", detail=detail)

    return procedure


class FakeStation:
    """A station that has nothing to move."""

    exchanges = 0
    moving = False

    def __init__(self) -> None:
        self.needle = Needle()
        self.needle.adopt(lambda _at: 0.0, lambda _at: 0.0)
        self.needle.reported(Position(0.0, 0.0, 12_000.0, 0.0))

    async def stop(self) -> None:
        """Stop what does not move."""

    async def lights_off(self, *_: Any) -> None:
        """Switch off what is not lit."""


@asynccontextmanager
async def _running(tmp_path: Path, calibrations: Calibrations, procedure: Procedure) -> AsyncIterator[JobRunner]:
    """Run jobs of an idle station with this one procedure."""
    nothing = cast("Any", None)
    context = StationContext(nothing, cast("Any", FakeStation()), nothing, calibrations, nothing)
    latch = FaultLatch()
    latch.opened()
    journal = await Journal.open(tmp_path / "journal.sqlite")
    runner = JobRunner(
        Surroundings(
            station=STATION,
            latch=latch,
            lock=StationLock(),
            journal=journal,
            publisher=Nobody(),
            images=ImageArchive(tmp_path / "images", "none", 1.0),
            procedures={"calibrate": procedure},
            context=lambda: context,
            limits=lambda: JobLimits(PATIENCE_S, PATIENCE_S, 4, 4),
        )
    )
    jobs = asyncio.create_task(runner.run())
    try:
        yield runner
    finally:
        jobs.cancel()
        await asyncio.wait([jobs])
        await journal.close()


def _request(what: str = "backlash", deadline_ms: float | None = None) -> Calibrate:
    return Calibrate.model_validate({"op": "calibrate", "id": "j1", "what": what, "deadline_ms": deadline_ms})


def _says_the_truth(result: JobResult, calibrations: Calibrations, which: str, what: str = "backlash") -> None:
    """Check the answer against memory, and memory against what a fresh process reads."""
    fresh = Calibrations(calibrations.folder, STATION)
    fresh.load()
    assert fresh.records == calibrations.records
    made_at = SECOND if which == "new" else FIRST
    assert fresh.records[what].made_at == made_at
    told = result.detail if result.detail.get("what", what) == what else result.detail[what]
    assert (told["in_force"], told["made_at"]) == (which, made_at)


async def test_a_calibration_that_succeeds_says_that_the_new_one_is_in_force(
    tmp_path: Path, calibrations: SlowDisk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commit, "draw", Drawing(ends=True).draw)
    async with _running(tmp_path, calibrations, _storing("backlash")) as runner:
        result = await (await runner.submit(_request()))
    assert result.ok
    assert result.detail["report"].endswith(".html")
    _says_the_truth(result, calibrations, "new")


async def test_a_cancel_while_the_page_is_drawn_says_that_the_new_one_is_in_force(
    tmp_path: Path, calibrations: SlowDisk, drawing: Drawing
) -> None:
    async with _running(tmp_path, calibrations, _storing("backlash")) as runner:
        answer = await runner.submit(_request())
        await drawing.began.wait()
        runner.cancel("j1")
        result = await answer
    assert result.error is not None
    assert result.error.name == "cancelled"
    _says_the_truth(result, calibrations, "new")


async def test_a_deadline_while_the_page_is_drawn_says_that_the_new_one_is_in_force(
    tmp_path: Path, calibrations: SlowDisk
) -> None:
    async with _running(tmp_path, calibrations, _storing("backlash")) as runner:
        result = await (await runner.submit(_request(deadline_ms=DEADLINE_MS)))
    assert result.error is not None
    assert result.error.name == "deadline_missed"
    _says_the_truth(result, calibrations, "new")


async def test_a_stop_of_the_daemon_while_the_page_is_drawn_says_that_the_new_one_is_in_force(
    tmp_path: Path, calibrations: SlowDisk, drawing: Drawing
) -> None:
    async with _running(tmp_path, calibrations, _storing("backlash")) as runner:
        answer = await runner.submit(_request())
        await drawing.began.wait()
    result = await answer
    assert result.error is not None
    assert result.error.name == "shutting_down"
    _says_the_truth(result, calibrations, "new")


@pytest.mark.parametrize("cancels", [1, 3])
async def test_a_cancel_while_the_disk_is_written_waits_for_it_and_says_what_came_of_it(
    tmp_path: Path, calibrations: SlowDisk, cancels: int
) -> None:
    calibrations.may_go_on.clear()
    async with _running(tmp_path, calibrations, _storing("backlash")) as runner:
        answer = await runner.submit(_request())
        await calibrations.writes.wait()
        for _ in range(cancels):
            runner.cancel("j1")
            await _let_others_run()
        assert not answer.done()
        calibrations.may_go_on.set()
        result = await answer
    assert result.error is not None
    assert result.error.name == "cancelled"
    _says_the_truth(result, calibrations, "new")


async def test_a_cancel_while_a_write_fails_says_that_the_old_one_stays(tmp_path: Path, calibrations: SlowDisk) -> None:
    calibrations.may_go_on.clear()
    async with _running(tmp_path, calibrations, _storing("backlash")) as runner:
        answer = await runner.submit(_request())
        await calibrations.writes.wait()
        with patch.object(os, "replace", side_effect=NO_SPACE):
            runner.cancel("j1")
            await _let_others_run()
            calibrations.may_go_on.set()
            result = await answer
    assert result.error is not None
    assert result.error.name == "cancelled"
    _says_the_truth(result, calibrations, "old")


async def test_a_full_disk_says_that_the_old_one_stays(tmp_path: Path, calibrations: SlowDisk) -> None:
    async with _running(tmp_path, calibrations, _storing("backlash")) as runner:
        with patch.object(os, "replace", side_effect=NO_SPACE):
            result = await (await runner.submit(_request()))
    assert result.error is not None
    assert (result.error.name, result.error.advice) == ("calibration_failed", "free disk space, then calibrate again")
    _says_the_truth(result, calibrations, "old")


async def test_a_calibration_that_is_refused_says_that_the_old_one_stays(
    tmp_path: Path, calibrations: SlowDisk
) -> None:
    async def refused(job: JobContext, context: StationContext) -> Outcome:
        tell_old(job, context, "backlash")
        job.fire(Event.ACCEPTED)
        raise Fault(FaultCode.CALIBRATION_FAILED, "the mark was not seen")

    async with _running(tmp_path, calibrations, refused) as runner:
        result = await (await runner.submit(_request()))
    assert result.error is not None
    assert result.error.name == "calibration_failed"
    _says_the_truth(result, calibrations, "old")


async def test_a_refused_first_calibration_says_that_none_is_in_force(tmp_path: Path) -> None:
    empty = SlowDisk(tmp_path / "calibration")
    async with _running(tmp_path, empty, _storing("backlash")) as runner:
        with patch.object(os, "replace", side_effect=NO_SPACE):
            result = await (await runner.submit(_request()))
    assert not result.ok
    assert (result.detail["in_force"], result.detail["made_at"]) == ("none", None)
    assert not empty.made_at()


async def test_what_a_calibration_stored_on_its_way_is_said_beside_what_was_asked_for(
    tmp_path: Path, calibrations: SlowDisk, drawing: Drawing
) -> None:
    """As a rotation does that first has to walk a map."""
    async with _running(tmp_path, calibrations, _storing("backlash", "rotation")) as runner:
        answer = await runner.submit(_request("rotation"))
        await drawing.began.wait()
        runner.cancel("j1")
        result = await answer
    _says_the_truth(result, calibrations, "old", "rotation")
    _says_the_truth(result, calibrations, "new", "backlash")


async def test_a_record_that_could_not_be_used_fails_the_calibration_and_nothing_is_latched(
    tmp_path: Path, calibrations: SlowDisk
) -> None:
    async def of_another_probe(job: JobContext, context: StationContext) -> Outcome:
        tell_old(job, context, "rotation")
        job.fire(Event.ACCEPTED)
        detail = await keep(job, context, rotation_record(station=STATION, probe="another", made_at=SECOND))
        return Outcome("calibrated", detail=detail)

    async with _running(tmp_path, calibrations, of_another_probe) as runner:
        result = await (await runner.submit(_request("rotation")))
    assert result.error is not None
    assert result.error.name == "calibration_failed"
    _says_the_truth(result, calibrations, "old", "rotation")


async def test_a_write_is_waited_for_even_if_its_job_is_cancelled() -> None:
    began, may_end, written = threading.Event(), threading.Event(), []

    def write(what: str) -> None:
        began.set()
        assert may_end.wait(PATIENCE_S)
        written.append(what)

    writing = asyncio.create_task(on_disk(write, "a stop"))
    await asyncio.to_thread(began.wait)
    writing.cancel()
    await _let_others_run()
    assert not writing.done()
    may_end.set()
    with pytest.raises(asyncio.CancelledError):
        await writing
    assert written == ["a stop"]


async def _let_others_run() -> None:
    """Give every task that can go on a few turns."""
    for _ in range(20):
        await asyncio.sleep(0)
