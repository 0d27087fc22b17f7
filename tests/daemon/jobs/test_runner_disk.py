"""A disk that takes nothing: no job is taken or told that is not written down, and the loop goes on."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult
from daemon.domain.states import State
from daemon.jobs.context import JobContext, Outcome
from tests.daemon.jobs.runner_at_work import (
    Gate,
    Line,
    at_work,
    looked,
)


async def test_a_job_that_cannot_be_written_down_is_not_taken(tmp_path: Path) -> None:
    async with at_work(tmp_path, looked) as line:
        line.journal.broken = True
        with pytest.raises(Fault) as caught:
            await line.ask()
        assert caught.value.kind is FaultCode.JOURNAL_FAILED
        line.journal.broken = False
        assert (await line.do()).ok, "its id is free again"


async def test_who_asks_for_a_job_that_cannot_be_written_down_is_told_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writing, may_fail = asyncio.Event(), asyncio.Event()

    async def add_job(_job_id: str, _op: str, _request: str) -> None:
        writing.set()
        await may_fail.wait()
        raise Fault(FaultCode.JOURNAL_FAILED, "the disk is full")

    async with at_work(tmp_path, looked) as line:
        monkeypatch.setattr(line.journal, "add_job", add_job)
        first = asyncio.create_task(line.ask())
        await writing.wait()
        second = await line.ask()
        may_fail.set()
        with pytest.raises(Fault):
            await first
        async with asyncio.timeout(10.0):
            with pytest.raises(Fault) as caught:
                await second
        assert caught.value.kind is FaultCode.JOURNAL_FAILED


async def test_a_full_disk_before_a_job_begins_is_its_answer_and_no_end_of_the_loop(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        first = await line.ask(job_id="first")
        await gate.began.wait()
        waiting = await line.ask(job_id="waiting")
        line.journal.broken = True
        gate.may_end.set()
        for done in (first, waiting):
            with pytest.raises(Fault) as unwritten:
                await done
            assert unwritten.value.kind is FaultCode.JOURNAL_FAILED
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.JOURNAL_FAILED
        line.journal.broken = False
        line.latch.clear(line.latch.causes)
        assert (await line.do(job_id="after")).ok, "the loop still runs jobs"
    assert "run waiting" not in line.did


async def test_images_that_cannot_be_drawn_do_not_end_the_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def keep(_folder: Path, _job: JobContext, _result: JobResult) -> None:
        raise ValueError("an image of no size")

    async def body(job: JobContext) -> Outcome:
        job.looks += 1
        return await looked(job)

    async with at_work(tmp_path, body) as line:
        monkeypatch.setattr(line.images, "keep", keep)
        assert (await line.do(job_id="first")).ok
        assert (await line.do(job_id="second")).ok
        assert line.latch.state is State.IDLE


async def test_a_result_that_cannot_be_written_is_told_to_nobody_until_it_is(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        done = await line.ask()
        await gate.began.wait()
        line.journal.broken = True
        gate.may_end.set()
        with pytest.raises(Fault) as unwritten:
            await done
        assert unwritten.value.kind is FaultCode.JOURNAL_FAILED
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.JOURNAL_FAILED
        assert (line.published.events, line.results) == ([], []), "a kill now would make it another result"
        with pytest.raises(Fault) as asked_again:
            await line.ask()
        assert asked_again.value.kind is FaultCode.JOURNAL_FAILED
        with pytest.raises(Fault):
            await line.runner.write_held_back()
        line.journal.broken = False
        await line.runner.write_held_back()
        result = await (await line.ask())
        assert (result.ok, result.outcome) == (True, "looked")
        assert line.published.events == [("result", result.model_dump(mode="json"))]
        await line.runner.write_held_back()
        assert len(line.published.events) == 1, "told once"
    assert line.did.count("run j") == 1


async def test_a_stop_while_a_result_is_being_written_loses_neither_the_result_nor_the_answer(tmp_path: Path) -> None:
    line = Line(tmp_path, looked)
    writing, may_write = asyncio.Event(), asyncio.Event()
    line.journal.before_result = lambda: _pause(writing, may_write)
    loop = asyncio.create_task(line.runner.run())
    done = await line.ask()
    await writing.wait()
    loop.cancel()
    await asyncio.sleep(0)
    loop.cancel()
    may_write.set()
    with contextlib.suppress(asyncio.CancelledError):
        await loop
    assert done.done(), "who waits is answered before the runner has ended"
    assert done.result().outcome == "looked"
    assert line.journal.jobs["j"].result == done.result()
    assert line.published.events == [("result", done.result().model_dump(mode="json"))]


async def _pause(began: asyncio.Event, may_go_on: asyncio.Event) -> None:
    began.set()
    await may_go_on.wait()
