"""What breaks on a line: each trouble is named, stops motion, and is left again once its cause is gone."""

from __future__ import annotations

import json
import sqlite3
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from daemon.client import Client, Refused
from tests.station.rig import EVENTUALLY_S, Rig


@pytest.fixture(autouse=True)
def ready(rig: Rig, client: Client) -> Iterator[None]:
    """Begin and leave each test in idle, homed."""
    yield
    _recover(client)


def _recover(client: Client) -> None:
    reply = client.raw(b'{"op": "reset"}', timeout_s=60.0)
    if not reply["ok"]:
        assert reply["error"]["name"] == "not_homed"
        assert client.job("home").ok
    assert client.request("status")["state"] == "idle"


def _wait_for_state(client: Client, state: str) -> None:
    give_up_s = time.monotonic() + EVENTUALLY_S
    while client.request("status")["state"] != state:
        assert time.monotonic() < give_up_s, f"never came to {state}"
        time.sleep(0.02)


def _error(client: Client, test_point: str = "TP4") -> str:
    result = client.job("correct", test_point=test_point)
    assert result.error is not None
    return result.error.name


@pytest.mark.parametrize(
    ("fault", "parameters", "name"),
    [
        ("silent", {}, "camera_failed"),
        ("black", {}, "camera_failed"),
        ("dead_lamp", {"lamp": "white"}, "frame_unusable"),
        ("dead_lamp", {"lamp": "red"}, "frame_unusable"),
        ("relay_stuck", {}, "frame_unusable"),
        ("missing", {}, "tip_not_found"),
    ],
)
def test_seeing_trouble_is_named_and_nothing_moves(
    rig: Rig, client: Client, fault: str, parameters: dict[str, str], name: str
) -> None:
    client.job("place", test_point="TP4", theta_deg=10.0)
    before = rig.truth()["axes"]
    with rig.fault(fault, **parameters):
        assert _error(client) == name
    assert rig.truth()["axes"] == before


def test_a_lamp_that_stays_on_after_a_job_is_a_fault_until_it_is_dark(rig: Rig, client: Client) -> None:
    client.job("place", test_point="TP4", theta_deg=10.0)
    client.request("look", id=f"stuck-{time.monotonic_ns()}")
    rig.until(lambda _truth: _lit(rig), "no lamp was ever switched on")
    with rig.fault("relay_stuck"):
        _wait_for_state(client, "fault")
        assert client.request("status")["fault"]["name"] == "light_failed"
        refused = client.raw(b'{"op": "reset"}', timeout_s=60.0)
        assert refused["error"]["name"] == "light_failed", "its coils say that it is dark"
        assert client.request("status")["fault"]["name"] == "light_failed"
    assert client.raw(b'{"op": "reset"}', timeout_s=60.0)["ok"]
    assert client.job("correct", test_point="TP4").ok


def _lit(rig: Rig) -> bool:
    """Whether the last thing a lamp was told is to be on, by the truth log."""
    on: dict[str, bool] = {}
    for line in (rig.places.out / "truth.jsonl").read_text().splitlines():
        said = json.loads(line)
        if said["event"] == "light":
            on[said["lamp"]] = said["on"]
    return any(on.values())


@pytest.mark.parametrize("fault", ["silent", "black"])
def test_a_reset_after_the_camera_was_away_leaves_it_working(rig: Rig, client: Client, fault: str) -> None:
    client.job("place", test_point="TP4", theta_deg=10.0)
    with rig.fault(fault):
        assert _error(client) == "camera_failed"
    client.request("reset", timeout_s=60.0)
    for _ in range(3):
        assert client.job("correct", test_point="TP4").ok


def test_a_recognition_fault_clears_itself(rig: Rig, client: Client) -> None:
    client.job("place", test_point="TP4", theta_deg=10.0)
    with rig.fault("dead_lamp", lamp="white"):
        failed = client.job("correct", test_point="TP4")
    assert not failed.ok
    with sqlite3.connect(rig.places.out / "station" / "journal.sqlite") as db:
        kinds = db.execute("SELECT kind FROM steps WHERE job=?", (failed.id,)).fetchall()
    db.close()
    assert kinds == [("look",)], "a look that failed is written down too"
    assert client.request("status")["state"] == "idle"
    assert client.job("correct", test_point="TP4").ok


def test_a_hardware_fault_is_kept_with_its_first_cause(rig: Rig, client: Client) -> None:
    client.job("place", test_point="TP4", theta_deg=10.0)
    with rig.fault("cable_out"):
        assert _error(client) == "link_lost"
        status = client.request("status")
        assert (status["state"], status["fault"]["name"]) == ("fault", "link_lost")
        with pytest.raises(Refused) as refused:
            client.job("correct", test_point="TP4")
        assert refused.value.error["name"] == "in_fault"
        assert refused.value.error["detail"]["first_cause"]["name"] == "link_lost"
        with pytest.raises(Refused):
            client.request("reset", timeout_s=60.0)
    client.request("reset", timeout_s=60.0)
    assert client.job("correct", test_point="TP4").ok


def test_a_cable_pulled_while_idle_is_noticed(rig: Rig, client: Client) -> None:
    with rig.fault("cable_out"):
        _wait_for_state(client, "fault")
        assert client.request("status")["fault"]["name"] == "link_lost"


def test_an_emergency_stop_is_noticed_and_needs_homing(rig: Rig, client: Client) -> None:
    with rig.fault("estop"):
        _wait_for_state(client, "fault")
        assert not client.raw(b'{"op": "reset"}', timeout_s=60.0)["ok"], "not while it is pressed"
    reply = client.raw(b'{"op": "reset"}', timeout_s=60.0)
    assert reply["error"]["name"] == "not_homed", "the axes may have slipped"
    assert client.job("home").ok
    assert client.job("place", test_point="TP4").ok


def test_a_stalled_axis_needs_homing(rig: Rig, client: Client) -> None:
    client.job("place", board_um=[0.0, 0.0])
    far: dict[str, Any] = {"board_um": [39_000.0, 29_000.0], "theta_deg": 90.0}
    client.request("place", id="stalls", **far)
    rig.until(lambda truth: truth["moving"], "it never moved")
    with rig.fault("stall", axis="all", detected=True):
        result = client.job("place", job_id="stalls", **far)
    assert result.error is not None
    assert result.error.name in ("axis_stalled", "motion_failed")
    assert client.request("status")["state"] == "fault"
    assert client.raw(b'{"op": "reset"}', timeout_s=60.0)["error"]["name"] == "not_homed"


def test_cancel_in_the_middle_of_a_move_stops_it(rig: Rig, client: Client) -> None:
    client.job("place", board_um=[0.0, 0.0])
    done: list[str] = []

    def travel() -> None:
        with rig.client() as other:
            result = other.job("place", job_id="far", board_um=[39_000.0, 29_000.0], theta_deg=90.0)
            done.append(result.error.name if result.error else result.outcome)

    thread = threading.Thread(target=travel)
    thread.start()
    rig.until(lambda truth: truth["moving"], "it never moved")
    client.request("cancel", id="far")
    thread.join(EVENTUALLY_S)
    assert done == ["cancelled"]
    assert client.request("status")["state"] == "idle"
    assert rig.truth()["moving"] is False
    assert client.job("place", test_point="TP4").ok, "the next job goes on from where it stopped"


def test_a_job_that_runs_out_of_time_stops(rig: Rig, client: Client) -> None:
    client.job("place", board_um=[0.0, 0.0])
    # On a loaded computer a short deadline may pass before the job's turn comes: then it is given more.
    for deadline_ms in (400.0, 700.0, 1000.0):
        result = client.job("place", board_um=[39_000.0, 29_000.0], theta_deg=90.0, deadline_ms=deadline_ms)
        assert result.error is not None
        if result.error.name != "stale_deadline":
            break
    assert result.error.name == "deadline_missed"
    assert rig.truth()["moving"] is False


def test_jobs_wait_their_turn_and_the_queue_has_an_end(rig: Rig, client: Client) -> None:
    client.job("place", test_point="TP4", theta_deg=10.0)
    ids = [f"queue-{n}" for n in range(25)]
    replies = {job_id: client.raw(json.dumps({"op": "look", "id": job_id}).encode()) for job_id in ids}
    refused = {job_id: reply["error"]["name"] for job_id, reply in replies.items() if not reply["ok"]}
    assert set(refused.values()) == {"busy"}
    assert len(refused) < 25
    for job_id in ids:
        if job_id not in refused:
            assert client.job("look", job_id=job_id).ok
