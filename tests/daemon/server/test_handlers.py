"""Each operation's handler: a request in, its reply out, and what it refuses."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.domain.board_run import BoardRun
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.roles import ROLES, Caller
from daemon.server.handlers import Handlers
from daemon.storage.journal import Journal
from daemon.wire.docs import examples as wire_examples
from daemon.wire.example_runs import RUN
from daemon.wire.operations.jobs import JobReply
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.operations.table import OPERATIONS, OperationTable
from daemon.wire.replies import Reply
from daemon.wire.requests import ImmediateRequest
from tests.daemon.server.fake_daemon import (
    CALLER,
    DONE,
    JOBS,
    MAINTAINER,
    Daemon,
    Wipe,
    ask,
    kept_job,
    refusal,
)


@pytest.mark.parametrize("row", OPERATIONS.rows, ids=lambda row: row.op)
async def test_the_example_of_each_operation_gets_the_reply_of_its_row(
    row: Operation, handlers: Handlers, station: Daemon, journal: Journal
) -> None:
    await kept_job(journal, "board17-TP7-1")
    await journal.runs.begin(BoardRun.model_validate(RUN))
    station.jobs.running = SimpleNamespace(id="board17-TP7-1", op="correct")
    station.jobs.done.set_result(DONE)
    reply = await ask(handlers, caller=MAINTAINER, **{**wire_examples.request(row), "op": row.op})
    assert type(reply) is row.reply


@pytest.mark.parametrize("row", OPERATIONS.rows, ids=lambda row: row.op)
async def test_what_needs_no_waiting_is_answered_on_the_spot_and_later_alike(
    row: Operation, handlers: Handlers, station: Daemon
) -> None:
    request = OPERATIONS.parse(wire_examples.request(row))
    now = handlers.at_once(request, CALLER)
    assert (now is not None) == issubclass(row.request, ImmediateRequest)
    if now is not None:
        assert await handlers.handle(request, CALLER) == now


@pytest.mark.parametrize("row", [r for r in OPERATIONS.rows if not r.is_job], ids=lambda row: row.op)
async def test_a_deadline_that_has_passed_is_refused_where_one_counts(
    row: Operation, handlers: Handlers, station: Daemon
) -> None:
    late = {**wire_examples.request(row), "deadline_ms": -1.0}
    if row.deadline is DefaultDeadline.SHORT:
        assert (await refusal(handlers, **late)).kind is FaultCode.STALE_DEADLINE
        assert station.resets == 0
    else:
        assert isinstance(await ask(handlers, **late), Reply)


@pytest.mark.parametrize("row", JOBS, ids=lambda row: row.op)
async def test_a_job_is_handed_to_the_runner_in_its_clients_name(
    row: Operation, handlers: Handlers, station: Daemon
) -> None:
    request = OPERATIONS.parse({**wire_examples.request(row), "wait": False})
    reply = await handlers.handle(request, CALLER)
    assert station.jobs.taken.get_nowait() == (request, "tester-1")
    assert reply == JobReply(id=row.example["id"])
    assert b'"result"' not in reply.to_json()


async def test_a_waiting_job_is_answered_with_its_result(handlers: Handlers, station: Daemon) -> None:
    answer = asyncio.create_task(ask(handlers, "home", id="h", wait=True))
    await station.jobs.taken.get()
    assert not answer.done()
    station.jobs.done.set_result(DONE)
    assert await answer == JobReply(id="h", result=DONE)


async def test_a_job_that_is_done_already_is_answered_with_its_result_without_waiting(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.done.set_result(DONE)
    assert (await ask(handlers, "correct", id="a", test_point="TP1")).result == DONE


async def test_a_client_that_gives_up_waiting_does_not_end_the_job_for_others(
    handlers: Handlers, station: Daemon
) -> None:
    first, second = (asyncio.create_task(ask(handlers, "home", id="h", wait=True)) for _ in range(2))
    for _ in range(2):
        await station.jobs.taken.get()
    first.cancel()
    with pytest.raises(asyncio.CancelledError):
        await first
    station.jobs.done.set_result(DONE)
    assert (await second).result == DONE


async def test_a_job_the_runner_refuses_is_refused(handlers: Handlers, station: Daemon) -> None:
    station.jobs.refusal = Fault(FaultCode.BUSY, "8 jobs are open")
    assert (await refusal(handlers, "look", id="a")) is station.jobs.refusal


async def test_one_more_job_needs_no_handler_of_its_own(
    handlers: Handlers, station: Daemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = Operation(
        request=Wipe, reply=JobReply, least_role="operate", deadline=DefaultDeadline.JOB, outcomes=("wiped",),
        example={"id": "w"}, example_reply={"id": "w"},
    )  # fmt: skip
    extended = OperationTable((*OPERATIONS.rows, row))
    monkeypatch.setattr("daemon.server.handlers.OPERATIONS", extended)
    request = extended.parse({"op": "wipe", "id": "w"})
    assert await handlers.handle(request, CALLER) == JobReply(id="w")
    assert station.jobs.taken.get_nowait() == (request, "tester-1")
    assert "wipe" in (await ask(handlers, "describe")).you.ops


@pytest.mark.parametrize("role", ROLES)
async def test_describe_tells_each_client_who_it_is_and_what_it_may_ask(role: Any, handlers: Handlers) -> None:
    told: Any = handlers.at_once(OPERATIONS.parse({"op": "describe"}), Caller("kim", role))
    assert (told.you.client, told.you.role) == ("kim", role)
    assert told.you.ops == [op for op in told.ops if OPERATIONS.may(role, op)]
    assert told.ops == list(OPERATIONS.ops)


async def test_settings_in_force_are_told_with_their_source_and_no_place_on_the_computer(
    handlers: Handlers, station: Daemon
) -> None:
    reply = await ask(handlers, "config")
    told = {setting.name: setting for setting in reply.settings}
    assert told["station.name"].value == station.config.station.name
    assert told["station.name"].source == "file"
    assert told["api.heartbeat_s"].value == station.config.api.heartbeat_s
    assert told["api.heartbeat_s"].source == "default"
    assert told["axes.x.address"].value == station.config.axes.x.address
    assert [s.name for s in reply.settings if isinstance(s.value, str) and "/" in s.value] == []
    assert not told.keys() & {"station.data_dir", "board.file", "api.keys_dir", "api.control", "bus.main.port"}


async def test_describe_tells_board_errors_and_limits(handlers: Handlers, station: Daemon) -> None:
    told = await ask(handlers, "describe")
    assert (told.station, told.events) == (station.config.station.name, station.config.api.events)
    assert [point.model_dump() for point in told.board.test_points] == [
        {
            "name": "TP1",
            "kind": "site",
            "x_um": 1.0,
            "y_um": 2.0,
            "diameter_um": 400.0,
            "hole_um": None,
            "net": "VCC",
            "part": None,
            "pin": None,
            "shape": "round",
            "room_um": None,
            "stands_um": None,
            "rank": None,
        }
    ]
    assert told.board.not_probeable == {"FID1": "a fiducial", "TP9": "on the other side"}
    assert {error.code: error.name for error in told.errors} == {kind.code: kind.wire_name for kind in FaultCode}
    api = station.config.api
    assert told.limits.model_dump() == {
        "max_message_bytes": api.max_message_bytes, "rate_per_s": api.rate_per_s, "rate_burst": api.rate_burst,
        "queue_length": api.queue_length, "queue_per_client": api.queue_per_client,
    }  # fmt: skip
