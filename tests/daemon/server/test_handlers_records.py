"""Records: results, orders, points and pictures, and how healthy the station is called."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.server.handlers import Handlers
from daemon.storage.journal import Journal
from daemon.wire.operations.table import OPERATIONS
from tests.daemon.server.fake_daemon import (
    CALLER,
    DONE,
    MAINTAINER,
    Daemon,
    ask,
    kept_job,
    refusal,
)


async def test_history_goes_back_from_the_newest_result_page_by_page(handlers: Handlers, journal: Journal) -> None:
    seqs = [(await kept_job(journal, f"j{n}")).seq for n in range(5)]
    first = await ask(handlers, "history", limit=2)
    assert [result.seq for result in first.results] == seqs[:2:-1]
    assert first.more
    rest = await ask(handlers, "history", before=first.results[-1].seq, limit=3)
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
    reply = await ask(handlers, "history", **asked)
    assert [result.id for result in reply.results] == found
    assert all(result.board_id == "SN-2" for result in reply.results if result.id in "cd")


async def test_each_order_is_written_down_with_who_gave_it_and_what_came_of_it(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.done.set_result(DONE)
    await ask(handlers, "correct", id="c1", test_point="TP1", wait=True, by="Kim")
    await refusal(handlers, "cancel", by="Kim")
    await ask(handlers, "note", by="Lee", what="login", detail="127.0.0.1")
    await ask(handlers, "status", by="Lee")
    station.against = Fault(FaultCode.LINK_LOST)
    await refusal(handlers, "reset", caller=MAINTAINER)
    told = await ask(handlers, "audit", caller=MAINTAINER)
    assert [(e.client, e.role, e.by, e.op, e.fields, e.outcome) for e in told.entries] == [
        ("page-maintain", "maintain", None, "reset", {}, "link_lost"),
        ("tester-1", "operate", "Lee", "note", {"what": "login", "detail": "127.0.0.1"}, "done"),
        ("tester-1", "operate", "Kim", "cancel", {}, "unknown_job"),
        ("tester-1", "operate", "Kim", "correct", {"id": "c1", "test_point": "TP1"}, "corrected"),
    ]
    assert not told.more


async def test_a_point_is_forbidden_and_approved_by_a_person_with_a_reason(handlers: Handlers) -> None:
    assert (await ask(handlers, "marks")).marks == []
    await ask(handlers, "mark", test_point="TP1", mark="forbidden", reason="its trace lifts", by="Kim")
    (mark,) = (await ask(handlers, "marks")).marks
    assert (mark.point, mark.mark, mark.reason, mark.by) == ("TP1", "forbidden", "its trace lifts", "Kim")
    await ask(handlers, "mark", test_point="TP1", mark="approved", reason="mended")
    (mark,) = (await ask(handlers, "marks")).marks
    assert (mark.mark, mark.by) == ("approved", CALLER.key or CALLER.client)
    unknown = await refusal(handlers, "mark", test_point="TP99", mark="forbidden", reason="x")
    assert unknown.kind is FaultCode.UNKNOWN_TEST_POINT
    for reason in ("", "   "):
        assert (await refusal(handlers, "mark", test_point="TP1", mark="approved", reason=reason)).kind is (
            FaultCode.INVALID_REQUEST
        )


async def test_a_pause_names_the_run_that_ends_and_what_only_asks_of_plans_is_no_order(handlers: Handlers) -> None:
    assert (await ask(handlers, "pause", by="Kim")).paused == "run-1"
    assert (await ask(handlers, "pause", id="r")).paused == "r"
    await ask(handlers, "plan", caller=MAINTAINER)
    entries = (await ask(handlers, "audit", caller=MAINTAINER)).entries
    assert [(entry.op, entry.by) for entry in entries] == [("pause", None), ("pause", "Kim")]


async def test_an_order_is_written_down_before_it_is_carried_out(handlers: Handlers, station: Daemon) -> None:
    asking = asyncio.create_task(ask(handlers, "correct", id="c1", test_point="TP1", wait=True))
    await station.jobs.taken.get()
    (entry,) = (await ask(handlers, "audit", caller=MAINTAINER)).entries
    assert (entry.op, entry.outcome) == ("correct", None)
    station.jobs.done.set_result(DONE)
    await asking
    (entry,) = (await ask(handlers, "audit", caller=MAINTAINER)).entries
    assert entry.outcome == "corrected"


async def test_an_order_goes_through_where_it_cannot_be_written_down(
    handlers: Handlers, station: Daemon, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def full(*_args: object) -> int:
        raise Fault(FaultCode.JOURNAL_FAILED, "no room")

    monkeypatch.setattr(journal, "begin_order", full)
    station.jobs.running = SimpleNamespace(id="j1", op="correct")
    assert (await ask(handlers, "cancel")).cancelled == "j1"


async def test_a_kept_picture_is_told_by_name_and_sent_in_one_frame(handlers: Handlers) -> None:
    listed = await ask(handlers, "pictures", id="j1")
    assert (listed.pictures, listed.sha256) == (["before-red"], {"before-red": hashlib.sha256(b"j1").hexdigest()})
    reply = await ask(handlers, "picture", id="j1", which="before-red")
    assert (reply.id, reply.which, base64.b64decode(reply.jpeg)) == ("j1", "before-red", b"j1")
    fault = await refusal(handlers, "picture", id="j1", which="after-red")
    assert fault.kind is FaultCode.UNKNOWN_PICTURE


async def test_a_job_sent_again_by_another_person_is_the_same_job(handlers: Handlers) -> None:
    one, two = (OPERATIONS.parse({"op": "home", "id": "h", "by": by}) for by in ("Kim", "Lee"))
    assert one.model_dump_json() == two.model_dump_json()


async def test_alerts_are_those_of_the_journal_beside_how_the_station_stands(
    handlers: Handlers, station: Daemon, journal: Journal
) -> None:
    for seq in (5, 6, 7):
        await journal.add_alert(seq, station.monitor.alert.body("raised"))
    reply = await ask(handlers, "alerts", since=6, limit=1)
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
    well = await ask(handlers, "alerts")
    assert (well.healthy, well.fault, well.not_calibrated) == (True, None, [])
    station.latch.latch(Fault(FaultCode.NOT_HOMED))
    bad = await ask(handlers, "alerts")
    assert (bad.healthy, bad.fault.name) == (False, "not_homed")


async def test_a_station_that_corrects_nothing_for_want_of_a_calibration_is_not_called_healthy(
    handlers: Handlers, station: Daemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    calm = {"healthy": True, "standing": [], "watches": [], "touches": 48, "off": []}
    monkeypatch.setattr(station.monitor, "overview", lambda: dict(calm))
    bare = await ask(handlers, "alerts")
    assert (bare.healthy, bare.not_calibrated) == (False, ["tip", "map"])
    station.calibrations.probe = object()
    taught = await ask(handlers, "alerts")
    assert (taught.healthy, taught.not_calibrated) == (False, ["map"])


async def test_an_acknowledgement_is_handed_over_whole_and_the_alert_answered(
    handlers: Handlers, station: Daemon
) -> None:
    asked = {"alert": "light_white", "by": "Kim", "note": "ring ordered", "mended": True}
    reply = await ask(handlers, "acknowledge", caller=MAINTAINER, **asked)
    assert station.monitor.acknowledged == [("light_white", "Kim", "ring ordered", True)]
    assert reply.alert.model_dump() == station.monitor.alert.to_dict()


async def test_an_operator_may_say_that_he_knows_of_an_alert_but_not_that_it_is_mended(
    handlers: Handlers, station: Daemon
) -> None:
    await ask(handlers, "acknowledge", alert="light_white", by="Kim")
    assert station.monitor.acknowledged == [("light_white", "Kim", "", False)]
    fault = await refusal(handlers, "acknowledge", alert="light_white", by="Kim", mended=True)
    assert (fault.kind, fault.detail["needs"]) == (FaultCode.NOT_ALLOWED, "maintain")
    assert len(station.monitor.acknowledged) == 1


async def test_an_alert_that_does_not_stand_is_not_acknowledged(handlers: Handlers) -> None:
    fault = await refusal(handlers, "acknowledge", alert="light_red", by="Kim")
    assert (fault.kind, fault.detail["standing"]) == (FaultCode.UNKNOWN_ALERT, ["light_white"])


async def test_a_report_reaches_journal_metrics_and_monitor(
    handlers: Handlers, station: Daemon, journal: Journal
) -> None:
    await kept_job(journal, "a")
    assert (await ask(handlers, "report", touches=5)).touches == 5
    assert (await ask(handlers, "report", id="a", retest="pass", touches=20)).touches == 25
    assert station.reports == [(None, 5), ("pass", 20)]
    assert station.monitor.touches == [5, 20]


async def test_a_report_on_a_job_nobody_knows_is_refused_and_counts_nothing(
    handlers: Handlers, station: Daemon, journal: Journal
) -> None:
    assert (await refusal(handlers, "report", id="never", touches=3)).kind is FaultCode.UNKNOWN_JOB
    assert await journal.touches() == 0
    assert station.reports == []
    assert station.monitor.touches == []
