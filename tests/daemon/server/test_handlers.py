"""Each operation's handler: a request in, its reply out, and what it refuses."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest

from daemon.config.current import CurrentSettings
from daemon.config.model import load_config
from daemon.domain.board import Board, BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody, JobResult
from daemon.domain.roles import ROLES, Caller
from daemon.jobs.fault_latch import FaultLatch
from daemon.maintenance.alerts import Alert
from daemon.server.handlers import Collaborators, Handlers
from daemon.station.needle import Needle
from daemon.storage.journal import Journal
from daemon.telemetry.vitals import Vitals
from daemon.wire.docs import examples as wire_examples
from daemon.wire.example_parts import ALERT, RESULT
from daemon.wire.operations.jobs import JobReply
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.operations.table import OPERATIONS, OperationTable
from daemon.wire.replies import Reply
from daemon.wire.requests import ImmediateRequest, JobRequest
from drivers.gantry import Position

EXAMPLE = Path(__file__).parents[3] / "systemd" / "station.example.toml"
CALLER = Caller("tester-1", "operate")
JOBS = [row for row in OPERATIONS.rows if row.is_job]
DONE = JobResult.model_validate(RESULT)
VITALS = Vitals(
    fault=None,
    waiting=0,
    threads=1,
    journal_bytes=0,
    calibration_age_s={},
    buses={"main": {"connected": 1, "reconnects": 2}},
    camera={"frames": 7},
)  # fmt: skipfrom drivers.gantry import Position


class Wipe(JobRequest):
    """A job that no station has yet."""

    op: Literal["wipe"]


class Jobs:
    """A job runner that takes every job and ends it when told."""

    def __init__(self) -> None:
        self.running: Any = None
        self.progress: dict[str, Any] | None = None
        self.queued = 0
        self.taken: asyncio.Queue[tuple[Any, str]] = asyncio.Queue()
        self.done: asyncio.Future[JobResult] = asyncio.get_running_loop().create_future()
        self.refusal: Fault | None = None

    async def submit(self, request: Any, client: str = "") -> asyncio.Future[JobResult]:
        if self.refusal is not None:
            raise self.refusal
        self.taken.put_nowait((request, client))
        return self.done

    def cancel(self, job_id: str | None) -> str:
        if self.running is None:
            raise Fault(FaultCode.UNKNOWN_JOB, "no job runs", id=job_id)
        return job_id or str(self.running.id)


class Monitor:
    """One alert stands; touches and acknowledgements are written down."""

    def __init__(self) -> None:
        self.alert = Alert.from_dict(ALERT)
        self.touches: list[int] = []
        self.acknowledged: list[tuple[str, str, str, bool]] = []

    def overview(self) -> dict[str, Any]:
        return {"healthy": False, "standing": [self.alert.to_dict()], "watches": [], "touches": 48, "off": ["light"]}

    async def acknowledge(self, name: str, by: str, note: str, *, mended: bool) -> Alert:
        if name != self.alert.name:
            raise Fault(FaultCode.UNKNOWN_ALERT, standing=[self.alert.name])
        self.acknowledged.append((name, by, note, mended))
        return self.alert

    def on_touches(self, touches: int) -> None:
        self.touches.append(touches)


class Daemon:
    """An idle station as handlers see it; each part is as simple as it can be."""

    def __init__(self) -> None:
        self.config = load_config(EXAMPLE)
        self.latch = FaultLatch()
        self.latch.opened()
        self.jobs = Jobs()
        self.needle = Needle()
        self.needle.adopt(lambda _at: 5_200.0, lambda _at: 5_000.0)
        self.board = Board(
            name="demo", side="top", width_um=50_000.0, height_um=40_000.0, hidden={"TP9": "on the other side"},
            points=(
                BoardPoint(name="TP1", kind="site", x_um=1.0, y_um=2.0, diameter_um=400.0, net="VCC"),
                BoardPoint(name="FID1", kind="fiducial", x_um=3.0, y_um=4.0, diameter_um=1000.0, why_not="a fiducial"),
            ),
        )  # fmt: skip
        self.calibrations = SimpleNamespace(
            probe=None,
            mapped_at=None,
            made_at=lambda: {"map": "2025-03-04"},
            alignment=lambda _board: None,
            problems={"surface": "it was made with another probe"},
        )
        self.pictures = SimpleNamespace(full=None)
        self.reports: list[tuple[str | None, int]] = []
        self.metrics = SimpleNamespace(report=lambda retest, touches: self.reports.append((retest, touches)))
        self.monitor = Monitor()
        self.resets = 0
        self.against: Fault | None = None

    def vitals(self) -> Vitals:
        return VITALS

    async def reset(self) -> Fault | None:
        self.resets += 1
        return self.against


@pytest.fixture
async def journal(tmp_path: Path) -> AsyncIterator[Journal]:
    opened = await Journal.open(tmp_path / "journal.sqlite")
    yield opened
    await opened.close()


@pytest.fixture
async def station(journal: Journal) -> Daemon:
    return Daemon()


@pytest.fixture
async def handlers(station: Daemon, journal: Journal) -> Handlers:
    parts: Any = {
        "runner": station.jobs, "reset": station.reset, "calibrations": SimpleNamespace(in_force=station.calibrations),
        "images": station.pictures, "metrics": station.metrics, "monitor": station.monitor, "vitals": station.vitals,
        "needle": station.needle,
    }  # fmt: skip
    return Handlers(
        Collaborators(
            settings=CurrentSettings(station.config, station.board), latch=station.latch, journal=journal, **parts
        )
    )


async def _ask(handlers: Handlers, op: str, **fields: Any) -> Any:
    """Ask as the control socket does: first on the spot, then with patience."""
    request = OPERATIONS.parse({"op": op, **fields})
    return handlers.at_once(request, CALLER) or await handlers.handle(request, CALLER)


async def _refused(handlers: Handlers, op: str, **fields: Any) -> Fault:
    with pytest.raises(Fault) as caught:
        await _ask(handlers, op, **fields)
    return caught.value


async def _run(journal: Journal, job_id: str, *, finished: bool = True) -> JobResult:
    """Write a job into the journal as the runner does."""
    await journal.add_job(job_id, "correct", "{}")
    result = DONE.model_copy(update={"id": job_id, "seq": journal.take_seq()})
    if finished:
        await journal.finish_job(result)
    return result


# --- every operation ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("row", OPERATIONS.rows, ids=lambda row: row.op)
async def test_the_example_of_each_operation_gets_the_reply_of_its_row(
    row: Operation, handlers: Handlers, station: Daemon, journal: Journal
) -> None:
    await _run(journal, "board17-TP7-1")
    station.jobs.running = SimpleNamespace(id="board17-TP7-1", op="correct")
    station.jobs.done.set_result(DONE)
    reply = await _ask(handlers, **{**wire_examples.request(row), "op": row.op})
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
        assert (await _refused(handlers, **late)).kind is FaultCode.STALE_DEADLINE
        assert station.resets == 0
    else:
        assert isinstance(await _ask(handlers, **late), Reply)


# --- jobs -----------------------------------------------------------------------------------------------------


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
    answer = asyncio.create_task(_ask(handlers, "home", id="h", wait=True))
    await station.jobs.taken.get()
    assert not answer.done()
    station.jobs.done.set_result(DONE)
    assert await answer == JobReply(id="h", result=DONE)


async def test_a_job_that_is_done_already_is_answered_with_its_result_without_waiting(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.done.set_result(DONE)
    assert (await _ask(handlers, "correct", id="a", test_point="TP1")).result == DONE


async def test_a_client_that_gives_up_waiting_does_not_end_the_job_for_others(
    handlers: Handlers, station: Daemon
) -> None:
    first, second = (asyncio.create_task(_ask(handlers, "home", id="h", wait=True)) for _ in range(2))
    for _ in range(2):
        await station.jobs.taken.get()
    first.cancel()
    with pytest.raises(asyncio.CancelledError):
        await first
    station.jobs.done.set_result(DONE)
    assert (await second).result == DONE


async def test_a_job_the_runner_refuses_is_refused(handlers: Handlers, station: Daemon) -> None:
    station.jobs.refusal = Fault(FaultCode.BUSY, "8 jobs are open")
    assert (await _refused(handlers, "look", id="a")) is station.jobs.refusal


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
    assert "wipe" in (await _ask(handlers, "describe")).you.ops


# --- queue and machine ----------------------------------------------------------------------------------------


async def test_cancel_names_the_job_that_stops(handlers: Handlers, station: Daemon) -> None:
    station.jobs.running = SimpleNamespace(id="a", op="place")
    assert (await _ask(handlers, "cancel")).cancelled == "a"
    assert (await _ask(handlers, "cancel", id="b")).cancelled == "b"


async def test_cancel_is_refused_where_nothing_runs(handlers: Handlers) -> None:
    assert (await _refused(handlers, "cancel")).kind is FaultCode.UNKNOWN_JOB


async def test_reset_answers_the_status_it_led_to(handlers: Handlers, station: Daemon) -> None:
    assert (await _ask(handlers, "reset")).state == "idle"
    assert station.resets == 1


async def test_reset_is_refused_with_what_still_speaks_against_it(handlers: Handlers, station: Daemon) -> None:
    station.against = Fault(FaultCode.NOT_HOMED)
    assert (await _refused(handlers, "reset")) is station.against


async def test_status_of_an_idle_station_says_what_it_lacks(handlers: Handlers, station: Daemon) -> None:
    status = await _ask(handlers, "status")
    assert (status.station, status.state, status.lifecycle) == (station.config.station.name, "idle", "ready")
    assert (status.fault, status.running, status.queued, status.pictures) == (None, None, 0, "kept")
    assert status.calibration.model_dump() == {
        "tip": False, "map_made_at": None, "made_at": {"map": "2025-03-04"}, "aligned": False,
        "not_used": {"surface": "it was made with another probe"},
    }  # fmt: skip


async def test_status_always_says_where_the_needle_is(handlers: Handlers, station: Daemon) -> None:
    assert (await _ask(handlers, "status")).needle.model_dump() == {"place": "unknown", "z_um": None}
    for z_um, place in ((12_000.0, "up"), (4_900.0, "down")):
        station.needle.reported(Position(0.0, 0.0, z_um, 0.0))
        for op in ("status", "snapshot"):
            assert (await _ask(handlers, op)).needle.model_dump() == {"place": place, "z_um": z_um}


async def test_status_of_a_busy_station_names_its_job_and_how_far_it_is(handlers: Handlers, station: Daemon) -> None:
    station.latch.begin("calibrate", "a")
    station.jobs.running = SimpleNamespace(id="a", op="calibrate")
    station.jobs.progress = {"done": 1, "total": 9, "doing": "looking"}
    station.jobs.queued = 2
    station.pictures.full = "the disk is full"
    station.calibrations.probe = station.calibrations.alignment = lambda _board: object()
    status = await _ask(handlers, "status")
    assert (status.state, status.queued, status.pictures) == ("triggered", 2, "the disk is full")
    assert status.running.model_dump() == {"id": "a", "op": "calibrate", "progress": station.jobs.progress}
    assert (status.calibration.tip, status.calibration.aligned) == (True, True)


async def test_status_in_fault_names_the_first_cause(handlers: Handlers, station: Daemon) -> None:
    stalled = Fault(FaultCode.AXIS_STALLED, "Z stopped short")
    station.latch.latch(stalled)
    station.latch.latch(Fault(FaultCode.LINK_LOST))
    status = await _ask(handlers, "status")
    assert status.state == "fault"
    assert status.fault == ErrorBody.of(stalled)


async def test_a_snapshot_is_the_status_and_all_a_late_joiner_needs(handlers: Handlers, journal: Journal) -> None:
    await _run(journal, "first")
    last = await _run(journal, "second")
    await journal.add_report(None, None, 12)
    snapshot = await _ask(handlers, "snapshot")
    status = await _ask(handlers, "status")
    assert status.model_dump().items() <= snapshot.model_dump().items()
    assert (snapshot.last_result, snapshot.next_seq, snapshot.touches) == (last, last.seq + 1, 12)
    assert snapshot.links.model_dump() == {"buses": VITALS.buses, "camera": VITALS.camera}


async def test_what_is_published_while_a_snapshot_is_read_comes_again_in_the_replay(
    handlers: Handlers, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = journal.last_result

    async def published_meanwhile() -> JobResult | None:
        found = await read()
        await _run(journal, "meanwhile")
        return found

    monkeypatch.setattr(journal, "last_result", published_meanwhile)
    snapshot = await _ask(handlers, "snapshot")
    replayed = await _ask(handlers, "results", since=snapshot.next_seq)
    assert snapshot.last_result is None
    assert [result.id for result in replayed.results] == ["meanwhile"]


async def test_a_snapshot_of_a_new_station_has_no_result(handlers: Handlers) -> None:
    assert (await _ask(handlers, "snapshot")).last_result is None


async def test_the_result_of_a_job_is_told_once_there_is_one(handlers: Handlers, journal: Journal) -> None:
    await _run(journal, "open", finished=False)
    done = await _run(journal, "done")
    waits = await _ask(handlers, "result", id="open")
    assert (waits.id, waits.done, waits.result) == ("open", False, None)
    told = await _ask(handlers, "result", id="done")
    assert (told.id, told.done, told.result) == ("done", True, done)


async def test_the_result_of_a_job_nobody_knows_is_refused_with_its_id(handlers: Handlers) -> None:
    fault = await _refused(handlers, "result", id="never")
    assert (fault.kind, fault.detail["id"]) == (FaultCode.UNKNOWN_JOB, "never")


async def test_results_come_from_a_number_on_and_no_more_than_asked_for(handlers: Handlers, journal: Journal) -> None:
    seqs = [(await _run(journal, f"j{n}")).seq for n in range(4)]
    reply = await _ask(handlers, "results", since=seqs[1], limit=2)
    assert [result.seq for result in reply.results] == seqs[1:3]


# --- health ---------------------------------------------------------------------------------------------------


async def test_alerts_are_those_of_the_journal_beside_how_the_station_stands(
    handlers: Handlers, station: Daemon, journal: Journal
) -> None:
    for seq in (5, 6, 7):
        await journal.add_alert(seq, station.monitor.alert.body("raised"))
    reply = await _ask(handlers, "alerts", since=6, limit=1)
    assert [alert.seq for alert in reply.alerts] == [6]
    assert (reply.alerts[0].name, reply.alerts[0].raised) == ("light_white", True)
    assert (reply.healthy, reply.touches, reply.off) == (False, 48, ["light"])
    assert [alert.name for alert in reply.standing] == ["light_white"]


async def test_an_acknowledgement_is_handed_over_whole_and_the_alert_answered(
    handlers: Handlers, station: Daemon
) -> None:
    reply = await _ask(handlers, "acknowledge", alert="light_white", by="Kim", note="ring ordered", mended=True)
    assert station.monitor.acknowledged == [("light_white", "Kim", "ring ordered", True)]
    assert reply.alert.model_dump() == station.monitor.alert.to_dict()


async def test_an_alert_that_does_not_stand_is_not_acknowledged(handlers: Handlers) -> None:
    fault = await _refused(handlers, "acknowledge", alert="light_red", by="Kim")
    assert (fault.kind, fault.detail["standing"]) == (FaultCode.UNKNOWN_ALERT, ["light_white"])


async def test_a_report_reaches_journal_metrics_and_monitor(
    handlers: Handlers, station: Daemon, journal: Journal
) -> None:
    await _run(journal, "a")
    assert (await _ask(handlers, "report", touches=5)).touches == 5
    assert (await _ask(handlers, "report", id="a", retest="pass", touches=20)).touches == 25
    assert station.reports == [(None, 5), ("pass", 20)]
    assert station.monitor.touches == [5, 20]


async def test_a_report_on_a_job_nobody_knows_is_refused_and_counts_nothing(
    handlers: Handlers, station: Daemon, journal: Journal
) -> None:
    assert (await _refused(handlers, "report", id="never", touches=3)).kind is FaultCode.UNKNOWN_JOB
    assert await journal.touches() == 0
    assert station.reports == []
    assert station.monitor.touches == []


# --- describe -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("role", ROLES)
async def test_describe_tells_each_client_who_it_is_and_what_it_may_ask(role: Any, handlers: Handlers) -> None:
    told: Any = handlers.at_once(OPERATIONS.parse({"op": "describe"}), Caller("kim", role))
    assert (told.you.client, told.you.role) == ("kim", role)
    assert told.you.ops == [op for op in told.ops if OPERATIONS.may(role, op)]
    assert told.ops == list(OPERATIONS.ops)


async def test_describe_tells_board_errors_and_limits(handlers: Handlers, station: Daemon) -> None:
    told = await _ask(handlers, "describe")
    assert (told.station, told.events) == (station.config.station.name, station.config.api.events)
    assert [point.model_dump() for point in told.board.test_points] == [
        {"name": "TP1", "kind": "site", "x_um": 1.0, "y_um": 2.0, "diameter_um": 400.0, "hole_um": None, "net": "VCC"}
    ]
    assert told.board.not_probeable == {"FID1": "a fiducial", "TP9": "on the other side"}
    assert {error.code: error.name for error in told.errors} == {kind.code: kind.wire_name for kind in FaultCode}
    api = station.config.api
    assert told.limits.model_dump() == {
        "max_message_bytes": api.max_message_bytes, "rate_per_s": api.rate_per_s, "rate_burst": api.rate_burst,
        "queue_length": api.queue_length, "queue_per_client": api.queue_per_client,
    }  # fmt: skip
