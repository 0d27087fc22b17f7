"""However a job ends, the needle is raised first, or its place is said to be in doubt."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event, State
from daemon.jobs.context import JobContext, Outcome
from drivers.errors import CameraError, EmergencyStop, LimitHit, LinkTimeout, Stalled
from drivers.gantry import Position
from tests.daemon.jobs.runner_at_work import (
    PRESSED_UM,
    SAFE_UM,
    WORK_UM,
    Body,
    Gate,
    Line,
    at_work,
    raising,
)


def _pressed(then: Body) -> Callable[[Line], Body]:
    """Return a procedure that presses and goes on with something."""

    def of(line: Line) -> Body:
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
    "seen nothing": raising(Fault(FaultCode.TIP_NOT_FOUND)),
    "camera gone": raising(CameraError("silent", device="camera")),
    "a bug": raising(RuntimeError("a bug")),
    "sideways": raising(Fault(FaultCode.NEEDLE_DOWN)),
}


@pytest.mark.parametrize("end", ENDS)
async def test_however_a_job_ends_a_pressed_needle_is_raised_before_it_is_dark(tmp_path: Path, end: str) -> None:
    async with at_work(tmp_path) as line:
        line.body = _pressed(ENDS[end])(line)
        states: list[tuple[State, int]] = []
        line.latch.subscribe(lambda change: states.append((change.after, len(line.did))))
        await line.do()
        assert line.did == ["run j", "raise", "dark", "observed"]
        assert states[-1][1] >= 3, "the last transition comes after all of it"
        assert line.station.needle.is_up
        assert all(cause.kind is not FaultCode.NEEDLE_DOWN for cause in line.latch.causes)


@pytest.mark.parametrize("moves", [False, True])
async def test_a_job_that_moved_and_did_not_see_the_tip_raises_it_whatever_z_counts(
    tmp_path: Path, moves: bool
) -> None:
    """Z may stand lower than its drive says; one that moved nothing leaves the head where it was."""
    async with at_work(tmp_path) as line:

        async def body(job: JobContext) -> Outcome:
            job.fire(Event.ACCEPTED)
            if moves:
                line.station.needle.departs(Position(0.0, 0.0, WORK_UM, 0.0))
                line.station.at(WORK_UM)
            return await raising(Fault(FaultCode.TIP_NOT_FOUND))(job)

        line.body = body
        await line.do()
        assert ("raise" in line.did) is moves


async def test_a_cancelled_job_stops_raises_and_darkens(tmp_path: Path) -> None:
    gate = Gate()
    async with at_work(tmp_path) as line:
        line.body = gate
        done = await line.ask()
        await gate.began.wait()
        line.station.at(PRESSED_UM)
        line.runner.cancel(None)
        assert (await done).error.name == "cancelled"
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)
    assert line.did == ["run j", "stop", "raise", "dark", "observed"]


async def test_a_deadline_over_a_pressed_needle_stops_raises_and_darkens(tmp_path: Path) -> None:
    async with at_work(tmp_path) as line:
        line.body = _pressed(lambda _job: asyncio.sleep(3_600.0))(line)  # type: ignore[arg-type, return-value]
        assert (await line.do(deadline_ms=30.0)).error is not None
        assert line.latch.state is State.IDLE
    assert line.did == ["run j", "stop", "raise", "dark", "observed"]


async def test_a_daemon_that_is_stopped_twice_raises_the_needle_all_the_same(tmp_path: Path) -> None:
    """The second cancellation comes while the needle rises."""
    gate, rising, may_rise = Gate(), asyncio.Event(), asyncio.Event()
    line = Line(tmp_path, gate)

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
    async with at_work(tmp_path) as line:
        line.body = _pressed(raising(error))(line)
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
    async with at_work(tmp_path) as line:
        line.body = _pressed(_done)(line)
        line.station.lift_error = error
        assert (await line.do()).ok, "how the job ended is not hidden"
        assert [cause.kind.wire_name for cause in line.latch.causes] == causes
        assert line.did[-2:] == ["dark", "observed"]


async def test_axes_without_a_reference_are_not_raised(tmp_path: Path) -> None:
    async with at_work(tmp_path) as line:
        line.body = _pressed(_done)(line)
        line.station.is_homed = False
        await line.do()
        assert [cause.kind.wire_name for cause in line.latch.causes] == ["not_homed", "needle_down"]
        assert "raise" not in line.did


async def test_a_motion_that_goes_on_is_stopped_first(tmp_path: Path) -> None:
    async with at_work(tmp_path) as line:
        line.body = _pressed(_done)(line)
        line.station.moving = True
        await line.do()
    assert line.did == ["run j", "stop", "raise", "dark", "observed"]


@pytest.mark.parametrize("op", ["place", "look", "home"])
async def test_in_needle_down_all_but_what_raises_it_is_refused(tmp_path: Path, op: str) -> None:
    async with at_work(tmp_path, _done) as line:
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


def _lifting(line: Line) -> Body:
    async def body(job: JobContext) -> Outcome:
        job.fire(Event.DEPARTED)
        line.station.at(SAFE_UM)
        job.fire(Event.ARRIVED)
        return Outcome("lifted")

    return body


async def test_a_lift_that_comes_to_its_end_clears_needle_down_and_nothing_else_does(tmp_path: Path) -> None:
    async with at_work(tmp_path) as line:
        line.latch.latch(Fault(FaultCode.NEEDLE_DOWN))
        line.body = raising(Fault(FaultCode.CANCELLED), Event.DEPARTED)
        assert not (await line.do("lift", "first")).ok
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.NEEDLE_DOWN
        line.body = _lifting(line)
        assert (await line.do("lift", "second")).ok
        assert (line.latch.state, line.latch.fault) == (State.IDLE, None)


@pytest.mark.parametrize("kind", [FaultCode.EMERGENCY_STOP, FaultCode.NOT_HOMED, FaultCode.LINK_LOST])
async def test_a_lift_is_refused_in_a_fault_that_it_does_not_cure(tmp_path: Path, kind: FaultCode) -> None:
    async with at_work(tmp_path, _done) as line:
        line.latch.latch(Fault(FaultCode.NEEDLE_DOWN))
        line.latch.latch(Fault(kind))
        with pytest.raises(Fault) as refused:
            await line.ask("lift")
        assert refused.value.detail["first_cause"]["name"] == kind.wire_name


async def test_a_job_that_would_begin_with_the_needle_down_is_refused_and_latches_it(tmp_path: Path) -> None:
    async with at_work(tmp_path, _done) as line:
        line.station.at(PRESSED_UM)
        result = await line.do()
        assert result.error is not None
        assert result.error.name == "needle_down"
        assert "run j" not in line.did
        assert line.latch.fault is not None
        assert line.latch.fault.kind is FaultCode.NEEDLE_DOWN
