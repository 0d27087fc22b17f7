"""`reset` while others ask: nothing moves in a latched fault, no move is cut, and a doubt about an axis stays."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from daemon.client import Client
from tests.station.rig import EVENTUALLY_S, Rig, running_rig, until_status

RELAY = 5
"""The relay's address on the line."""
FAR: dict[str, Any] = {"board_um": [39_000.0, 29_000.0], "theta_deg": 60.0}
NEAR: dict[str, Any] = {"board_um": [15_000.0, 9_000.0], "theta_deg": 60.0}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A station that has been homed, no more."""
    with running_rig(tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture
def client(rig: Rig) -> Iterator[Client]:
    """A tester's connection to a homed station in idle."""
    with rig.client(timeout_s=60.0) as connected:
        if not connected.raw(b'{"op": "reset"}')["ok"]:
            assert connected.job("home").ok
        yield connected


@contextmanager
def _resetting(rig: Rig) -> Iterator[list[dict[str, Any]]]:
    """Send `reset` beside what is done inside; its reply is in the list at the end."""
    replies: list[dict[str, Any]] = []

    def reset() -> None:
        with rig.client(timeout_s=60.0) as other:
            replies.append(other.raw(b'{"op": "reset"}'))

    thread = threading.Thread(target=reset)
    thread.start()
    try:
        yield replies
    finally:
        thread.join(60.0)
        assert not thread.is_alive()


def _until_fault(client: Client, name: str) -> None:
    give_up_s = time.monotonic() + EVENTUALLY_S
    while (client.request("status")["fault"] or {}).get("name") != name:
        assert time.monotonic() < give_up_s, f"never came to {name}"
        time.sleep(0.02)


def test_a_job_sent_while_a_latched_fault_is_judged_is_refused_and_the_fault_stands(rig: Rig, client: Client) -> None:
    assert client.job("place", **NEAR).ok
    with rig.fault("cable_out"):
        _until_fault(client, "link_lost")
    before = rig.truth()["axes"]
    with rig.fault("absent_slave", address=RELAY), _resetting(rig) as replies:
        seen, refused = [], []
        while not replies:
            status = client.request("status")
            seen.append((status["state"], bool(status["fault"])))
            reply = client.raw(json.dumps({"op": "place", "id": f"meanwhile-{len(seen)}", **FAR}).encode())
            refused.append(reply.get("error", {}).get("name"))
            time.sleep(0.01)  # within the rate that one client may ask
    assert replies[0]["error"]["name"] == "light_failed"
    assert set(seen) == {("fault", True)}, "in fault it says why, also while reset works"
    assert set(refused) == {"in_fault"}
    assert rig.truth()["axes"] == before, "nothing moved"
    assert client.request("status")["fault"]["name"] == "light_failed"


@pytest.mark.parametrize("after_s", [0.0, 0.01, 0.03, 0.06, 0.1])
def test_a_job_sent_while_a_healthy_station_is_reset_runs_after_it_undisturbed(
    rig: Rig, client: Client, after_s: float
) -> None:
    assert client.job("place", **NEAR).ok
    with _resetting(rig) as replies:
        time.sleep(after_s)
        result = client.job("place", **FAR)
    status = client.request("status")
    assert result.ok, result.error
    assert (status["state"], status["fault"]) == ("idle", None)
    assert replies[0]["ok"] or replies[0]["error"]["name"] == "busy", replies[0]


def test_a_reference_that_is_in_doubt_stays_so_over_a_reset_that_fails_on_the_link(rig: Rig, client: Client) -> None:
    _hit_a_limit(rig, client, "hits")
    with rig.fault("cable_out"):
        assert client.raw(b'{"op": "reset"}')["error"]["name"] == "link_lost"
    reply = client.raw(b'{"op": "reset"}')
    assert not reply["ok"], "a station whose axis slipped is not idle"
    assert reply["error"]["name"] == "not_homed"
    assert client.job("home").ok


def test_a_doubt_outlives_a_killed_daemon(rig: Rig, client: Client) -> None:
    _hit_a_limit(rig, client, "killed")
    with rig.fault("cable_out"):
        rig.daemon.kill()
    rig.start_daemon(until_status(lambda status: status["lifecycle"] == "ready"))
    assert client.request("status", timeout_s=60.0)["state"] == "fault"
    assert client.raw(b'{"op": "reset"}')["error"]["name"] == "not_homed"


def _hit_a_limit(rig: Rig, client: Client, job_id: str) -> None:
    """Let X run onto a switch that opens again at once: nothing but the daemon knows that it was there."""
    assert client.job("place", **NEAR).ok
    client.request("place", id=job_id, **FAR)
    rig.until(lambda truth: truth["moving"], "it never moved")
    with rig.fault("limit", axis="x", side="both"):
        result = client.job("place", job_id=job_id, **FAR)
    assert result.error is not None
    assert result.error.name == "limit_hit"
