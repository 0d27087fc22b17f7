"""A full disk: no start fails, no job ends twice, and work goes on by itself when there is room."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daemon.client import Client, Refused, Subscription
from tests.daemon.storage.small_disk import fill, make_room, small_disk
from tests.station.rig import EVENTUALLY_S, Rig, answering, running_rig

FAR: dict[str, Any] = {"board_um": [39_000.0, 29_000.0], "theta_deg": 90.0}


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    """A station whose data folder is a small disk, homed."""
    (tmp_path / "out").mkdir()
    with small_disk(tmp_path / "out" / "station"), running_rig(tmp_path / "out", pictures="none") as running:
        with running.client() as client:
            assert client.job("home").ok
        yield running


def _wait_for(client: Client, state: str, fault: str | None) -> None:
    give_up_s = time.monotonic() + EVENTUALLY_S
    while True:
        status = client.request("status")
        named = status["fault"]["name"] if status["fault"] else None
        if (status["state"], named) == (state, fault):
            return
        assert time.monotonic() < give_up_s, status
        time.sleep(0.02)


def _fill_during_a_job(rig: Rig, client: Client, job_id: str) -> None:
    """Let a job begin, fill the disk, and see that a client who waits is told that there is no result yet."""
    client.request("place", id=job_id, **FAR)
    rig.until(lambda truth: truth["moving"], "it never moved")
    fill(rig.places.out / "station")
    with pytest.raises(Refused) as unwritten:
        client.job("place", job_id=job_id, **FAR)
    assert unwritten.value.error["name"] == "journal_failed"
    _wait_for(client, "fault", "journal_failed")


def _results(events: Subscription, until: str) -> list[tuple[str, str]]:
    """Return the results published so far, up to the one of a job; numbers have to rise by one."""
    found: list[tuple[str, str]] = []
    last = None
    while not found or found[-1][0] != until:
        event = events.next(EVENTUALLY_S)
        assert event is not None, found
        assert last is None or event["seq"] == last + 1
        last = event["seq"]
        if event["topic"] == "result":
            found.append((event["id"], event["outcome"]))
    return found


def test_a_job_that_ends_on_a_full_disk_has_its_result_when_there_is_room(rig: Rig) -> None:
    with rig.client() as client, Subscription(rig.events) as events:
        _fill_during_a_job(rig, client, "held")
        assert client.request("alerts")["standing"][0]["name"] == "journal_not_written"
        assert client.request("result", id="held")["done"] is False
        make_room(rig.places.out / "station")
        _wait_for(client, "idle", None)
        assert client.job("place", job_id="held", **FAR).outcome == "placed"
        assert client.job("place", job_id="after", board_um=[0.0, 0.0]).ok
        assert _results(events, "after") == [("held", "placed"), ("after", "placed")]
        assert client.request("alerts")["standing"] == []


def test_a_daemon_killed_on_a_full_disk_starts_in_fault_and_the_job_has_one_result(rig: Rig) -> None:
    with rig.client() as client:
        _fill_during_a_job(rig, client, "cut")
        seq = client.request("snapshot")["next_seq"]
        os.kill(rig.daemon.pid, signal.SIGKILL)
        rig.daemon.end()
        rig.start_daemon(answering)
        with Subscription(rig.events) as events:
            assert events.next(EVENTUALLY_S) is not None
            _wait_for(client, "fault", "journal_failed")
            with pytest.raises(Refused) as refused:
                client.request("home", id="early")
            assert refused.value.error["name"] in ("journal_failed", "in_fault")
            make_room(rig.places.out / "station")
            _wait_for(client, "idle", None)
            cut = client.request("result", id="cut")["result"]
            assert cut["error"]["name"] == "interrupted"
            assert cut["seq"] > seq
            assert client.job("place", job_id="after", board_um=[0.0, 0.0]).ok
            assert _results(events, "after") == [("cut", "failed"), ("after", "placed")]
