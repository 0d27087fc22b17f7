"""The live view is right after any order of snapshot, events, gaps and restarts."""

from __future__ import annotations

import io
import re
import time
from typing import Any, cast

import pytest
from rich.console import Console

from daemon.cli.formatting import calibrated, sentence
from daemon.cli.watch import refresh
from daemon.cli.watch_view import SILENT_S, WatchView
from daemon.client import Client
from daemon.domain.results import ErrorBody, JobResult
from daemon.platform.clock import utc_now

SNAPSHOT: dict[str, Any] = {
    "station": "s1", "state": "idle", "fault": None, "running": None, "queued": 0, "next_seq": 10, "last_result": None,
    "calibration": {"made_at": {"map": utc_now()}},
    "links": {
        "buses": {"main": {"connected": 1, "requests": 5, "timeouts": 0, "garbled": 0, "reconnects": 0}},
        "camera": {"grabbed": 100, "missed": 3, "timeouts": 0, "reopened": 0},
    },
}  # fmt: skip


def _view() -> WatchView:
    view = WatchView()
    view.take_snapshot(SNAPSHOT, 0.0)
    return view


def _event(topic: str, seq: int, **body: Any) -> dict[str, Any]:
    return {"topic": topic, "seq": seq, "time": utc_now(), "station": "s1", "v": 1, **body}


def _result(seq: int, point: str) -> dict[str, Any]:
    result = JobResult(id=f"j{seq}", op="correct", ok=True, seq=seq, station="s1", finished_at=utc_now(),
                       outcome="corrected", test_point=point, error_before_um=90.0, error_after_um=5.0)  # fmt: skip
    return _event("result", **result.model_dump(mode="json", exclude={"station"}))


def _text(view: WatchView, now_s: float = 1.0) -> str:
    console = Console(width=120, record=True, file=open("/dev/null", "w"))  # noqa: PTH123, SIM115
    with console.file:
        console.print(view.render(now_s))
        return console.export_text()


def test_before_anything_is_heard_it_says_so_with_the_cure_and_nothing_that_nobody_knows() -> None:
    shown = _text(WatchView(endpoint="ipc:///run/x"))
    assert "no daemon answers at ipc:///run/x yet" in shown
    assert "systemctl start reprobe" in shown
    for unknown in ("no alerts", "no job runs", "calibrated"):
        assert unknown not in shown


def test_a_daemon_that_fell_silent_is_told_first_with_the_cure() -> None:
    lines = _text(_view(), SILENT_S + 60.0).splitlines()
    assert "nothing heard for" in lines[1]
    assert "systemctl status reprobe" in lines[1]
    assert "before that: idle" in lines[2]


def test_an_alert_is_shown_with_its_cure_where_there_is_room() -> None:
    view = _view()
    view.take_snapshot({**SNAPSHOT, "alerts": [{"name": "tip", "message": "bent", "advice": "straighten it"}]}, 0.0)
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(view.render(1.0, 80, 24))
    assert "idle, alert tip: bent -> straighten it" in console.export_text().splitlines()[1]
    console.print(view.render(1.0, 80, 11))
    cramped = console.export_text()
    assert "alert tip: bent" in cramped
    assert "straighten it" not in cramped


def test_what_was_done_is_counted_as_people_count_and_a_taught_tip_is_a_calibration() -> None:
    result = JobResult(
        id="j", op="look", ok=True, seq=1, station="s1", finished_at=utc_now(), outcome="looked", looks=1
    )
    assert sentence(result).endswith("looked[/], 1 look")
    assert sentence(result.model_copy(update={"looks": 2, "moves": 1})).endswith(", 2 looks, 1 move")
    assert calibrated({"tip": True, "made_at": {}}) == "tip"
    assert calibrated({"tip": False, "made_at": {}}) == "nothing"


class _Asked:
    """Stands for a client of a station with an alert from before."""

    def request(self, op: str, **_: object) -> dict[str, Any]:
        standing = [{"name": "tip_refused", "message": "the tip is refused", "advice": "look at it"}]
        return {"snapshot": dict(SNAPSHOT), "alerts": {"standing": standing}}[op]


def test_alerts_from_before_it_was_opened_are_shown() -> None:
    view = WatchView()
    refresh(cast("Client", _Asked()), view)
    assert view.alerts == {"tip_refused": "the tip is refused"}
    assert "no alerts" not in _text(view)


def test_snapshot_and_events_make_one_picture() -> None:
    view = _view()
    assert not view.take(_event("state", 10, state="look", was="idle", event="x", job="j1", fault=None), 1.0)
    view.take(_event("progress", 11, job="j1", op="calibrate", done=3, total=8, doing="mapping"), 1.0)
    view.take(_event("alert", 12, name="tip_wear", raised=True, message="the tip is [worn]"), 1.0)
    shown = _text(view)
    for words in ("look", "3/8", "mapping", "tip_wear", "the tip is [worn]", "bus main: connected", "3 missed", "map"):
        assert words in shown
    view.take(_result(13, "TP7"), 1.0)
    view.take(_event("alert", 14, name="tip_wear", raised=False), 1.0)
    shown = _text(view)
    assert "TP7, 90 -> 5 um" in shown
    assert "no job runs" in shown
    assert "no alerts" in shown


def test_missed_events_are_counted_and_a_snapshot_is_asked_for() -> None:
    view = _view()
    assert view.take(_event("heartbeat", 15, state="idle", version="1"), 1.0)
    assert (view.missed, view.last_gap) == (5, (10, 14))
    assert "5 events missed, last 10..14" in _text(view)
    assert not view.take(_event("heartbeat", 16, state="idle", version="1"), 1.0)


def test_an_event_older_than_the_snapshot_changes_nothing() -> None:
    view = _view()
    assert not view.take(_event("state", 8, state="fault", was="x", event="x", job=None, fault=None), 1.0)
    assert (view.state, view.missed, view.next_seq) == ("idle", 0, 10)


def test_a_daemon_that_is_gone_is_said_to_be_and_one_that_is_back_is_asked() -> None:
    view = _view()
    later_s = SILENT_S + 2.0
    assert "nothing heard for" in _text(view, later_s)
    assert view.take(_event("heartbeat", 10, state="fault", version="2"), later_s)
    assert view.state == "fault"
    assert "nothing heard" not in _text(view, later_s)


def test_a_journal_begun_anew_is_no_gap() -> None:
    view = _view()
    assert view.take(_event("heartbeat", 1, state="fault", version="2"), SILENT_S + 1.0)
    assert (view.missed, view.next_seq) == (0, 2)


def test_results_that_were_replayed_stand_once_and_in_their_place() -> None:
    view = _view()
    view.take(_result(10, "TP3"), 1.0)
    for seq in (10, 8):
        body = {name: value for name, value in _result(seq, f"TP{seq}").items() if name in JobResult.model_fields}
        view.take_result(JobResult.model_validate(body))
    assert [result.seq for result in view.results] == [8, 10]


def test_an_event_that_was_overtaken_is_taken_and_is_no_gap() -> None:
    view = _view()
    view.take(_event("heartbeat", 11, state="idle", version="1"), 1.0)
    assert view.missed == 1
    assert not view.take(_result(10, "TP7"), 1.0)
    assert (view.missed, [result.seq for result in view.results], view.next_seq) == (0, [10], 12)
    assert "missed, last" not in _text(view)


# --- at 80 x 24 -------------------------------------------------------------------------------------------------------

FAULT = {
    "name": "drive_fault", "code": 3104, "message": "axis z reports following error 8611h at 5210 um",
    "advice": "See that nothing blocks Z, then `reprobe reset`.", "detail": {},
}  # fmt: skip


def _screen(view: WatchView) -> list[str]:
    console = Console(width=80, height=24, record=True, file=open("/dev/null", "w"))  # noqa: PTH123, SIM115
    with console.file:
        console.print(view.render(1.0, 80, 24))
        return console.export_text().splitlines()


def test_cause_and_cure_come_first_and_alerts_stand_above_what_was() -> None:
    view = _view()
    for seq in range(10, 20):
        view.take(_result(seq, f"TP{seq}"), 1.0)
    for seq in range(20, 27):
        view.take(_event("alert", seq, name=f"watch_{seq}", raised=True, message="the white ring is darker " * 3), 1.0)
    view.take(_event("state", 27, state="fault", was="look", event="failed", job=None, fault=FAULT), 1.0)
    screen = _screen(view)
    assert len(screen) <= 24, "nothing falls off the bottom"
    head = " ".join(line.strip("\u2502 ") for line in screen[1:4])
    assert head.startswith("fault drive_fault: axis z reports following error 8611h at 5210 um")
    assert "-> See that nothing blocks Z, then `reprobe reset`." in head
    text = "\n".join(screen)
    assert text.index("watch_20") < text.index("last results")
    assert "and 3 more" in text
    assert "TP19" in text
    assert "no alerts" not in text


def _failed(seq: int, point: str) -> dict[str, Any]:
    error = ErrorBody.model_validate({
        "name": "frame_unusable", "code": 2301, "advice": "see whether the white ring shines during a look: if not, "
        "check its plug, its lamp and its relay channel", "detail": {},
        "message": "the picture under white light is dark: nothing brighter than level 9",
    })  # fmt: skip
    result = JobResult(id=f"j{seq}", op="correct", ok=False, seq=seq, station="s1", finished_at=utc_now(),
                       outcome="failed", test_point=point, error=error)  # fmt: skip
    return _event("result", **result.model_dump(mode="json", exclude={"station"}))


def test_the_newest_result_that_failed_is_spelt_out_with_its_cure_where_there_is_room() -> None:
    view = _view()
    for seq in range(10, 18):
        view.take(_failed(seq, f"TP{seq}"), 1.0)
    screen = _screen(view)
    assert len(screen) <= 24
    text = " ".join(line.strip("\u2502 ") for line in screen)
    assert "is dark: nothing brighter than level 9" in text
    assert "no alerts; the last job failed" in text
    assert "-> see whether the white ring shines" in text
    assert "its relay channel" in text
    assert text.index("TP17 failed") < text.index("TP16 failed"), "the one before has its line"
    assert len(re.findall(r"\d\d:\d\d:\d\d", text)) >= 5, "each with its time"


def test_a_long_result_takes_no_time_from_the_screen_and_a_job_stays_in_one_line() -> None:
    view = _view()
    view.take(_failed(10, "TP1"), 1.0)
    view.take(_result(11, "TP2"), 1.0)
    job = {
        "job": "calibrate-939bef4dc700",
        "op": "calibrate",
        "done": 3,
        "total": 12,
        "doing": "touching the test point",
    }
    view.take(_event("progress", 12, **job), 1.0)
    screen = _screen(view)
    assert all(len(line) == 80 for line in screen)
    running = [line for line in screen if "running" in line or "touching" in line]
    assert len(running) == 1
    assert "3/12" in running[0]
    assert any(re.search(r"\d\d:\d\d:\d\d correct TP1 failed", line) for line in screen)


def test_a_fault_without_its_cause_is_asked_for_and_never_green() -> None:
    view = _view()
    assert view.take(_event("heartbeat", 10, state="fault", version="1"), 1.0), "a snapshot is asked for"
    assert "no alerts beside the fault" in _text(view)
    view.take_snapshot({**SNAPSHOT, "state": "fault", "fault": FAULT, "next_seq": 11}, 1.0)
    assert not view.take(_event("heartbeat", 11, state="fault", version="1"), 1.0)


def test_times_are_those_of_the_wall_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    try:
        view = _view()
        event = _result(10, "TP7")
        event["finished_at"] = "2025-03-04T20:15:00+00:00"
        view.take(event, 1.0)
        assert "05:15:00" in _text(view)
    finally:
        monkeypatch.undo()
        time.tzset()
