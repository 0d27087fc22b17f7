"""A touch that is held, and the point that the head stands over."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest

from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event, State
from daemon.jobs.context import JobContext, Outcome
from daemon.wire.example_parts import CONTACT
from daemon.wire.operations.jobs import AnyJob
from daemon.wire.operations.table import OPERATIONS
from drivers.errors import Stalled
from drivers.gantry import Position
from tests.daemon.jobs.runner_at_work import (
    PRESSED_UM,
    WORK_UM,
    Line,
    at_work,
    looked,
    raising,
)

CONTACT_FACTS = ContactFacts(**CONTACT | {"id": "t", "test_point": "TP1"})


class _Touch:
    """A touch whose needle stands until it is lifted."""

    def __init__(self, line: Callable[[], Line]) -> None:
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


def _contacts(line: Line) -> list[tuple[str, str]]:
    return [(body["change"], body["job"]) for topic, body in line.published.events if topic == "contact"]


@asynccontextmanager
async def _touching(folder: Path) -> AsyncIterator[tuple[Line, _Touch]]:
    body = _Touch(lambda: line)
    async with at_work(folder, body) as line:
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
    async with at_work(tmp_path, raising(Fault(FaultCode.LEASE_EXPIRED), Event.ACCEPTED, Event.SEEN)) as line:
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
    async with at_work(tmp_path, looked) as line:
        request = cast("AnyJob", OPERATIONS.parse({"op": op, "id": "p", "test_point": "TP1"}))
        assert (await (await line.runner.submit(request, "tester-1", "tester-1"))).ok
        needle = line.station.needle
        assert needle.position is not None
        assert needle.stand.require("TP1", "tester-1", needle.position, 60.0) is seen


async def test_a_job_that_failed_put_the_head_over_nothing(tmp_path: Path) -> None:
    async with at_work(tmp_path, raising(Fault(FaultCode.NOT_CONVERGING), Event.ACCEPTED)) as line:
        await line.do("correct", test_point="TP1")
        needle = line.station.needle
        assert needle.position is not None
        with pytest.raises(Fault):
            needle.stand.require("TP1", "", needle.position, 60.0)


async def _stood(line: Line) -> Position:
    """Have the head put over TP1, and seen to be there; return where it stands."""
    line.body = looked
    assert (await line.do("correct", "first", test_point="TP1")).ok
    position = line.station.needle.position
    assert position is not None
    assert line.station.needle.stand.require("TP1", "", position, 60.0)
    return position


@pytest.mark.parametrize("op", ["place", "correct", "look"])
async def test_a_point_that_was_seen_before_is_stood_over_no_longer_once_the_eye_has_refused_it(
    tmp_path: Path, op: str
) -> None:
    async with at_work(tmp_path) as line:
        position = await _stood(line)
        line.body = raising(Fault(FaultCode.TARGET_NOT_CONFIRMED), Event.ACCEPTED)
        assert not (await line.do(op, "second", test_point="TP1")).ok
        with pytest.raises(Fault) as caught:
            line.station.needle.stand.require("TP1", "", position, 60.0)
        assert caught.value.kind is FaultCode.NOT_AT_TEST_POINT


@pytest.mark.parametrize("named", [{}, {"test_point": "TP2"}])
async def test_a_look_for_something_else_takes_no_stand_away(tmp_path: Path, named: dict[str, str]) -> None:
    async with at_work(tmp_path) as line:
        position = await _stood(line)
        line.body = raising(Fault(FaultCode.TARGET_NOT_CONFIRMED), Event.ACCEPTED)
        assert not (await line.do("look", "second", **named)).ok
        assert line.station.needle.stand.require("TP1", "", position, 60.0)


@pytest.mark.parametrize("op", ["place", "look"])
async def test_a_point_that_was_seen_beside_the_tip_is_not_touched_from_there(tmp_path: Path, op: str) -> None:
    async def beside(job: JobContext) -> Outcome:
        return replace(await looked(job), beside_um=640.0)

    async with at_work(tmp_path) as line:
        position = await _stood(line)
        line.body = beside
        assert (await line.do(op, "second", test_point="TP1")).ok
        with pytest.raises(Fault, match="640 um") as caught:
            line.station.needle.stand.require("TP1", "", position, 60.0)
        assert caught.value.kind is FaultCode.LOOK_NEEDED
