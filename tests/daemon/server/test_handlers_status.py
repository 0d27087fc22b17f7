"""Queue and machine: what a client is told of the station and its jobs, and what moves it on."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from daemon.config.current import CurrentSettings
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointVerdict
from daemon.domain.results import ErrorBody, JobResult
from daemon.server.handlers import Handlers
from daemon.storage.journal import Journal
from drivers.gantry import Position
from drivers.lights import Light
from tests.daemon.domain.test_board_run import a_record, a_run
from tests.daemon.server.fake_daemon import (
    VITALS,
    Daemon,
    ask,
    kept_job,
    refusal,
)


async def test_cancel_names_the_job_that_stops(handlers: Handlers, station: Daemon) -> None:
    station.jobs.running = SimpleNamespace(id="a", op="place")
    assert (await ask(handlers, "cancel")).cancelled == "a"
    assert (await ask(handlers, "cancel", id="b")).cancelled == "b"


async def test_cancel_is_refused_where_nothing_runs(handlers: Handlers) -> None:
    assert (await refusal(handlers, "cancel")).kind is FaultCode.UNKNOWN_JOB


async def test_reset_answers_the_status_it_led_to(handlers: Handlers, station: Daemon) -> None:
    assert (await ask(handlers, "reset")).state == "idle"
    assert station.resets == 1


async def test_reset_is_refused_with_what_still_speaks_against_it(handlers: Handlers, station: Daemon) -> None:
    station.against = Fault(FaultCode.LIGHT_FAILED)
    assert (await refusal(handlers, "reset")) is station.against


async def test_reset_that_leaves_but_homing_says_that_it_worked(handlers: Handlers, station: Daemon) -> None:
    station.against = Fault(FaultCode.NOT_HOMED, "x has no reference", axis="x")
    told = await refusal(handlers, "reset")
    assert (told.kind, told.detail["reset"], told.detail["axis"]) == (FaultCode.NOT_HOMED, "done", "x")
    assert told.message.startswith("the reset worked")
    assert "x has no reference" in told.message


async def test_a_lamp_is_switched_on_for_its_lease(handlers: Handlers, station: Daemon) -> None:
    reply = await ask(handlers, "light", colour="red", lease_ms=5000)
    assert station.lit == [(Light.RED, 5.0)]
    assert (reply.colour, reply.until_ms) == ("red", 5000)


async def test_status_of_an_idle_station_says_what_it_lacks(handlers: Handlers, station: Daemon) -> None:
    status = await ask(handlers, "status")
    assert (status.station, status.state, status.lifecycle) == (station.config.station.name, "idle", "ready")
    assert (status.fault, status.running, status.queued, status.pictures) == (None, None, 0, "kept")
    assert status.calibration.model_dump() == {
        "tip": False, "map_made_at": None, "made_at": {"map": "2025-03-04"}, "aligned": False,
        "not_used": {"surface": "it was made with another probe"},
    }  # fmt: skip


async def test_status_says_what_is_wrong_with_a_refused_file_until_it_is_mended(
    handlers: Handlers, settings: CurrentSettings
) -> None:
    assert (await ask(handlers, "status")).configuration_refused == []
    settings.note_reload("refused", {"problems": [["servo.tolerance_um", "is too small (line 3)"]]})
    assert (await ask(handlers, "status")).configuration_refused == ["servo.tolerance_um: is too small (line 3)"]
    settings.note_reload("taken", {})
    assert (await ask(handlers, "snapshot")).configuration_refused == []


async def test_status_always_says_where_the_needle_is(handlers: Handlers, station: Daemon) -> None:
    assert (await ask(handlers, "status")).needle.model_dump() == {"place": "unknown", "z_um": None}
    for z_um, place in ((12_000.0, "up"), (4_900.0, "down")):
        station.needle.reported(Position(0.0, 0.0, z_um, 0.0))
        for op in ("status", "snapshot"):
            assert (await ask(handlers, op)).needle.model_dump() == {"place": place, "z_um": z_um}


async def test_status_of_a_busy_station_names_its_job_and_how_far_it_is(handlers: Handlers, station: Daemon) -> None:
    station.latch.begin("calibrate", "a")
    station.jobs.running = SimpleNamespace(id="a", op="calibrate")
    station.jobs.progress = {"done": 1, "total": 9, "doing": "looking"}
    station.jobs.queued = 2
    station.pictures.full = "the disk is full"
    station.calibrations.probe = station.calibrations.alignment = lambda _board: object()
    status = await ask(handlers, "status")
    assert (status.state, status.queued, status.pictures) == ("triggered", 2, "the disk is full")
    assert status.running.model_dump() == {"id": "a", "op": "calibrate", "progress": station.jobs.progress}
    assert (status.calibration.tip, status.calibration.aligned) == (True, True)


async def test_status_in_fault_names_the_first_cause(handlers: Handlers, station: Daemon) -> None:
    stalled = Fault(FaultCode.AXIS_STALLED, "Z stopped short")
    station.latch.latch(stalled)
    station.latch.latch(Fault(FaultCode.LINK_LOST))
    status = await ask(handlers, "status")
    assert status.state == "fault"
    assert status.fault == ErrorBody.of(stalled)


async def test_a_snapshot_is_the_status_and_all_a_late_joiner_needs(handlers: Handlers, journal: Journal) -> None:
    await kept_job(journal, "first")
    last = await kept_job(journal, "second")
    await journal.add_report(None, None, 12)
    snapshot = await ask(handlers, "snapshot")
    status = await ask(handlers, "status")
    assert status.model_dump().items() <= snapshot.model_dump().items()
    assert (snapshot.last_result, snapshot.next_seq, snapshot.touches) == (last, last.seq + 1, 12)
    assert (snapshot.run, len(snapshot.board_revision)) == (None, 16)
    run = a_run(("A", "B"))
    await journal.runs.begin(run)
    await journal.add_point(run.id, a_record("A", PointVerdict.FAIL, run=run.id))
    told = (await ask(handlers, "snapshot")).run
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
        await kept_job(journal, "meanwhile")
        return found

    monkeypatch.setattr(journal, "last_result", published_meanwhile)
    snapshot = await ask(handlers, "snapshot")
    replayed = await ask(handlers, "results", since=snapshot.next_seq)
    assert snapshot.last_result is None
    assert [result.id for result in replayed.results] == ["meanwhile"]


async def test_a_snapshot_of_a_new_station_has_no_result(handlers: Handlers) -> None:
    assert (await ask(handlers, "snapshot")).last_result is None


async def test_the_result_of_a_job_is_told_once_there_is_one(handlers: Handlers, journal: Journal) -> None:
    await kept_job(journal, "open", finished=False)
    done = await kept_job(journal, "done")
    waits = await ask(handlers, "result", id="open")
    assert (waits.id, waits.done, waits.result) == ("open", False, None)
    told = await ask(handlers, "result", id="done")
    assert (told.id, told.done, told.result) == ("done", True, done)


async def test_the_result_of_a_job_nobody_knows_is_refused_with_its_id(handlers: Handlers) -> None:
    fault = await refusal(handlers, "result", id="never")
    assert (fault.kind, fault.detail["id"]) == (FaultCode.UNKNOWN_JOB, "never")


async def test_results_come_from_a_number_on_and_no_more_than_asked_for(handlers: Handlers, journal: Journal) -> None:
    seqs = [(await kept_job(journal, f"j{n}")).seq for n in range(4)]
    reply = await ask(handlers, "results", since=seqs[1], limit=2)
    assert [result.seq for result in reply.results] == seqs[1:3]
