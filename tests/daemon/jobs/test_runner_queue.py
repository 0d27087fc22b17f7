"""Jobs that wait: cancelled, paused, out of time, without a client, or left when the daemon stops."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event, State
from daemon.jobs.context import JobContext, Outcome
from daemon.jobs.runner import JobRunner
from tests.daemon.jobs.runner_at_work import (
    Gate,
    Line,
    at_work,
    looked,
    raising,
)
from tests.daemon.jobs.surroundings import surroundings


async def test_cancelling_the_running_job_stops_motion_and_leaves_idle(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        done = await line.ask()
        await gate.began.wait()
        assert line.runner.cancel(None) == "j"
        result = await done
        assert result.error.name == "cancelled"
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)
    assert line.did == ["run j", "stop", "dark", "observed"]


async def test_a_job_whose_clients_key_was_taken_back_while_it_waited_never_begins(tmp_path: Path) -> None:
    gate = Gate()
    revoked: list[tuple[str, str]] = []

    def refusal(client: str, op: str) -> Fault | None:
        return Fault(FaultCode.KEY_REVOKED) if (client, op) in revoked else None

    async with at_work(tmp_path, gate, refusal=refusal) as line:
        first = await line.ask(job_id="first", client="kim")
        await gate.began.wait()
        revoked.append(("kim", "home"))
        waiting = await line.ask("home", job_id="waiting", client="kim")
        others = await line.ask("home", job_id="others", client="lee")
        gate.may_end.set()
        assert (await first).ok, "what runs already is not torn away"
        assert (await waiting).error.name == "key_revoked"
        assert (await others).ok
        assert line.latch.state is State.IDLE
    assert [what for what in line.did if what.startswith("run")] == ["run first", "run others"]


async def test_a_job_cancelled_while_it_waits_never_begins(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        first = await line.ask(job_id="first")
        await gate.began.wait()
        waiting = await line.ask("home", job_id="waiting")
        assert line.runner.cancel("waiting") == "waiting"
        gate.may_end.set()
        await first
        assert (await waiting).error.name == "cancelled"
        assert line.latch.state is State.IDLE, "homing that never began has lost nothing"
        for unknown in ("gone", None):
            with pytest.raises(Fault) as caught:
                line.runner.cancel(unknown)
            assert caught.value.kind is FaultCode.UNKNOWN_JOB
    assert "run waiting" not in line.did


async def test_only_a_run_that_is_under_way_is_paused(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        look = await line.ask(job_id="look")
        await gate.began.wait()
        for name in (None, "look"):
            with pytest.raises(Fault) as caught:
                line.runner.pause(name)
            assert caught.value.kind is FaultCode.UNKNOWN_JOB
        gate.may_end.set()
        await look
    gate, jobs = Gate(), []

    async def running(job: JobContext) -> Outcome:
        jobs.append(job)
        return await gate(job)

    async with at_work(tmp_path, running) as line:
        run = await line.ask("run", job_id="run", plan="six", board_id="b17")
        await gate.began.wait()
        with pytest.raises(Fault, match="no such run"):
            line.runner.pause("other")
        assert not jobs[0].pausing
        assert line.runner.pause(None) == line.runner.pause("run") == "run"
        assert jobs[0].pausing
        gate.may_end.set()
        await run


async def test_a_jog_is_never_queued_and_the_same_one_is_taken_once(tmp_path: Path) -> None:
    gate = Gate()
    step = {"axis": "x", "by_um": 100.0}
    async with at_work(tmp_path, gate) as line:
        look = await line.ask(job_id="look")
        for _ in range(2):  # while the look waits for its turn, and while it runs
            with pytest.raises(Fault) as caught:
                await line.ask("jog", "early", **step)
            assert caught.value.kind is FaultCode.BUSY
            await gate.began.wait()
        gate.may_end.set()
        await look
        gate.began.clear()
        gate.may_end.clear()
        first = await line.ask("jog", "one", **step)
        await gate.began.wait()
        assert await line.ask("jog", "one", **step) is first
        with pytest.raises(Fault) as caught:
            await line.ask("jog", "two", **step)
        assert caught.value.kind is FaultCode.BUSY
        gate.may_end.set()
        assert (await first).ok
    assert [did for did in line.did if did.startswith("run")] == ["run look", "run one"]


async def test_a_job_that_runs_out_of_time_stops_and_leaves_idle(tmp_path: Path) -> None:
    async with at_work(tmp_path, Gate()) as line:
        result = await line.do(deadline_ms=30.0)
        assert result.error is not None
        assert result.error.name == "deadline_missed"
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)
    assert line.did == ["run j", "stop", "dark", "observed"]


async def test_a_time_out_inside_of_a_job_is_not_taken_for_its_deadline(tmp_path: Path) -> None:
    async with at_work(tmp_path, raising(TimeoutError("inside"), Event.ACCEPTED)) as line:
        result = await line.do()
        assert result.error is not None
        assert result.error.name == "internal"
        assert "stop" not in line.did


async def test_a_deadline_that_passed_while_the_job_waited_is_stale(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        first = await line.ask(job_id="first")
        await gate.began.wait()
        late = await line.ask(job_id="late", deadline_ms=1.0)
        await asyncio.sleep(0.005)
        gate.may_end.set()
        await first
        assert (await late).error.name == "stale_deadline"
        assert line.latch.state is State.IDLE
    assert "run late" not in line.did


@pytest.mark.parametrize(("op", "fields", "seconds"), [("look", {}, 60.0), ("calibrate", {"what": "map"}, 600.0)])
async def test_without_a_deadline_of_its_own_a_job_has_the_configured_one(
    tmp_path: Path, op: str, fields: dict[str, Any], seconds: float
) -> None:
    left: list[float] = []

    async def body(job: JobContext) -> Outcome:
        left.append(job.deadline.remaining_s)
        return await looked(job)

    line = Line(tmp_path, body)
    line.runner = JobRunner(
        surroundings(
            latch=line.latch, journal=line.journal, images=line.images, context=lambda: line.context,
            procedures=dict.fromkeys(("look", "calibrate"), lambda job, _context: body(job)),
        )
    )  # fmt: skip
    loop = asyncio.create_task(line.runner.run())
    assert (await line.do(op, **fields)).ok
    loop.cancel()
    assert left[0] == pytest.approx(seconds, abs=20.0)


async def test_a_daemon_that_stops_ends_the_running_job_and_stops_motion(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        done = await line.ask()
        await gate.began.wait()
    assert (await done).error.name == "shutting_down"
    assert line.did == ["run j", "stop", "dark", "observed"]
    assert line.latch.state is State.IDLE


async def test_jobs_that_wait_when_the_daemon_stops_are_answered(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        await line.ask(job_id="first")
        await gate.began.wait()
        waiting = [await line.ask(job_id=job_id) for job_id in ("second", "third")]
    await line.runner.refuse_waiting()
    async with asyncio.timeout(10.0):
        assert [(await done).error.name for done in waiting] == ["shutting_down", "shutting_down"]
    assert line.did.count("run second") == 0
    assert all(stored.result is not None for stored in line.journal.jobs.values()), "the next daemon has none to end"


async def test_a_daemon_that_closes_takes_no_jobs(tmp_path: Path) -> None:
    line = Line(tmp_path)
    line.latch.closing()
    with pytest.raises(Fault) as caught:
        await line.ask()
    assert caught.value.kind is FaultCode.SHUTTING_DOWN


async def test_a_station_that_is_not_open_refuses_and_an_unknown_point_is_refused_at_once(tmp_path: Path) -> None:
    async with at_work(tmp_path, looked) as line:
        with pytest.raises(Fault) as unknown:
            await line.ask(test_point="nowhere")
        assert unknown.value.kind is FaultCode.UNKNOWN_TEST_POINT
        assert "j" not in line.journal.jobs
        line.open = False
        result = await line.do(test_point="nowhere")
        assert result.error is not None
        assert result.error.message == "the station is not open"
