"""The mirror shows what was told, in order, and never patches over a gap."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.page.mirror import PARTS, RESULTS_SHOWN, Station, after, asks_again, lost, parts_changed, seen_whole
from daemon.wire.docs import examples
from daemon.wire.operations.table import OPERATIONS


def _reply(op: str, **changes: Any) -> dict[str, Any]:
    """Return an example reply, as a browser's page gets it."""
    row = OPERATIONS.row(op)
    told: dict[str, Any] = row.reply.model_validate(examples.reply(row)).model_dump(mode="json")
    return told | changes


def _whole(**snapshot: Any) -> Station:
    return seen_whole(Station(), _reply("snapshot", **snapshot), _reply("alerts"), _reply("history"))


def _event(topic: str, seq: int, **changes: Any) -> dict[str, Any]:
    return examples.event(topic) | {"seq": seq} | changes


@pytest.fixture
def seen() -> Station:
    return _whole(next_seq=100)


def test_a_snapshot_shows_state_results_and_standing_alerts(seen: Station) -> None:
    assert (seen.live, seen.name, seen.state, seen.lifecycle) == (True, "station-1", "idle", "ready")
    assert [result["id"] for result in seen.results] == ["board17-TP7-1"]
    assert [alert["name"] for alert in seen.alerts] == ["light_white"]


def test_a_daemon_that_does_not_tell_what_grew_later_is_shown_without_it() -> None:
    snapshot = {name: value for name, value in _reply("snapshot").items() if name not in ("run", "contact", "links")}
    alerts = {name: value for name, value in _reply("alerts").items() if name != "watches"}
    seen = seen_whole(Station(), snapshot, alerts, _reply("history"))
    assert (seen.live, seen.state, seen.run, seen.watches) == (True, "idle", None, ())


def test_states_come_in_the_order_they_were_told(seen: Station) -> None:
    states = []
    for n, state in enumerate(("triggered", "look", "move", "verify", "idle")):
        job = None if state == "idle" else "c1"
        seen = after(seen, _event("state", 100 + n, state=state, job=job))
        states.append((seen.state, seen.job["id"] if seen.job else None))
    assert states == [("triggered", "c1"), ("look", "c1"), ("move", "c1"), ("verify", "c1"), ("idle", None)]


def test_an_event_that_the_snapshot_held_changes_nothing(seen: Station) -> None:
    assert after(seen, _event("state", 99, state="move")) is seen


def test_a_gap_is_never_patched_over(seen: Station) -> None:
    stale = after(seen, _event("state", 101, state="move"))
    assert (stale.stale, stale.state) == (True, "idle")
    assert after(stale, _event("state", 102, state="look")) is stale, "nothing is believed until a snapshot is taken"
    again = seen_whole(stale, _reply("snapshot", next_seq=103), _reply("alerts"), _reply("history"))
    assert not again.stale


def test_a_topic_of_a_newer_daemon_moves_the_count_and_nothing_else(seen: Station) -> None:
    now = after(seen, {"topic": "weather", "seq": 100, "time": "t"})
    assert now == replace(seen, next_seq=101, heard_at="t")


def test_the_newest_result_is_first_and_its_job_is_over(seen: Station) -> None:
    busy = after(seen, _event("progress", 100, job="c2", op="correct"))
    assert busy.job is not None
    now = after(busy, _event("result", 101, id="c2"))
    assert (now.results[0]["id"], now.job) == ("c2", None)
    for n in range(40):
        now = after(now, _event("result", 102 + n, id=f"d{n}"))
    assert len(now.results) == RESULTS_SHOWN
    assert now.results[0]["id"] == "d39"


def test_an_alert_is_shown_while_it_stands_the_worst_first(seen: Station) -> None:
    worse = after(seen, _event("alert", 100, name="tip_refused", severity="serious"))
    assert [alert["name"] for alert in worse.alerts] == ["tip_refused", "light_white"]
    known = {"by": "Kim", "at": "2025-03-04T10:00:00+00:00", "note": "ring ordered"}
    told = after(worse, _event("alert", 101, change="acknowledged", acknowledged=known))
    assert told.alerts[1]["acknowledged"]["by"] == "Kim"
    gone = after(told, _event("alert", 102, name="tip_refused", raised=False, change="cleared"))
    assert [alert["name"] for alert in gone.alerts] == ["light_white"]


def test_the_needle_holds_while_a_contact_stands(seen: Station) -> None:
    made = after(seen, _event("contact", 100, change="made"))
    assert made.contact is not None
    assert after(made, _event("contact", 101, change="lifted")).contact is None


def test_a_run_that_begins_asks_which_one_it_is_and_each_point_counts(seen: Station) -> None:
    begun = after(seen, _event("progress", 100, job="run-2", op="run", done=0, total=2, doing="TP1"))
    assert begun.stale, "what runs is in the snapshot alone"
    run = {"id": "run-2", "board_id": "b", "plan": "p", "state": "unfinished", "points": 2, "done": 0}
    running = {"id": "run-2", "op": "run", "progress": {"done": 0, "total": 2, "doing": "TP1"}}
    now = seen_whole(
        begun, _reply("snapshot", next_seq=101, run=run, running=running), _reply("alerts"), _reply("history")
    )
    told = after(now, _event("progress", 101, job="run-2", op="run", done=0, total=2, doing="TP1"))
    assert not told.stale
    told = after(told, _event("point", 102, run="run-2", point="TP1"))
    assert told.run is not None
    assert told.point is not None
    assert (told.run["done"], told.point["point"]) == (1, "TP1")
    other = after(told, _event("point", 103, run=None, point="TP9"))
    assert other.run == told.run, "a point that was asked for alone is no part of it"


def test_a_lost_station_keeps_what_was_known_and_is_not_live(seen: Station) -> None:
    gone = lost(seen, "silent")
    assert (gone.live, gone.lost_why, gone.results) == (False, "silent", seen.results)
    assert after(gone, _event("heartbeat", 100)) is gone, "one heart beat does not tell what was missed"


@pytest.mark.parametrize(
    ("event", "again"),
    [
        (_event("result", 1), True), (_event("state", 1, state="idle"), True),
        (_event("state", 1, state="fault"), True),
        (_event("state", 1, state="move"), False), (_event("heartbeat", 1), False),
        (_event("heartbeat", 1, state="fault"), True), (_event("alert", 1), False),
    ],
)  # fmt: skip
def test_needle_queue_and_calibrations_are_asked_for_when_a_job_may_have_changed_them(
    event: dict[str, Any], *, again: bool
) -> None:
    assert asks_again(event) is again


def test_a_tab_gets_all_parts_first_and_then_those_that_changed(seen: Station) -> None:
    assert set(parts_changed(None, seen)) == set(PARTS)
    assert parts_changed(seen, seen) == {}
    beat = after(seen, _event("heartbeat", 100, time="later"))
    assert parts_changed(seen, beat) == {"heard_at": "later"}


@given(
    st.lists(
        st.sampled_from(["state", "result", "alert", "heartbeat", "progress", "contact", "point", "log"]), max_size=30
    )
)
def test_a_tab_that_applies_every_change_shows_the_same_as_one_that_comes_last(topics: list[str]) -> None:
    station = _whole(next_seq=0)
    tab = parts_changed(None, station)
    for n, topic in enumerate(topics):
        now = after(station, _event(topic, n))
        tab |= parts_changed(station, now)
        station = now
    assert tab == parts_changed(None, station)
