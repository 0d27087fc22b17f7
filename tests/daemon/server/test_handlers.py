"""Each operation's handler: a request in, its reply out, and what it refuses."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest

from daemon.config.current import CurrentSettings
from daemon.config.model import load_config
from daemon.domain.board import Board, BoardPoint
from daemon.domain.board_run import BoardRun
from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointUnit, PointVerdict
from daemon.domain.results import ErrorBody, JobResult
from daemon.domain.roles import ROLES, Caller
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.held_touch import HeldTouch
from daemon.maintenance.alerts import Alert
from daemon.server.handlers import Collaborators, Handlers
from daemon.station.needle import Needle
from daemon.storage.journal import Journal
from daemon.telemetry.vitals import Vitals
from daemon.wire.docs import examples as wire_examples
from daemon.wire.example_parts import ALERT, CONTACT, RESULT
from daemon.wire.example_runs import RUN
from daemon.wire.operations.jobs import JobReply
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.operations.table import OPERATIONS, OperationTable
from daemon.wire.replies import Reply
from daemon.wire.requests import ImmediateRequest, JobRequest
from drivers.gantry import Position
from drivers.lights import Light
from tests.daemon.domain.test_board_run import a_record, a_run

EXAMPLE = Path(__file__).parents[3] / "systemd" / "station.example.toml"
CALLER = Caller("tester-1", "operate")
MAINTAINER = Caller("page-maintain", "maintain")
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
        self.touches: dict[str, HeldTouch] = {"board17-TP7-2": _standing("board17-TP7-2")}
        """Open ones, by their ids."""
        self.contact: ContactFacts | None = None

    def touch(self, job_id: str) -> HeldTouch | None:
        return self.touches.get(job_id)

    def result_of(self, job_id: str) -> asyncio.Future[JobResult] | None:
        return self.done if job_id in self.touches else None

    async def submit(self, request: Any, client: str = "", key: str = "") -> asyncio.Future[JobResult]:  # noqa: ARG002
        if self.refusal is not None:
            raise self.refusal
        self.taken.put_nowait((request, client))
        return self.done

    def pause(self, job_id: str | None) -> str:
        return job_id or "run-1"

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


class Pictures:
    """An archive with one picture of each job."""

    full = None

    async def hashes_of(self, job_id: str) -> dict[str, str]:
        return {"before-red": hashlib.sha256(job_id.encode()).hexdigest()}

    async def picture(self, job_id: str, which: str) -> bytes | None:
        return job_id.encode() if which == "before-red" else None


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
        self.pictures = Pictures()
        self.reports: list[tuple[str | None, int]] = []
        self.metrics = SimpleNamespace(report=lambda retest, touches: self.reports.append((retest, touches)))
        self.monitor = Monitor()
        self.resets = 0
        self.lit: list[tuple[Light, float]] = []
        self.against: Fault | None = None

    def vitals(self) -> Vitals:
        return VITALS

    async def light(self, light: Light, lease_s: float) -> None:
        self.lit.append((light, lease_s))

    async def reset(self) -> Fault | None:
        self.resets += 1
        return self.against


@pytest.fixture
async def journal(tmp_path: Path) -> AsyncIterator[Journal]:
    opened = await Journal.open(tmp_path / "journal.sqlite")
    yield opened
    await opened.close()


@pytest.fixture
async def station(journal: Journal, tmp_path: Path) -> Daemon:
    daemon = Daemon()
    kept = daemon.config.station.model_copy(update={"data_dir": tmp_path})
    daemon.config = daemon.config.model_copy(update={"station": kept})
    return daemon


@pytest.fixture
def settings(station: Daemon) -> CurrentSettings:
    return CurrentSettings(station.config, station.board)


@pytest.fixture
async def handlers(station: Daemon, journal: Journal, settings: CurrentSettings) -> Handlers:
    parts: Any = {
        "runner": station.jobs, "reset": station.reset, "light": station.light,
        "calibrations": SimpleNamespace(in_force=station.calibrations),
        "images": station.pictures, "metrics": station.metrics, "monitor": station.monitor, "vitals": station.vitals,
        "needle": station.needle,
    }  # fmt: skip
    return Handlers(Collaborators(settings=settings, latch=station.latch, journal=journal, **parts))


async def _ask(handlers: Handlers, op: str, *, caller: Caller = CALLER, **fields: Any) -> Any:
    """Ask as the control socket does: first on the spot, then with patience."""
    request = OPERATIONS.parse({"op": op, **fields})
    return handlers.at_once(request, caller) or await handlers.handle(request, caller)


async def _refused(handlers: Handlers, op: str, *, caller: Caller = CALLER, **fields: Any) -> Fault:
    with pytest.raises(Fault) as caught:
        await _ask(handlers, op, caller=caller, **fields)
    return caught.value


def _standing(job_id: str, key: str = "", *, judged: bool = False, unit: PointUnit | None = None) -> HeldTouch:
    """Return a touch that is held down."""
    held = HeldTouch(job_id, key, judged=judged, unit=unit)
    held.stands(ContactFacts(**CONTACT | {"id": job_id}), lease_ms=20_000.0, hold_ms=60_000.0)
    return held


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
    await journal.runs.begin(BoardRun.model_validate(RUN))
    station.jobs.running = SimpleNamespace(id="board17-TP7-1", op="correct")
    station.jobs.done.set_result(DONE)
    reply = await _ask(handlers, caller=MAINTAINER, **{**wire_examples.request(row), "op": row.op})
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


# --- touches --------------------------------------------------------------------------------------------------


async def test_a_touch_is_answered_when_the_needle_stands(handlers: Handlers, station: Daemon) -> None:
    station.jobs.touches["t"] = held = HeldTouch("t", "")
    answer = asyncio.create_task(_ask(handlers, "touch", id="t", test_point="TP1", hold_ms=5000, wait="contact"))
    await station.jobs.taken.get()
    assert not answer.done()
    contact = ContactFacts(**CONTACT | {"id": "t"})
    held.stands(contact, 2000.0, 5000.0)
    assert await answer == JobReply(id="t", contact=contact)


async def test_a_touch_that_is_sent_again_while_the_needle_rises_is_answered_with_its_result(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = held = _standing("t")
    held.let_go()
    answer = asyncio.create_task(_ask(handlers, "touch", id="t", test_point="TP1", hold_ms=5000, wait="contact"))
    await station.jobs.taken.get()
    for _ in range(5):  # turns of the loop, in each of which it could have answered
        await asyncio.sleep(0)
    assert not answer.done()
    station.jobs.done.set_result(DONE)
    assert await answer == JobReply(id="t", result=DONE)


async def test_a_touch_that_fails_before_the_needle_stands_is_answered_with_its_result(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = HeldTouch("t", "")
    station.jobs.done.set_result(DONE)
    assert await _ask(handlers, "touch", id="t", test_point="TP1", wait="contact") == JobReply(id="t", result=DONE)


async def test_lift_ends_the_touch_of_its_id_and_answers_its_result(handlers: Handlers, station: Daemon) -> None:
    station.jobs.touches["t"] = held = _standing("t")
    answer = asyncio.create_task(_ask(handlers, "lift", id="t", verdict="pass", value=0.4, unit="ohm"))
    assert await held.wait(60.0) == "lift"
    assert held.measured == {"verdict": "pass", "value": 0.4, "unit": "ohm"}
    result = _touched(measured=held.measured)
    station.jobs.done.set_result(result)
    assert await answer == JobReply(id="t", result=result)
    assert station.jobs.taken.empty(), "it is no job of its own"


async def test_lift_of_a_probe_answers_that_the_needle_stands_again_and_at_last_the_result(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = held = _standing("t", judged=True)
    answer = asyncio.create_task(_ask(handlers, "lift", id="t", verdict="open"))
    assert await held.wait(60.0) == "lift"
    assert held.close() == {"verdict": "open"}
    held.again()
    again = ContactFacts(**CONTACT | {"id": "t", "pressed_um": 450.0})
    held.stands(again, lease_ms=20_000.0, hold_ms=60_000.0)
    assert await answer == JobReply(id="t", contact=again)
    assert await held.wait(0.0) is None, "what was said of the press before lifts this one not"
    answer = asyncio.create_task(_ask(handlers, "lift", id="t", verdict="pass"))
    assert await held.wait(60.0) == "lift"
    result = _touched(measured=held.close(), op="probe")
    station.jobs.done.set_result(result)
    assert await answer == JobReply(id="t", result=result)


async def test_a_word_that_is_no_verdict_of_a_probe_is_refused_and_the_needle_stays(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = held = _standing("t", judged=True)
    refused = await _refused(handlers, "lift", id="t", verdict="so-so")
    assert refused.kind is FaultCode.INVALID_REQUEST
    assert "fail, open, pass" in refused.message
    assert await held.wait(0.0) is None


@pytest.mark.parametrize(
    ("unit", "taken"), [("kohm", False), ("mOhm", False), ("V", False), ("Ohm", True), ("Ω", True)]
)
async def test_a_value_in_another_unit_than_its_limits_is_refused_and_the_needle_stays(
    handlers: Handlers, station: Daemon, unit: str, taken: bool
) -> None:
    station.jobs.touches["t"] = held = _standing("t", judged=True, unit="ohm")
    station.jobs.done.set_result(_touched(measured={"value": 1.0, "unit": unit}, op="probe"))
    if taken:
        await _ask(handlers, "lift", id="t", value=1.0, unit=unit)
        assert held.measured["value"] == 1.0
        return
    refused = await _refused(handlers, "lift", id="t", value=1.0, unit=unit)
    assert refused.kind is FaultCode.INVALID_REQUEST
    assert "ohm" in refused.message
    assert await held.wait(0.0) is None


async def test_a_word_of_the_press_before_is_refused_by_name_and_the_needle_stays(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = held = _standing("t", judged=True)
    held.again()
    held.stands(ContactFacts(**CONTACT | {"id": "t", "press": 2}), lease_ms=20_000.0, hold_ms=60_000.0)
    refused = await _refused(handlers, "lift", id="t", verdict="pass", press=1)
    assert refused.kind is FaultCode.ANOTHER_PRESS
    assert await held.wait(0.0) is None
    station.jobs.done.set_result(_touched(measured={"verdict": "pass"}, op="probe"))
    await _ask(handlers, "lift", id="t", verdict="pass", press=2)
    assert await held.wait(60.0) == "lift"


async def test_a_word_of_another_press_than_the_last_is_refused_after_the_end(
    handlers: Handlers, journal: Journal
) -> None:
    said = {"verdict": "open"}
    result = await _touched_before(journal, said, op="probe", detail={"measured": said, "press": 2})
    assert (await _refused(handlers, "lift", id="t", press=1, **said)).kind is FaultCode.ANOTHER_PRESS
    assert await _ask(handlers, "lift", id="t", press=2, **said) == JobReply(id="t", result=result)


async def test_a_press_of_a_touch_that_nobody_knows_is_refused_and_no_lift(handlers: Handlers, station: Daemon) -> None:
    assert (await _refused(handlers, "lift", id="mistyped", press=2)).kind is FaultCode.UNKNOWN_JOB
    assert station.jobs.taken.empty()


def _touched(measured: dict[str, Any] | None, **changes: Any) -> JobResult:
    return DONE.model_copy(update={"id": "t", "op": "touch", "detail": {"measured": measured}, **changes})


async def _touched_before(journal: Journal, measured: dict[str, Any] | None, **changes: Any) -> JobResult:
    await journal.add_job("t", "touch", "{}")
    result = _touched(measured, **{"seq": journal.take_seq(), **changes})
    await journal.finish_job(result)
    return result


async def test_lift_of_a_touch_that_is_over_answers_what_came_of_it(handlers: Handlers, journal: Journal) -> None:
    result = await _touched_before(journal, {"verdict": "pass", "value": 0.4})
    for said in ({"verdict": "pass", "value": 0.4}, {}):
        assert await _ask(handlers, "lift", id="t", **said) == JobReply(id="t", result=result)


@pytest.mark.parametrize("kept", [{"verdict": "open"}, {"verdict": "pass", "value": 0.4}, None])
async def test_a_verdict_that_is_not_the_one_that_was_kept_is_refused(
    handlers: Handlers, journal: Journal, kept: dict[str, Any] | None
) -> None:
    await _touched_before(journal, kept)
    refused = await _refused(handlers, "lift", id="t", verdict="pass")
    assert refused.kind is FaultCode.VERDICT_NOT_KEPT
    assert refused.detail["kept"] == kept


async def test_a_verdict_that_comes_while_the_result_is_being_written_is_refused(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = held = _standing("t")
    assert held.close() == {}
    answer = asyncio.create_task(_refused(handlers, "lift", id="t", verdict="pass"))
    await asyncio.sleep(0)
    station.jobs.done.set_result(_touched(measured=None))
    assert (await answer).kind is FaultCode.VERDICT_NOT_KEPT


async def test_lift_of_a_touch_that_failed_answers_how_it_failed_whatever_was_measured(
    handlers: Handlers, journal: Journal
) -> None:
    result = await _touched_before(journal, None, ok=False)
    assert await _ask(handlers, "lift", id="t", verdict="pass") == JobReply(id="t", result=result)


async def test_what_was_measured_in_a_touch_that_nobody_knows_is_refused_and_no_lift(
    handlers: Handlers, station: Daemon
) -> None:
    assert (await _refused(handlers, "lift", id="mistyped", verdict="pass")).kind is FaultCode.UNKNOWN_JOB
    assert station.jobs.taken.empty()


@pytest.mark.parametrize("op", ["hold", "lift"])
async def test_only_the_client_that_touched_may_hold_or_lift(handlers: Handlers, station: Daemon, op: str) -> None:
    station.jobs.touches["t"] = held = _standing("t", key="tester-2")
    assert (await _refused(handlers, op, id="t")).kind is FaultCode.NOT_THE_HOLDER
    request = OPERATIONS.parse({"op": "hold", "id": "t", "lease_ms": 500})
    reply: Any = handlers.at_once(request, Caller("tester-2", "operate", "tester-2"))
    assert (reply.id, reply.until_ms) == ("t", 500.0)
    assert await held.wait(0.0) is None


async def test_a_late_joiner_is_told_of_the_needle_that_is_held_down(handlers: Handlers, station: Daemon) -> None:
    assert (await _ask(handlers, "snapshot")).contact is None
    station.jobs.contact = ContactFacts(**CONTACT)
    assert (await _ask(handlers, "snapshot")).contact == station.jobs.contact


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
    station.against = Fault(FaultCode.LIGHT_FAILED)
    assert (await _refused(handlers, "reset")) is station.against


async def test_reset_that_leaves_but_homing_says_that_it_worked(handlers: Handlers, station: Daemon) -> None:
    station.against = Fault(FaultCode.NOT_HOMED, "x has no reference", axis="x")
    told = await _refused(handlers, "reset")
    assert (told.kind, told.detail["reset"], told.detail["axis"]) == (FaultCode.NOT_HOMED, "done", "x")
    assert told.message.startswith("the reset worked")
    assert "x has no reference" in told.message


async def test_a_lamp_is_switched_on_for_its_lease(handlers: Handlers, station: Daemon) -> None:
    reply = await _ask(handlers, "light", colour="red", lease_ms=5000)
    assert station.lit == [(Light.RED, 5.0)]
    assert (reply.colour, reply.until_ms) == ("red", 5000)


async def test_status_of_an_idle_station_says_what_it_lacks(handlers: Handlers, station: Daemon) -> None:
    status = await _ask(handlers, "status")
    assert (status.station, status.state, status.lifecycle) == (station.config.station.name, "idle", "ready")
    assert (status.fault, status.running, status.queued, status.pictures) == (None, None, 0, "kept")
    assert status.calibration.model_dump() == {
        "tip": False, "map_made_at": None, "made_at": {"map": "2025-03-04"}, "aligned": False,
        "not_used": {"surface": "it was made with another probe"},
    }  # fmt: skip


async def test_status_says_what_is_wrong_with_a_refused_file_until_it_is_mended(
    handlers: Handlers, settings: CurrentSettings
) -> None:
    assert (await _ask(handlers, "status")).configuration_refused == []
    settings.note_reload("refused", {"problems": [["servo.tolerance_um", "is too small (line 3)"]]})
    assert (await _ask(handlers, "status")).configuration_refused == ["servo.tolerance_um: is too small (line 3)"]
    settings.note_reload("taken", {})
    assert (await _ask(handlers, "snapshot")).configuration_refused == []


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
    assert (snapshot.run, len(snapshot.board_revision)) == (None, 16)
    run = a_run(("A", "B"))
    await journal.runs.begin(run)
    await journal.add_point(run.id, a_record("A", PointVerdict.FAIL, run=run.id))
    told = (await _ask(handlers, "snapshot")).run
    assert (told.id, told.plan, told.state, told.points, told.done) == (
        run.id, run.plan.name, "unfinished", len(run.plan.tests), 1,
    )  # fmt: skip
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


# --- records --------------------------------------------------------------------------------------------------


async def test_history_goes_back_from_the_newest_result_page_by_page(handlers: Handlers, journal: Journal) -> None:
    seqs = [(await _run(journal, f"j{n}")).seq for n in range(5)]
    first = await _ask(handlers, "history", limit=2)
    assert [result.seq for result in first.results] == seqs[:2:-1]
    assert first.more
    rest = await _ask(handlers, "history", before=first.results[-1].seq, limit=3)
    assert [result.seq for result in rest.results] == seqs[2::-1]
    assert not rest.more


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ({"of": "correct"}, ["c", "a"]),
        ({"test_point": "TP7"}, ["d", "a"]),
        ({"board_id": "SN-2"}, ["d", "c"]),
        ({"outcome": "failed"}, ["c"]),
        ({"board_id": "SN-2", "test_point": "TP7"}, ["d"]),
        ({"board_id": "SN-9"}, []),
        ({}, ["d", "c", "b", "a"]),
    ],
    ids=str,
)
async def test_history_finds_by_operation_point_board_and_outcome(
    asked: dict[str, Any], found: list[str], handlers: Handlers, journal: Journal
) -> None:
    for job, op, point, board, outcome in (
        ("a", "correct", "TP7", "SN-1", "corrected"), ("b", "home", None, None, "homed"),
        ("c", "correct", "TP8", "SN-2", "failed"), ("d", "place", "TP7", "SN-2", "placed"),
    ):  # fmt: skip
        await journal.add_job(job, op, json.dumps({"op": op} | ({"board_id": board} if board else {})))
        change = {"id": job, "op": op, "test_point": point, "outcome": outcome, "seq": journal.take_seq()}
        await journal.finish_job(DONE.model_copy(update=change))
    await journal.add_job("open", "correct", "{}")
    reply = await _ask(handlers, "history", **asked)
    assert [result.id for result in reply.results] == found
    assert all(result.board_id == "SN-2" for result in reply.results if result.id in "cd")


async def test_each_order_is_written_down_with_who_gave_it_and_what_came_of_it(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.done.set_result(DONE)
    await _ask(handlers, "correct", id="c1", test_point="TP1", wait=True, by="Kim")
    await _refused(handlers, "cancel", by="Kim")
    await _ask(handlers, "note", by="Lee", what="login", detail="127.0.0.1")
    await _ask(handlers, "status", by="Lee")
    station.against = Fault(FaultCode.LINK_LOST)
    await _refused(handlers, "reset", caller=MAINTAINER)
    told = await _ask(handlers, "audit", caller=MAINTAINER)
    assert [(e.client, e.role, e.by, e.op, e.fields, e.outcome) for e in told.entries] == [
        ("page-maintain", "maintain", None, "reset", {}, "link_lost"),
        ("tester-1", "operate", "Lee", "note", {"what": "login", "detail": "127.0.0.1"}, "done"),
        ("tester-1", "operate", "Kim", "cancel", {}, "unknown_job"),
        ("tester-1", "operate", "Kim", "correct", {"id": "c1", "test_point": "TP1"}, "corrected"),
    ]
    assert not told.more


async def test_a_point_is_forbidden_and_approved_by_a_person_with_a_reason(handlers: Handlers) -> None:
    assert (await _ask(handlers, "marks")).marks == []
    await _ask(handlers, "mark", test_point="TP1", mark="forbidden", reason="its trace lifts", by="Kim")
    (mark,) = (await _ask(handlers, "marks")).marks
    assert (mark.point, mark.mark, mark.reason, mark.by) == ("TP1", "forbidden", "its trace lifts", "Kim")
    await _ask(handlers, "mark", test_point="TP1", mark="approved", reason="mended")
    (mark,) = (await _ask(handlers, "marks")).marks
    assert (mark.mark, mark.by) == ("approved", CALLER.key or CALLER.client)
    unknown = await _refused(handlers, "mark", test_point="TP99", mark="forbidden", reason="x")
    assert unknown.kind is FaultCode.UNKNOWN_TEST_POINT
    for reason in ("", "   "):
        assert (await _refused(handlers, "mark", test_point="TP1", mark="approved", reason=reason)).kind is (
            FaultCode.INVALID_REQUEST
        )


async def test_a_pause_names_the_run_that_ends_and_what_only_asks_of_plans_is_no_order(handlers: Handlers) -> None:
    assert (await _ask(handlers, "pause", by="Kim")).paused == "run-1"
    assert (await _ask(handlers, "pause", id="r")).paused == "r"
    await _ask(handlers, "plan", caller=MAINTAINER)
    entries = (await _ask(handlers, "audit", caller=MAINTAINER)).entries
    assert [(entry.op, entry.by) for entry in entries] == [("pause", None), ("pause", "Kim")]


async def test_an_order_is_written_down_before_it_is_carried_out(handlers: Handlers, station: Daemon) -> None:
    asking = asyncio.create_task(_ask(handlers, "correct", id="c1", test_point="TP1", wait=True))
    await station.jobs.taken.get()
    (entry,) = (await _ask(handlers, "audit", caller=MAINTAINER)).entries
    assert (entry.op, entry.outcome) == ("correct", None)
    station.jobs.done.set_result(DONE)
    await asking
    (entry,) = (await _ask(handlers, "audit", caller=MAINTAINER)).entries
    assert entry.outcome == "corrected"


async def test_an_order_goes_through_where_it_cannot_be_written_down(
    handlers: Handlers, station: Daemon, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def full(*_args: object) -> int:
        raise Fault(FaultCode.JOURNAL_FAILED, "no room")

    monkeypatch.setattr(journal, "begin_order", full)
    station.jobs.running = SimpleNamespace(id="j1", op="correct")
    assert (await _ask(handlers, "cancel")).cancelled == "j1"


async def test_a_kept_picture_is_told_by_name_and_sent_in_one_frame(handlers: Handlers) -> None:
    listed = await _ask(handlers, "pictures", id="j1")
    assert (listed.pictures, listed.sha256) == (["before-red"], {"before-red": hashlib.sha256(b"j1").hexdigest()})
    reply = await _ask(handlers, "picture", id="j1", which="before-red")
    assert (reply.id, reply.which, base64.b64decode(reply.jpeg)) == ("j1", "before-red", b"j1")
    fault = await _refused(handlers, "picture", id="j1", which="after-red")
    assert fault.kind is FaultCode.UNKNOWN_PICTURE


async def test_a_job_sent_again_by_another_person_is_the_same_job(handlers: Handlers) -> None:
    one, two = (OPERATIONS.parse({"op": "home", "id": "h", "by": by}) for by in ("Kim", "Lee"))
    assert one.model_dump_json() == two.model_dump_json()


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


async def test_a_station_in_fault_is_never_called_healthy_and_its_cause_is_told(
    handlers: Handlers, station: Daemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    calm = {"healthy": True, "standing": [], "watches": [], "touches": 48, "off": []}
    monkeypatch.setattr(station.monitor, "overview", lambda: dict(calm))
    station.calibrations.probe, station.calibrations.mapped_at = object(), "2025-03-04"
    well = await _ask(handlers, "alerts")
    assert (well.healthy, well.fault, well.not_calibrated) == (True, None, [])
    station.latch.latch(Fault(FaultCode.NOT_HOMED))
    bad = await _ask(handlers, "alerts")
    assert (bad.healthy, bad.fault.name) == (False, "not_homed")


async def test_a_station_that_corrects_nothing_for_want_of_a_calibration_is_not_called_healthy(
    handlers: Handlers, station: Daemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    calm = {"healthy": True, "standing": [], "watches": [], "touches": 48, "off": []}
    monkeypatch.setattr(station.monitor, "overview", lambda: dict(calm))
    bare = await _ask(handlers, "alerts")
    assert (bare.healthy, bare.not_calibrated) == (False, ["tip", "map"])
    station.calibrations.probe = object()
    taught = await _ask(handlers, "alerts")
    assert (taught.healthy, taught.not_calibrated) == (False, ["map"])


async def test_an_acknowledgement_is_handed_over_whole_and_the_alert_answered(
    handlers: Handlers, station: Daemon
) -> None:
    asked = {"alert": "light_white", "by": "Kim", "note": "ring ordered", "mended": True}
    reply = await _ask(handlers, "acknowledge", caller=MAINTAINER, **asked)
    assert station.monitor.acknowledged == [("light_white", "Kim", "ring ordered", True)]
    assert reply.alert.model_dump() == station.monitor.alert.to_dict()


async def test_an_operator_may_say_that_he_knows_of_an_alert_but_not_that_it_is_mended(
    handlers: Handlers, station: Daemon
) -> None:
    await _ask(handlers, "acknowledge", alert="light_white", by="Kim")
    assert station.monitor.acknowledged == [("light_white", "Kim", "", False)]
    fault = await _refused(handlers, "acknowledge", alert="light_white", by="Kim", mended=True)
    assert (fault.kind, fault.detail["needs"]) == (FaultCode.NOT_ALLOWED, "maintain")
    assert len(station.monitor.acknowledged) == 1


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


async def test_settings_in_force_are_told_with_their_source_and_no_place_on_the_computer(
    handlers: Handlers, station: Daemon
) -> None:
    reply = await _ask(handlers, "config")
    told = {setting.name: setting for setting in reply.settings}
    assert told["station.name"].value == station.config.station.name
    assert told["station.name"].source == "file"
    assert told["api.heartbeat_s"].value == station.config.api.heartbeat_s
    assert told["api.heartbeat_s"].source == "default"
    assert told["axes.x.address"].value == station.config.axes.x.address
    assert [s.name for s in reply.settings if isinstance(s.value, str) and "/" in s.value] == []
    assert not told.keys() & {"station.data_dir", "board.file", "api.keys_dir", "api.control", "bus.main.port"}


async def test_describe_tells_board_errors_and_limits(handlers: Handlers, station: Daemon) -> None:
    told = await _ask(handlers, "describe")
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
