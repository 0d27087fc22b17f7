"""The job runner: an id always gets the same answer, and every end of a job is told in the same order."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult
from daemon.domain.states import Event, State
from daemon.jobs.context import JobContext, Outcome
from daemon.jobs.observer import JobObserver
from daemon.jobs.runner import JobRunner
from daemon.platform.clock import utc_now
from daemon.station.needle import Needle
from daemon.storage.journal import Journal
from daemon.wire.example_parts import CONTACT
from daemon.wire.operations.jobs import AnyJob, Home, Place
from daemon.wire.operations.table import OPERATIONS
from drivers.errors import CameraError, EmergencyStop, LightError, LimitHit, LinkTimeout, Stalled
from drivers.gantry import Position
from tests.daemon.jobs.memory_journal import MemoryJournal
from tests.daemon.jobs.surroundings import LIMITS, Published, idle_latch, surroundings

SAFE_UM, WORK_UM, TOUCH_UM, PRESSED_UM = 12_000.0, 5_200.0, 5_000.0, 4_900.0
OPS = ("home", "lift", "place", "look", "correct", "touch", "run", "jog")
HOME = Home(op="home", id="a")
WRITTEN = HOME.model_dump_json(exclude={"wait", "deadline_ms"})
Body = Callable[[JobContext], Awaitable[Outcome]]


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


class _Station:
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


class _Observer(JobObserver):
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


class _Images:
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


class _Line:
    """A runner at work whose procedures are given by the test."""

    def __init__(self, folder: Path, body: Body | None = None, **more: Any) -> None:
        self.did: list[str] = []
        self.body = body
        self.latch, self.journal, self.published = idle_latch(), MemoryJournal(), Published()
        self.station, self.observer, self.images = _Station(self.did), _Observer(self.did), _Images(folder)
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
async def _line(folder: Path, body: Body | None = None, **more: Any) -> AsyncIterator[_Line]:
    line = _Line(folder, body, **more)
    loop = asyncio.create_task(line.runner.run())
    try:
        yield line
    finally:
        loop.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await loop


def _raising(error: Exception, *before: Event) -> Body:
    async def body(job: JobContext) -> Outcome:
        for event in before:
            job.fire(event)
        raise error

    return body


async def _looked(job: JobContext) -> Outcome:
    job.fire(Event.ACCEPTED)
    return Outcome("looked", test_point="TP1", error_before_um=3.0, detail={"n": 1})


class _Gate:
    """A procedure that begins, and ends when it is let."""

    def __init__(self) -> None:
        self.began, self.may_end = asyncio.Event(), asyncio.Event()

    async def __call__(self, job: JobContext) -> Outcome:
        job.fire(Event.ACCEPTED)
        self.began.set()
        await self.may_end.wait()
        return Outcome("looked")


async def test_a_job_that_ends_well_is_written_published_and_answered(tmp_path: Path) -> None:
    async with _line(tmp_path, _looked) as line:
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
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
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
    async with _line(tmp_path, _raising(error, Event.ACCEPTED)) as line:
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
    async with _line(tmp_path, _raising(Fault(FaultCode.OUTSIDE_ENVELOPE))) as line:
        line.latch.subscribe(lambda change: seen.append((change.after, change.event)))
        assert not (await line.do()).ok
    assert seen == [(State.TRIGGERED, Event.TRIGGER), (State.IDLE, Event.REFUSED)]


async def test_a_latched_fault_of_a_refused_job_is_a_fault_all_the_same(tmp_path: Path) -> None:
    async with _line(tmp_path, _raising(Stalled("x", device="x"))) as line:
        await line.do()
        assert line.latch.state is State.FAULT


async def test_a_latched_fault_stays_and_the_next_job_is_refused_with_it(tmp_path: Path) -> None:
    async with _line(tmp_path, _raising(Stalled("stuck", device="x"), Event.ACCEPTED)) as line:
        result = await line.do()
        assert result.error is not None
        assert result.error.name == "axis_stalled"
        assert line.latch.state is State.FAULT
        with pytest.raises(Fault) as refused:
            await line.ask(job_id="next")
        assert refused.value.kind is FaultCode.IN_FAULT
        assert refused.value.detail["first_cause"]["name"] == "axis_stalled"


async def test_a_job_that_waited_while_a_fault_was_latched_is_refused_when_its_turn_comes(tmp_path: Path) -> None:
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
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
    async with _line(tmp_path, _raising(RuntimeError("a bug"), Event.ACCEPTED)) as line:
        result = await line.do()
        assert result.error is not None
        assert result.error.name == "internal"
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.INTERNAL


async def test_lights_that_stay_on_are_a_fault_and_never_hide_how_the_job_ended(tmp_path: Path) -> None:
    async with _line(tmp_path, _looked) as line:
        line.station.lamp_error = LightError("stuck", device="lights")
        assert (await line.do()).ok
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.LIGHT_FAILED
    async with _line(tmp_path, _raising(Stalled("x", device="x"), Event.ACCEPTED)) as line:
        line.station.lamp_error = LightError("stuck", device="lights")
        result = await line.do()
        assert result.error is not None
        assert result.error.name == "axis_stalled"
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.AXIS_STALLED, "its own trouble came first"


async def test_cancelling_the_running_job_stops_motion_and_leaves_idle(tmp_path: Path) -> None:
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
        done = await line.ask()
        await gate.began.wait()
        assert line.runner.cancel(None) == "j"
        result = await done
        assert result.error.name == "cancelled"
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)
    assert line.did == ["run j", "stop", "dark", "observed"]


async def test_a_job_whose_clients_key_was_taken_back_while_it_waited_never_begins(tmp_path: Path) -> None:
    gate = _Gate()
    revoked: list[tuple[str, str]] = []

    def refusal(client: str, op: str) -> Fault | None:
        return Fault(FaultCode.KEY_REVOKED) if (client, op) in revoked else None

    async with _line(tmp_path, gate, refusal=refusal) as line:
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
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
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
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
        look = await line.ask(job_id="look")
        await gate.began.wait()
        for name in (None, "look"):
            with pytest.raises(Fault) as caught:
                line.runner.pause(name)
            assert caught.value.kind is FaultCode.UNKNOWN_JOB
        gate.may_end.set()
        await look
    gate, jobs = _Gate(), []

    async def running(job: JobContext) -> Outcome:
        jobs.append(job)
        return await gate(job)

    async with _line(tmp_path, running) as line:
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
    gate = _Gate()
    step = {"axis": "x", "by_um": 100.0}
    async with _line(tmp_path, gate) as line:
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
    async with _line(tmp_path, _Gate()) as line:
        result = await line.do(deadline_ms=30.0)
        assert result.error is not None
        assert result.error.name == "deadline_missed"
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)
    assert line.did == ["run j", "stop", "dark", "observed"]


async def test_a_time_out_inside_of_a_job_is_not_taken_for_its_deadline(tmp_path: Path) -> None:
    async with _line(tmp_path, _raising(TimeoutError("inside"), Event.ACCEPTED)) as line:
        result = await line.do()
        assert result.error is not None
        assert result.error.name == "internal"
        assert "stop" not in line.did


async def test_a_deadline_that_passed_while_the_job_waited_is_stale(tmp_path: Path) -> None:
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
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
        return await _looked(job)

    line = _Line(tmp_path, body)
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


async def test_homing_that_began_and_did_not_end_leaves_not_homed(tmp_path: Path) -> None:
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
        done = await line.ask("home")
        await gate.began.wait()
        line.runner.cancel("j")
        await done
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.NOT_HOMED
        assert "homing ended early" in line.latch.fault.message


async def test_homing_that_never_left_its_place_leaves_a_homed_station_idle(tmp_path: Path) -> None:
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
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
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
        line.latch.latch(Fault(FaultCode.NOT_HOMED))
        done = await line.ask("home")
        await gate.began.wait()
        gate.may_end.set()
        assert (await done).ok
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)


async def test_a_daemon_that_stops_ends_the_running_job_and_stops_motion(tmp_path: Path) -> None:
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
        done = await line.ask()
        await gate.began.wait()
    assert (await done).error.name == "shutting_down"
    assert line.did == ["run j", "stop", "dark", "observed"]
    assert line.latch.state is State.IDLE


async def test_jobs_that_wait_when_the_daemon_stops_are_answered(tmp_path: Path) -> None:
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
        await line.ask(job_id="first")
        await gate.began.wait()
        waiting = [await line.ask(job_id=job_id) for job_id in ("second", "third")]
    await line.runner.refuse_waiting()
    async with asyncio.timeout(10.0):
        assert [(await done).error.name for done in waiting] == ["shutting_down", "shutting_down"]
    assert line.did.count("run second") == 0
    assert all(stored.result is not None for stored in line.journal.jobs.values()), "the next daemon has none to end"


async def test_a_daemon_that_closes_takes_no_jobs(tmp_path: Path) -> None:
    line = _Line(tmp_path)
    line.latch.closing()
    with pytest.raises(Fault) as caught:
        await line.ask()
    assert caught.value.kind is FaultCode.SHUTTING_DOWN


async def test_a_station_that_is_not_open_refuses_and_an_unknown_point_is_refused_at_once(tmp_path: Path) -> None:
    async with _line(tmp_path, _looked) as line:
        with pytest.raises(Fault) as unknown:
            await line.ask(test_point="nowhere")
        assert unknown.value.kind is FaultCode.UNKNOWN_TEST_POINT
        assert "j" not in line.journal.jobs
        line.open = False
        result = await line.do(test_point="nowhere")
        assert result.error is not None
        assert result.error.message == "the station is not open"


async def test_a_job_that_cannot_be_written_down_is_not_taken(tmp_path: Path) -> None:
    async with _line(tmp_path, _looked) as line:
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

    async with _line(tmp_path, _looked) as line:
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
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
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
        return await _looked(job)

    async with _line(tmp_path, body) as line:
        monkeypatch.setattr(line.images, "keep", keep)
        assert (await line.do(job_id="first")).ok
        assert (await line.do(job_id="second")).ok
        assert line.latch.state is State.IDLE


async def test_a_result_that_cannot_be_written_is_told_to_nobody_until_it_is(tmp_path: Path) -> None:
    gate = _Gate()
    async with _line(tmp_path, gate) as line:
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
    line = _Line(tmp_path, _looked)
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


@pytest.mark.parametrize("error", [Fault(FaultCode.JOURNAL_FAILED), TypeError("not JSON")])
async def test_a_look_that_cannot_be_noted_does_not_cost_the_result(tmp_path: Path, error: Exception) -> None:
    async def body(job: JobContext) -> Outcome:
        job.fire(Event.ACCEPTED)
        job.note("look", {"tip": 1})
        return Outcome("looked")

    async with _line(tmp_path, body) as line:
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

    line = _Line(tmp_path, body)
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
        return await _looked(job)

    line = _Line(tmp_path, body)
    loop = asyncio.create_task(line.runner.run())
    await line.do()
    await line.do(job_id="second")
    loop.cancel()
    assert seen == [None, None]


# --- the needle -------------------------------------------------------------------------------------------------------


def _pressed(then: Body) -> Callable[[_Line], Body]:
    """Return a procedure that presses and goes on with something."""

    def of(line: _Line) -> Body:
        async def body(job: JobContext) -> Outcome:
            job.fire(Event.ACCEPTED)
            line.station.at(PRESSED_UM)
            return await then(job)

        return body

    return of


async def _done(_job: JobContext) -> Outcome:
    return Outcome("looked")


ENDS: dict[str, Body] = {
    "done": _done,
    "seen nothing": _raising(Fault(FaultCode.TIP_NOT_FOUND)),
    "camera gone": _raising(CameraError("silent", device="camera")),
    "a bug": _raising(RuntimeError("a bug")),
    "sideways": _raising(Fault(FaultCode.NEEDLE_DOWN)),
}


@pytest.mark.parametrize("end", ENDS)
async def test_however_a_job_ends_a_pressed_needle_is_raised_before_it_is_dark(tmp_path: Path, end: str) -> None:
    async with _line(tmp_path) as line:
        line.body = _pressed(ENDS[end])(line)
        states: list[tuple[State, int]] = []
        line.latch.subscribe(lambda change: states.append((change.after, len(line.did))))
        await line.do()
        assert line.did == ["run j", "raise", "dark", "observed"]
        assert states[-1][1] >= 3, "the last transition comes after all of it"
        assert line.station.needle.is_up
        assert all(cause.kind is not FaultCode.NEEDLE_DOWN for cause in line.latch.causes)


async def test_a_cancelled_job_stops_raises_and_darkens(tmp_path: Path) -> None:
    gate = _Gate()
    async with _line(tmp_path) as line:
        line.body = gate
        done = await line.ask()
        await gate.began.wait()
        line.station.at(PRESSED_UM)
        line.runner.cancel(None)
        assert (await done).error.name == "cancelled"
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)
    assert line.did == ["run j", "stop", "raise", "dark", "observed"]


async def test_a_deadline_over_a_pressed_needle_stops_raises_and_darkens(tmp_path: Path) -> None:
    async with _line(tmp_path) as line:
        line.body = _pressed(lambda _job: asyncio.sleep(3_600.0))(line)  # type: ignore[arg-type, return-value]
        assert (await line.do(deadline_ms=30.0)).error is not None
        assert line.latch.state is State.IDLE
    assert line.did == ["run j", "stop", "raise", "dark", "observed"]


async def test_a_daemon_that_is_stopped_twice_raises_the_needle_all_the_same(tmp_path: Path) -> None:
    """The second cancellation comes while the needle rises."""
    gate, rising, may_rise = _Gate(), asyncio.Event(), asyncio.Event()
    line = _Line(tmp_path, gate)

    async def retract(_deadline: Any) -> None:
        rising.set()
        await may_rise.wait()
        line.station.at(SAFE_UM)
        line.did.append("raise")

    line.station.retract = retract  # type: ignore[method-assign]
    loop = asyncio.create_task(line.runner.run())
    await line.ask()
    await gate.began.wait()
    line.station.at(PRESSED_UM)
    running = next(task for task in asyncio.all_tasks() if task.get_name() == "job j")
    running.cancel()
    await rising.wait()
    running.cancel()
    may_rise.set()
    await asyncio.wait({running})
    assert line.did[:4] == ["run j", "stop", "raise", "dark"]
    assert line.latch.state is State.IDLE
    loop.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await loop


UNSAFE = [
    EmergencyStop("pressed", device="z"),
    LimitHit("at its end", device="z"),
    Stalled("stuck", device="z"),
    LinkTimeout("no answer", device="z"),
]


@pytest.mark.parametrize("error", UNSAFE)
async def test_where_raising_is_unsafe_nothing_moves_and_the_needle_is_said_to_be_down_beside_the_cause(
    tmp_path: Path, error: Exception
) -> None:
    async with _line(tmp_path) as line:
        line.body = _pressed(_raising(error))(line)
        result = await line.do()
        assert result.error is not None
        assert [cause.kind.wire_name for cause in line.latch.causes] == [result.error.name, "needle_down"]
    assert line.did == ["run j", "dark", "observed"]


@pytest.mark.parametrize(
    ("error", "causes"),
    [
        (Stalled("stuck", device="z"), ["axis_stalled", "needle_down"]),
        (Fault(FaultCode.OUTSIDE_ENVELOPE), ["needle_down"]),
        (RuntimeError("a bug"), ["internal", "needle_down"]),
    ],
)
async def test_a_needle_that_cannot_be_raised_is_latched_after_its_own_cause(
    tmp_path: Path, error: Exception, causes: list[str]
) -> None:
    async with _line(tmp_path) as line:
        line.body = _pressed(_done)(line)
        line.station.lift_error = error
        assert (await line.do()).ok, "how the job ended is not hidden"
        assert [cause.kind.wire_name for cause in line.latch.causes] == causes
        assert line.did[-2:] == ["dark", "observed"]


async def test_axes_without_a_reference_are_not_raised(tmp_path: Path) -> None:
    async with _line(tmp_path) as line:
        line.body = _pressed(_done)(line)
        line.station.is_homed = False
        await line.do()
        assert [cause.kind.wire_name for cause in line.latch.causes] == ["not_homed", "needle_down"]
        assert "raise" not in line.did


async def test_a_motion_that_goes_on_is_stopped_first(tmp_path: Path) -> None:
    async with _line(tmp_path) as line:
        line.body = _pressed(_done)(line)
        line.station.moving = True
        await line.do()
    assert line.did == ["run j", "stop", "raise", "dark", "observed"]


@pytest.mark.parametrize("op", ["place", "look", "home"])
async def test_in_needle_down_all_but_what_raises_it_is_refused(tmp_path: Path, op: str) -> None:
    async with _line(tmp_path, _done) as line:
        line.station.at(PRESSED_UM)
        line.latch.latch(Fault(FaultCode.NEEDLE_DOWN))
        fields = {"test_point": "TP1"} if op == "place" else {}
        if op == "home":
            line.body = _lifting(line)
            assert (await line.do(op)).ok
            assert line.latch.state is State.IDLE
            return
        with pytest.raises(Fault) as refused:
            await line.ask(op, **fields)
        assert refused.value.detail["first_cause"]["name"] == "needle_down"


def _lifting(line: _Line) -> Body:
    async def body(job: JobContext) -> Outcome:
        job.fire(Event.DEPARTED)
        line.station.at(SAFE_UM)
        job.fire(Event.ARRIVED)
        return Outcome("lifted")

    return body


async def test_a_lift_that_comes_to_its_end_clears_needle_down_and_nothing_else_does(tmp_path: Path) -> None:
    async with _line(tmp_path) as line:
        line.latch.latch(Fault(FaultCode.NEEDLE_DOWN))
        line.body = _raising(Fault(FaultCode.CANCELLED), Event.DEPARTED)
        assert not (await line.do("lift", "first")).ok
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.NEEDLE_DOWN
        line.body = _lifting(line)
        assert (await line.do("lift", "second")).ok
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)


@pytest.mark.parametrize("kind", [FaultCode.EMERGENCY_STOP, FaultCode.NOT_HOMED, FaultCode.LINK_LOST])
async def test_a_lift_is_refused_in_a_fault_that_it_does_not_cure(tmp_path: Path, kind: FaultCode) -> None:
    async with _line(tmp_path, _done) as line:
        line.latch.latch(Fault(FaultCode.NEEDLE_DOWN))
        line.latch.latch(Fault(kind))
        with pytest.raises(Fault) as refused:
            await line.ask("lift")
        assert refused.value.detail["first_cause"]["name"] == kind.wire_name


async def test_a_job_that_would_begin_with_the_needle_down_is_refused_and_latches_it(tmp_path: Path) -> None:
    async with _line(tmp_path, _done) as line:
        line.station.at(PRESSED_UM)
        result = await line.do()
        assert result.error is not None
        assert result.error.name == "needle_down"
        assert "run j" not in line.did
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.NEEDLE_DOWN


# --- touches --------------------------------------------------------------------------------------------------------

CONTACT_FACTS = ContactFacts(**CONTACT | {"id": "t", "test_point": "TP1"})


class _Touch:
    """A touch whose needle stands until it is lifted."""

    def __init__(self, line: Callable[[], _Line]) -> None:
        self._line = line
        self.stands = asyncio.Event()
        self.due_s = 0.0

    async def __call__(self, job: JobContext) -> Outcome:
        self.due_s = job.deadline.remaining_s
        for event in (Event.ACCEPTED, Event.SEEN, Event.ARRIVED):
            job.fire(event)
        self._line().station.at(PRESSED_UM)
        job.touching.held.stands(CONTACT_FACTS, lease_ms=30_000.0, hold_ms=60_000.0)
        job.touching.made(CONTACT_FACTS)
        self.stands.set()
        ended = await job.touching.held.wait(60.0)
        if ended != "lift":
            raise Fault(FaultCode.LEASE_EXPIRED)
        self._line().station.at(WORK_UM)
        return Outcome("touched", test_point="TP1")


def _contacts(line: _Line) -> list[tuple[str, str]]:
    return [(body["change"], body["job"]) for topic, body in line.published.events if topic == "contact"]


@asynccontextmanager
async def _touching(folder: Path) -> AsyncIterator[tuple[_Line, _Touch]]:
    body = _Touch(lambda: line)
    async with _line(folder, body) as line:
        yield line, body


async def test_a_held_touch_is_told_of_and_reached_by_its_id_until_it_is_lifted(tmp_path: Path) -> None:
    async with _touching(tmp_path) as (line, body):
        done = await line.ask("touch", "t", test_point="TP1", hold_ms=60_000)
        await body.stands.wait()
        held = line.runner.touch("t")
        assert held is not None
        assert (line.runner.contact, line.runner.result_of("t")) == (CONTACT_FACTS, done)
        assert (line.latch.state, _contacts(line)) == (State.VERIFY, [("made", "t")])
        held.lift("", {})
        assert (await done).outcome == "touched"
        assert _contacts(line) == [("made", "t"), ("lifted", "t")]
        assert (line.runner.touch("t"), line.runner.contact, line.latch.state) == (None, None, State.IDLE)


async def test_a_cancelled_touch_is_raised_first_and_then_told_to_be_lifted(tmp_path: Path) -> None:
    async with _touching(tmp_path) as (line, body):
        done = await line.ask("touch", "t", test_point="TP1", hold_ms=60_000)
        await body.stands.wait()
        line.runner.cancel("t")
        result = await done
        assert result.error is not None
        assert (result.error.name, line.latch.state) == ("cancelled", State.IDLE)
        assert line.did[:4] == ["run t", "stop", "raise", "dark"]
        assert _contacts(line) == [("made", "t"), ("lifted", "t")]


async def test_a_needle_that_could_not_be_raised_is_not_told_to_be_lifted(tmp_path: Path) -> None:
    async with _touching(tmp_path) as (line, body):
        done = await line.ask("touch", "t", test_point="TP1", hold_ms=60_000)
        await body.stands.wait()
        line.station.lift_error = Stalled("stuck", device="z")
        line.runner.cancel("t")
        await done
        assert _contacts(line) == [("made", "t")]
        assert line.runner.contact is None
        assert line.latch.state is State.FAULT


async def test_a_lease_that_ran_out_is_no_fault_of_the_station(tmp_path: Path) -> None:
    async with _line(tmp_path, _raising(Fault(FaultCode.LEASE_EXPIRED), Event.ACCEPTED, Event.SEEN)) as line:
        seen: list[Event] = []
        line.latch.subscribe(lambda change: seen.append(change.event))
        assert (await line.do("touch", test_point="TP1")).error is not None
        assert seen[-1] is Event.CANCELLED


async def test_a_touch_has_the_time_of_its_hold_beside_that_of_any_job(tmp_path: Path) -> None:
    async with _touching(tmp_path) as (line, body):
        await line.ask("touch", "t", test_point="TP1", hold_ms=600_000)
        await body.stands.wait()
        assert body.due_s > 600.0
        held = line.runner.touch("t")
        assert held is not None
        held.lift("", {})


async def test_a_touch_belongs_to_the_key_of_the_client_that_asked_for_it(tmp_path: Path) -> None:
    async with _touching(tmp_path) as (line, body):
        request = cast("AnyJob", OPERATIONS.parse({"op": "touch", "id": "t", "test_point": "TP1", "hold_ms": 60_000}))
        done = await line.runner.submit(request, "tester-1", "tester-1")
        await body.stands.wait()
        held = line.runner.touch("t")
        assert held is not None
        with pytest.raises(Fault) as stranger:
            held.lift("tester-2", {})
        assert stranger.value.kind is FaultCode.NOT_THE_HOLDER
        held.lift("tester-1", {})
        assert (await done).ok


@pytest.mark.parametrize(("op", "seen"), [("place", False), ("correct", True)])
async def test_a_job_that_put_the_head_over_a_point_is_remembered_with_its_client(
    tmp_path: Path, op: str, *, seen: bool
) -> None:
    async with _line(tmp_path, _looked) as line:
        request = cast("AnyJob", OPERATIONS.parse({"op": op, "id": "p", "test_point": "TP1"}))
        assert (await (await line.runner.submit(request, "tester-1", "tester-1"))).ok
        needle = line.station.needle
        assert needle.position is not None
        assert needle.stand.require("TP1", "tester-1", needle.position, 60.0) is seen


async def test_a_job_that_failed_put_the_head_over_nothing(tmp_path: Path) -> None:
    async with _line(tmp_path, _raising(Fault(FaultCode.NOT_CONVERGING), Event.ACCEPTED)) as line:
        await line.do("correct", test_point="TP1")
        needle = line.station.needle
        assert needle.position is not None
        with pytest.raises(Fault):
            needle.stand.require("TP1", "", needle.position, 60.0)


async def _stood(line: _Line) -> Position:
    """Have the head put over TP1, and seen to be there; return where it stands."""
    line.body = _looked
    assert (await line.do("correct", "first", test_point="TP1")).ok
    position = line.station.needle.position
    assert position is not None
    assert line.station.needle.stand.require("TP1", "", position, 60.0)
    return position


@pytest.mark.parametrize("op", ["place", "correct", "look"])
async def test_a_point_that_was_seen_before_is_stood_over_no_longer_once_the_eye_has_refused_it(
    tmp_path: Path, op: str
) -> None:
    async with _line(tmp_path) as line:
        position = await _stood(line)
        line.body = _raising(Fault(FaultCode.TARGET_NOT_CONFIRMED), Event.ACCEPTED)
        assert not (await line.do(op, "second", test_point="TP1")).ok
        with pytest.raises(Fault) as caught:
            line.station.needle.stand.require("TP1", "", position, 60.0)
        assert caught.value.kind is FaultCode.NOT_AT_TEST_POINT


@pytest.mark.parametrize("named", [{}, {"test_point": "TP2"}])
async def test_a_look_for_something_else_takes_no_stand_away(tmp_path: Path, named: dict[str, str]) -> None:
    async with _line(tmp_path) as line:
        position = await _stood(line)
        line.body = _raising(Fault(FaultCode.TARGET_NOT_CONFIRMED), Event.ACCEPTED)
        assert not (await line.do("look", "second", **named)).ok
        assert line.station.needle.stand.require("TP1", "", position, 60.0)


@pytest.mark.parametrize("op", ["place", "look"])
async def test_a_point_that_was_seen_beside_the_tip_is_not_touched_from_there(tmp_path: Path, op: str) -> None:
    async def beside(job: JobContext) -> Outcome:
        return replace(await _looked(job), beside_um=640.0)

    async with _line(tmp_path) as line:
        position = await _stood(line)
        line.body = beside
        assert (await line.do(op, "second", test_point="TP1")).ok
        with pytest.raises(Fault, match="640 um") as caught:
            line.station.needle.stand.require("TP1", "", position, 60.0)
        assert caught.value.kind is FaultCode.LOOK_NEEDED
