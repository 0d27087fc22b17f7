"""The journal watch: a full disk is a fault that ends by itself, a deleted journal one that waits for `reset`."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from daemon.app.announcer import Announcer
from daemon.app.journal_watch import ALERT, JournalWatch
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import State
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.observer import JobObserver
from daemon.storage.journal import Journal
from tests.daemon.jobs.surroundings import Published, idle_latch
from tests.daemon.storage.small_disk import fill, make_room, small_disk

FULL = FaultCode.JOURNAL_FAILED


class _Flags(JobObserver):
    def __init__(self) -> None:
        self.told: list[tuple[str, bool]] = []

    def on_flag(self, name: str, message: str | None) -> None:
        self.told.append((name, message is not None))


class _House:
    """A journal on a small disk, and who looks after it."""

    def __init__(self, journal: Journal, latch: FaultLatch) -> None:
        self.journal, self.latch, self.flags, self.published = journal, latch, _Flags(), Published()
        nobody: Any = None
        self.announcer = Announcer(self.published, journal, nobody, nobody, "s", "0")
        self.held_back: list[str] = []
        self.watch = JournalWatch(journal, latch, self.flags, self.announcer.report_interrupted, self._write_held_back)

    async def _write_held_back(self) -> None:
        if self.latch.causes:
            await self.journal.keep("held back", {})
            self.held_back.append(self.latch.state.value)


@contextlib.asynccontextmanager
async def _house(folder: Path, latch: FaultLatch | None = None) -> AsyncIterator[_House]:
    house = _House(await Journal.open(folder / "journal.sqlite"), latch or idle_latch())
    try:
        yield house
    finally:
        await house.journal.close()


@pytest.fixture
def disk(tmp_path: Path) -> Any:
    with small_disk(tmp_path / "disk") as folder:
        yield folder


async def test_a_full_disk_is_a_fault_with_an_alert_and_work_goes_on_by_itself_when_there_is_room(disk: Path) -> None:
    async with _house(disk) as house:
        await house.watch.look()
        assert house.latch.state is State.IDLE
        fill(disk)
        await house.watch.look()
        await house.watch.look()
        assert (house.latch.state, [c.kind for c in house.latch.causes]) == (State.FAULT, [FULL])
        assert house.flags.told == [(ALERT, True)], "told once"
        assert house.held_back == []
        make_room(disk)
        await house.watch.look()
        assert (house.latch.state, house.latch.fault) == (State.IDLE, None)
        assert house.flags.told[1:] == [(ALERT, False)]
        assert house.held_back == ["fault"], "written before any job is taken"


async def test_another_fault_stays_when_there_is_room_again(disk: Path) -> None:
    async with _house(disk) as house:
        house.latch.latch(Fault(FaultCode.EMERGENCY_STOP))
        fill(disk)
        await house.watch.look()
        assert [c.kind for c in house.latch.causes] == [FULL, FaultCode.EMERGENCY_STOP]
        make_room(disk)
        await house.watch.look()
        assert [c.kind for c in house.latch.causes] == [FaultCode.EMERGENCY_STOP]


async def test_a_running_job_is_not_torn_from_its_state(disk: Path) -> None:
    async with _house(disk) as house:
        house.latch.begin("look", "j")
        fill(disk)
        await house.watch.look()
        assert house.latch.state is State.TRIGGERED
        assert house.flags.told == [(ALERT, True)]


async def test_what_a_kill_cut_off_is_told_once_the_journal_can_be_written(disk: Path) -> None:
    async with _house(disk) as house:
        await house.watch.look()
        await house.journal.add_job("cut", "home", "{}")
    fill(disk)
    async with _house(disk) as house:
        await house.watch.look()
        assert house.latch.state is State.FAULT
        assert house.published.events == []
        make_room(disk)
        await house.watch.look()
        assert house.latch.state is State.IDLE
        assert [(topic, body["id"], body["error"]["name"]) for topic, body in house.published.events] == [
            ("result", "cut", "interrupted")
        ]
        await house.journal.add_job("own", "home", "{}")
        await house.announcer.report_interrupted()
        assert len(house.published.events) == 1, "a job of this daemon is not interrupted"


async def test_a_deleted_journal_waits_for_a_reset(tmp_path: Path) -> None:
    async with _house(tmp_path) as house:
        await house.watch.look()
        (tmp_path / "journal.sqlite").unlink()
        await house.watch.look()
        await house.watch.look()
        assert house.latch.state is State.FAULT
        assert await house.journal.mend() is None
        house.latch.clear(house.latch.causes)
        await house.watch.look()
        assert house.latch.state is State.IDLE


async def test_a_failed_write_is_looked_at_at_once(tmp_path: Path) -> None:
    async with _house(tmp_path) as house:
        seen = asyncio.Event()
        house.latch.subscribe(lambda _change: seen.set())
        running = asyncio.create_task(house.watch.run())
        await house.journal.touches()  # the first look is over
        (tmp_path / "journal.sqlite").unlink()
        with pytest.raises(Fault):
            await house.journal.add_job("a", "home", "{}")
        await seen.wait()
        assert house.latch.fault is not None
        assert house.latch.fault.kind is FULL
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running
