"""The watchdog is fed by a job loop that turns over a job that lives, and by nothing else."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from daemon.jobs.runner import EXCLUSIVE_WITHIN_S, JobRunner
from daemon.jobs.station_lock import StationLock
from daemon.jobs.watchdog import GRACE_S, SILENT_S, UNWATCHED_EVERY_S, Watchdog
from daemon.storage.journal import Journal
from daemon.wire.operations.jobs import Home
from tests.daemon.jobs.surroundings import surroundings


class FakeManager:
    """A clock that is set by hand, and a count of meals."""

    def __init__(self) -> None:
        self.meals = 0
        self.now_s = 1000.0
        self.eaten = asyncio.Event()

    def feed(self) -> None:
        self.meals += 1
        self.eaten.set()

    def clock(self) -> float:
        return self.now_s

    def watchdog(self, every_s: float = 0.001) -> Watchdog:
        return Watchdog(self.feed, every_s, self.clock)


def test_a_loop_that_waits_for_work_feeds() -> None:
    dog = FakeManager()
    assert dog.watchdog().check_in()
    assert dog.meals == 1


def test_a_long_job_that_shows_something_is_no_hang() -> None:
    dog = FakeManager()
    watchdog = dog.watchdog()
    watchdog.begin(due_s=dog.now_s + 3600.0)
    for look in range(60):
        dog.now_s += SILENT_S / 2
        assert watchdog.check_in(look), "an hour of calibration, a look a minute"
    assert dog.meals == 60


def test_a_job_that_shows_nothing_is_a_hang_long_before_its_deadline() -> None:
    dog = FakeManager()
    watchdog = dog.watchdog()
    watchdog.begin(due_s=dog.now_s + 3600.0)
    assert watchdog.check_in("a look")
    dog.now_s += SILENT_S - 1.0
    assert watchdog.check_in("a look")
    dog.now_s += 2.0
    assert not watchdog.check_in("a look")
    assert dog.meals == 2
    assert watchdog.check_in("another look"), "it was only slow"


def test_a_job_past_its_deadline_is_a_hang_however_busy_it_is() -> None:
    dog = FakeManager()
    watchdog = dog.watchdog()
    watchdog.begin(due_s=dog.now_s + 60.0)
    dog.now_s += 60.0 + GRACE_S - 1.0
    assert watchdog.check_in(1)
    dog.now_s += 2.0
    assert not watchdog.check_in(2)
    watchdog.end()
    assert watchdog.check_in(), "the next job is another one's trouble"


@pytest.mark.parametrize("over_s", [0.0, 0.5])
def test_a_job_has_its_whole_grace_and_its_whole_silence(over_s: float) -> None:
    dog = FakeManager()
    watchdog = dog.watchdog()
    watchdog.begin(due_s=dog.now_s + 10.0)
    dog.now_s += 10.0 + GRACE_S + over_s
    assert watchdog.check_in("a look") is (over_s == 0.0)
    watchdog.begin(due_s=dog.now_s + 3600.0)
    dog.now_s += SILENT_S + over_s
    assert watchdog.check_in() is (over_s == 0.0)


def test_a_hang_is_logged_once_for_each_job_with_what_is_wrong() -> None:
    dog = FakeManager()
    watchdog = dog.watchdog()
    with capture_logs() as logs:
        for job in (1, 2):
            watchdog.begin(due_s=dog.now_s + 10.0)
            assert watchdog.check_in(job)
            dog.now_s += 10.0 + GRACE_S + 7.0
            assert not watchdog.check_in(job)
            assert not watchdog.check_in(job)
        watchdog.begin(due_s=dog.now_s + 3600.0)
        dog.now_s += SILENT_S + 5.0
        assert not watchdog.check_in()
    assert [(line["event"], line["why"]) for line in logs] == [
        ("job_hangs", f"it should have ended {GRACE_S + 7.0:.0f} s ago"),
        ("job_hangs", f"it should have ended {GRACE_S + 7.0:.0f} s ago"),
        ("job_hangs", f"nothing has come from it for {SILENT_S + 5.0:.0f} s"),
    ]


def test_the_loop_turns_as_often_as_the_manager_asks_and_by_itself_where_none_asks() -> None:
    assert Watchdog(every_s=0.5).every_s == 0.5
    assert Watchdog().every_s == UNWATCHED_EVERY_S


def _jobs(watchdog: Watchdog) -> JobRunner:
    return JobRunner(surroundings(watchdog=watchdog))


async def test_the_job_loop_itself_feeds_and_a_loop_that_ended_does_not() -> None:
    dog = FakeManager()
    loop = asyncio.create_task(_jobs(dog.watchdog()).run())
    for _ in range(3):
        dog.eaten.clear()
        await dog.eaten.wait()
    loop.cancel()
    with pytest.raises(asyncio.CancelledError):
        await loop
    meals = dog.meals
    for _ in range(100):
        await asyncio.sleep(0)
    assert dog.meals == meals, "no task outlives the loop to feed for it"


async def test_a_job_loop_that_waits_for_a_reset_feeds_but_not_without_end(tmp_path: Path) -> None:
    dog = FakeManager()
    journal = await Journal.open(tmp_path / "j.sqlite")
    lock = StationLock()
    jobs = JobRunner(surroundings(watchdog=dog.watchdog(), lock=lock, journal=journal))
    loop = asyncio.create_task(jobs.run())
    async with lock.hold("reset"):
        await jobs.submit(Home(op="home", id="a"))
        await dog.eaten.wait()
        dog.eaten.clear()
        await dog.eaten.wait()  # it waits for the lock, and says that it lives
        dog.now_s += EXCLUSIVE_WITHIN_S
        meals = dog.meals
        for _ in range(100):
            await asyncio.sleep(0.0005)
        assert dog.meals == meals, "no reset takes so long"
    loop.cancel()
    with pytest.raises(asyncio.CancelledError):
        await loop
    await journal.close()


async def test_a_job_that_hangs_is_waited_for_and_starves_the_watchdog() -> None:
    dog = FakeManager()
    watchdog = dog.watchdog()
    watchdog.begin(due_s=dog.now_s + 60.0)
    never = asyncio.get_running_loop().create_future()

    async def hung() -> None:
        await never

    turns = 0
    starved = asyncio.Event()

    def activity() -> int:
        nonlocal turns
        turns += 1
        dog.now_s += 10.0
        if turns == 30:
            starved.set()
        return 0

    task = asyncio.create_task(hung())
    attending = asyncio.create_task(watchdog.supervise(task, activity))
    await starved.wait()
    fed_for = (60.0 + GRACE_S) / 10.0
    assert dog.meals <= fed_for < turns
    attending.cancel()
    with pytest.raises(asyncio.CancelledError):
        await attending
    assert task.cancelled(), "stopping the daemon reaches it all the same"


async def test_a_job_that_fails_ends_the_loop_with_its_error() -> None:
    watchdog = FakeManager().watchdog()
    watchdog.begin(due_s=2000.0)

    async def broken() -> None:
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        await watchdog.supervise(asyncio.create_task(broken()), lambda: 0)


def test_waiting_for_something_else_feeds_for_as_long_as_it_may_take() -> None:
    dog = FakeManager()
    still_waiting = dog.watchdog().patience(60.0)
    for _ in range(3):
        still_waiting()
    assert dog.meals == 3
    dog.now_s += 60.0
    still_waiting()
    assert dog.meals == 3


def test_where_several_are_before_it_each_may_take_as_long() -> None:
    dog = FakeManager()
    turns = [1]
    still_waiting = dog.watchdog().patience(60.0, lambda: turns[0])
    dog.now_s += 40.0
    still_waiting()
    turns[0] = 2
    dog.now_s += 40.0
    still_waiting()
    assert dog.meals == 2
    dog.now_s += 60.0
    still_waiting()
    assert dog.meals == 2, "the second takes too long"
