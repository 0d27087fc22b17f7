"""The job runner: an id always gets the same answer, and every end of a job is told in the same order."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, cast

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult
from daemon.domain.states import Event, State
from daemon.jobs.context import JobContext, Outcome
from daemon.jobs.runner import JobRunner
from daemon.platform.clock import utc_now
from daemon.storage.journal import Journal
from daemon.wire.operations.jobs import Place
from drivers.errors import LightError, Stalled
from tests.daemon.jobs.runner_at_work import (
    HOME,
    WRITTEN,
    Gate,
    Line,
    at_work,
    looked,
    raising,
)
from tests.daemon.jobs.surroundings import surroundings


async def test_a_known_id_is_answered_from_the_journal_and_only_for_the_same_request(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.add_job("a", "home", WRITTEN)
    result = JobResult(id="a", op="home", ok=True, seq=1, station="s", finished_at=utc_now(), outcome="homed")
    await journal.finish_job(result)
    jobs = JobRunner(surroundings(journal=journal))
    assert await (await jobs.submit(HOME)) == result
    with pytest.raises(Fault) as caught:
        await jobs.submit(Place(op="place", id="a", test_point="TP1"))
    assert caught.value.kind is FaultCode.ID_REUSED
    await journal.close()


async def test_a_job_whose_result_was_never_written_is_an_error_and_no_endless_wait(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.add_job("a", "home", WRITTEN)
    with pytest.raises(Fault) as caught:
        await JobRunner(surroundings(journal=journal)).submit(HOME)
    assert caught.value.kind is FaultCode.JOURNAL_FAILED
    await journal.close()


async def test_a_job_that_ends_well_is_written_published_and_answered(tmp_path: Path) -> None:
    async with at_work(tmp_path, looked) as line:
        result = await line.do()
        assert (result.ok, result.outcome, result.test_point, result.error) == (True, "looked", "TP1", None)
        assert (result.error_before_um, result.detail, result.pictures) == (3.0, {"n": 1}, None)
        assert line.journal.jobs["j"].result == result
        assert ("result", result.model_dump(mode="json")) in line.published.events
        assert line.results == [result]
        assert line.latch.state is State.IDLE
        assert line.runner.running is None
    assert line.did == ["run j", "dark", "observed"]


async def test_the_same_id_under_way_is_the_same_job_and_another_request_with_it_is_refused(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        first = await line.ask()
        await gate.began.wait()
        running = line.runner.running
        assert running is not None
        assert running.id == "j"
        assert await line.ask(wait=True, deadline_ms=5.0) is first, "neither is part of what is asked"
        with pytest.raises(Fault) as reused:
            await line.ask("home")
        assert reused.value.kind is FaultCode.ID_REUSED
        gate.may_end.set()
        await first
        assert (await (await line.ask())).id == "j", "it is answered from the journal"
    assert line.did.count("run j") == 1


@pytest.mark.parametrize("error", [Fault(FaultCode.TIP_NOT_FOUND), Fault(FaultCode.UNDECIDED)])
async def test_a_recognition_fault_clears_itself(tmp_path: Path, error: Fault) -> None:
    async with at_work(tmp_path, raising(error, Event.ACCEPTED)) as line:
        why: list[Fault | None] = []
        line.latch.subscribe(lambda change: why.append(change.fault) if change.after is State.FAULT else None)
        result = await line.do()
        assert why == [error], "in fault it says why, also for a moment"
        assert result.error is not None
        assert (result.ok, result.outcome, result.error.name) == (False, "failed", error.kind.wire_name)
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)
        assert line.images.failed == [True]


async def test_a_refusal_before_anything_was_done_leads_back_to_idle(tmp_path: Path) -> None:
    seen: list[tuple[State, Event]] = []
    async with at_work(tmp_path, raising(Fault(FaultCode.OUTSIDE_ENVELOPE))) as line:
        line.latch.subscribe(lambda change: seen.append((change.after, change.event)))
        assert not (await line.do()).ok
    assert seen == [(State.TRIGGERED, Event.TRIGGER), (State.IDLE, Event.REFUSED)]


async def test_a_latched_fault_of_a_refused_job_is_a_fault_all_the_same(tmp_path: Path) -> None:
    async with at_work(tmp_path, raising(Stalled("x", device="x"))) as line:
        await line.do()
        assert line.latch.state is State.FAULT


async def test_a_latched_fault_stays_and_the_next_job_is_refused_with_it(tmp_path: Path) -> None:
    async with at_work(tmp_path, raising(Stalled("stuck", device="x"), Event.ACCEPTED)) as line:
        result = await line.do()
        assert result.error is not None
        assert result.error.name == "axis_stalled"
        assert line.latch.state is State.FAULT
        with pytest.raises(Fault) as refused:
            await line.ask(job_id="next")
        assert refused.value.kind is FaultCode.IN_FAULT
        assert refused.value.detail["first_cause"]["name"] == "axis_stalled"


async def test_a_job_that_waited_while_a_fault_was_latched_is_refused_when_its_turn_comes(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        first = await line.ask(job_id="first")
        await gate.began.wait()
        waiting = await line.ask(job_id="waiting")
        assert line.runner.queued == 1
        line.latch.latch(Fault(FaultCode.LINK_LOST))
        gate.may_end.set()
        await first
        result = await waiting
        assert result.error.name == "in_fault"
        assert "run waiting" not in line.did


async def test_an_error_nobody_expected_is_internal_and_latched(tmp_path: Path) -> None:
    async with at_work(tmp_path, raising(RuntimeError("a bug"), Event.ACCEPTED)) as line:
        result = await line.do()
        assert result.error is not None
        assert result.error.name == "internal"
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.INTERNAL


async def test_lights_that_stay_on_are_a_fault_and_never_hide_how_the_job_ended(tmp_path: Path) -> None:
    async with at_work(tmp_path, looked) as line:
        line.station.lamp_error = LightError("stuck", device="lights")
        assert (await line.do()).ok
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.LIGHT_FAILED
    async with at_work(tmp_path, raising(Stalled("x", device="x"), Event.ACCEPTED)) as line:
        line.station.lamp_error = LightError("stuck", device="lights")
        result = await line.do()
        assert result.error is not None
        assert result.error.name == "axis_stalled"
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.AXIS_STALLED, "its own trouble came first"


async def test_homing_that_began_and_did_not_end_leaves_not_homed(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        done = await line.ask("home")
        await gate.began.wait()
        line.runner.cancel("j")
        await done
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.NOT_HOMED
        assert "homing ended early" in line.latch.fault.message


async def test_homing_that_never_left_its_place_leaves_a_homed_station_idle(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        first = await line.ask(job_id="first")
        await gate.began.wait()
        late = await line.ask("home", "late", deadline_ms=1.0)
        await asyncio.sleep(0.005)
        gate.may_end.set()
        await first
        assert (await late).error.name == "stale_deadline"
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)
    assert "run late" not in line.did


async def test_homing_leaves_not_homed_only_at_its_end(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path, gate) as line:
        line.latch.latch(Fault(FaultCode.NOT_HOMED))
        done = await line.ask("home")
        await gate.began.wait()
        gate.may_end.set()
        assert (await done).ok
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)


@pytest.mark.parametrize("error", [Fault(FaultCode.JOURNAL_FAILED), TypeError("not JSON")])
async def test_a_look_that_cannot_be_noted_does_not_cost_the_result(tmp_path: Path, error: Exception) -> None:
    async def body(job: JobContext) -> Outcome:
        job.fire(Event.ACCEPTED)
        job.note("look", {"tip": 1})
        return Outcome("looked")

    async with at_work(tmp_path, body) as line:
        line.journal.step_error = error
        result = await line.do()
        assert result.ok
        assert line.journal.jobs["j"].result == result
        assert line.latch.fault is None


async def test_steps_progress_and_images_go_where_they_belong(tmp_path: Path) -> None:
    async def body(job: JobContext) -> Outcome:
        job.fire(Event.ACCEPTED)
        job.note("look", {"tip": 1})
        job.progress(1, 4, "looking")
        assert line.runner.progress == {"done": 1, "total": 4, "doing": "looking"}
        job.saw(cast("Any", object()))
        return Outcome("looked")

    line = Line(tmp_path, body)
    loop = asyncio.create_task(line.runner.run())
    result = await line.do()
    await line.do(job_id="second")  # the images of the first are kept before it begins
    loop.cancel()
    assert line.journal.steps[0] == ("j", "look", {"tip": 1})
    assert line.observer.steps[0] == ("j", "look")
    assert ("progress", {"job": "j", "op": "look", "done": 1, "total": 4, "doing": "looking"}) in line.published.events
    assert (result.looks, result.pictures) == (1, str(tmp_path / "j"))
    assert line.images.kept[0] == "j"
    assert line.observer.flags[0] == ("pictures_not_kept", None)


async def test_progress_of_a_job_is_gone_when_the_next_begins(tmp_path: Path) -> None:
    seen: list[Any] = []

    async def body(job: JobContext) -> Outcome:
        seen.append(line.runner.progress)
        job.progress(1, 2, "looking")
        return await looked(job)

    line = Line(tmp_path, body)
    loop = asyncio.create_task(line.runner.run())
    await line.do()
    await line.do(job_id="second")
    loop.cancel()
    assert seen == [None, None]
