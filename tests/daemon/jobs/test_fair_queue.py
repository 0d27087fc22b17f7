"""Clients are served in turn and each within its share."""

import asyncio
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.fair_queue import FairQueue
from daemon.jobs.runner import JobRunner
from daemon.server.rate_limit import BUCKETS, RateLimit
from daemon.storage.journal import Journal
from daemon.wire.operations.jobs import Place
from tests.daemon.clock import Clock
from tests.daemon.jobs.surroundings import LIMITS, surroundings


async def test_one_who_sends_much_does_not_hold_up_one_who_sends_little() -> None:
    queue: FairQueue[str] = FairQueue()
    for n in range(5):
        queue.put("much", f"much{n}")
    queue.put("little", "little0")
    queue.put("other", "other0")
    queue.put("little", "little1")
    taken = [await queue.get() for _ in range(len(queue))]
    assert taken == ["much0", "little0", "other0", "much1", "little1", "much2", "much3", "much4"]
    assert len(queue) == 0


def _count_without_end(queue: FairQueue[int], ended: threading.Event) -> None:
    while not ended.is_set():
        len(queue)


async def test_a_scrape_counts_from_another_thread_while_clients_come_and_go() -> None:
    queue: FairQueue[int] = FairQueue()
    ended, before = threading.Event(), sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        scrape = asyncio.create_task(asyncio.to_thread(_count_without_end, queue, ended))
        for n in range(20_000):
            queue.put(f"client {n % 40}", n)
            if n % 40 == 39:
                for _ in range(40):
                    await queue.get()
            if n % 400 == 0:
                await asyncio.sleep(0)
        ended.set()
        await scrape
    finally:
        ended.set()
        sys.setswitchinterval(before)


async def test_whoever_waits_gets_what_comes_and_a_wait_given_up_takes_nothing() -> None:
    queue: FairQueue[int] = FairQueue()
    waiting = asyncio.create_task(queue.get())
    await asyncio.sleep(0)
    waiting.cancel()
    await asyncio.wait([waiting])
    queue.put("a", 7)
    assert await queue.get() == 7


def _place(n: int) -> Place:
    return Place(op="place", id=f"j{n}", board_um=(float(n), 0.0))


async def test_jobs_are_bounded_per_client_and_in_all_and_the_refusal_names_both(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    jobs = JobRunner(surroundings(journal=journal, limits=lambda: replace(LIMITS, queue_per_client=3)))
    for n in range(3):
        await jobs.submit(_place(n), "flood")
    with pytest.raises(Fault, match="of this client") as caught:
        await jobs.submit(_place(3), "flood")
    assert caught.value.kind is FaultCode.BUSY
    assert caught.value.detail["limit_per_client"] == 3
    assert caught.value.detail["limit"] == 4
    await jobs.submit(_place(4), "a")
    await jobs.submit(_place(5), "b")
    with pytest.raises(Fault, match="5 jobs are open"):
        await jobs.submit(_place(6), "c")
    same = await jobs.submit(_place(0), "somebody else with the same id")
    assert same is await jobs.submit(_place(0), "flood")
    await journal.close()


def test_a_burst_is_taken_and_more_is_refused_with_how_long_to_wait() -> None:
    clock = Clock(0.0)
    limit = RateLimit(per_s=10.0, burst=5, now_s=clock)
    for _ in range(5):
        limit.spend("a")
    with pytest.raises(Fault) as caught:
        limit.spend("a")
    assert caught.value.kind is FaultCode.RATE_LIMITED
    assert caught.value.detail["retry_after_ms"] == 100
    limit.spend("b")
    clock.now_s = 0.1
    limit.spend("a")
    with pytest.raises(Fault):
        limit.spend("a")
    clock.now_s = 1000.0
    for _ in range(5):
        limit.spend("a")
    with pytest.raises(Fault):
        limit.spend("a")


def test_however_many_clients_come_only_so_many_are_remembered() -> None:
    limit = RateLimit(per_s=1.0, burst=1, now_s=Clock())
    for n in range(3 * BUCKETS):
        limit.spend(str(n))
    assert limit.remembered == BUCKETS
