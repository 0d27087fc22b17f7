"""The station's lock: in turn, and nobody who gives up takes it along."""

from __future__ import annotations

import asyncio

import pytest

from daemon.jobs.station_lock import Holder, StationLock


async def _hold(lock: StationLock, holder: Holder, order: list[str], every_s: float | None = None) -> None:
    async with lock.hold(holder, every_s=every_s):
        order.append(holder)


async def test_who_looks_about_while_waiting_keeps_the_place_in_the_line() -> None:
    lock, looked, order = StationLock(), asyncio.Event(), list[str]()

    async def job() -> None:
        async with lock.hold("job", every_s=0.001, still_waiting=looked.set):
            order.append("job")

    async with lock.hold("reset"):
        waiting = [asyncio.create_task(job())]
        await asyncio.sleep(0)
        waiting.append(asyncio.create_task(_hold(lock, "reload", order)))
        await looked.wait()
        looked.clear()
        await looked.wait()
        assert (lock.holder, lock.turns) == ("reset", 1)
    async with asyncio.timeout(10.0):
        await asyncio.gather(*waiting)
    assert order == ["job", "reload"], "else who comes often could keep it out without end"
    assert (lock.holder, lock.turns) == (None, 3)


async def test_who_gives_up_waiting_raises_why_and_leaves_the_line() -> None:
    lock, order = StationLock(), list[str]()

    def give_up() -> None:
        raise LookupError

    async with lock.hold("job"):
        with pytest.raises(LookupError):
            async with lock.hold("reset", every_s=0.001, still_waiting=give_up):
                order.append("reset")
    async with asyncio.timeout(10.0):
        await _hold(lock, "reload", order)
    assert order == ["reload"]


@pytest.mark.parametrize("turns", range(6))
async def test_who_is_cancelled_at_any_moment_of_taking_it_never_keeps_it(turns: int) -> None:
    lock, order = StationLock(), list[str]()
    async with lock.hold("job"):
        waiting = asyncio.create_task(_hold(lock, "reset", order, every_s=1.0))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
    for _ in range(turns):
        await asyncio.sleep(0)
    waiting.cancel()
    await asyncio.wait([waiting])
    async with asyncio.timeout(10.0):
        await _hold(lock, "reload", order)
    assert order[-1] == "reload"
    assert lock.holder is None
