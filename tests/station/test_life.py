"""The daemon's life: it starts in fault, outlives missing devices, stops clean, and tells what a kill interrupted."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.station.rig import FAST, Rig, in_fault, running_rig, started


@pytest.fixture
def fresh(tmp_path: Path) -> Iterator[Rig]:
    with running_rig(tmp_path) as rig:
        yield rig


def test_from_cold_to_kill_and_back(fresh: Rig) -> None:
    """One long story, for a station takes seconds to start."""
    with fresh.client() as client:
        status = client.request("status")
        assert (status["state"], status["fault"]["name"]) == ("fault", "not_homed")
        refused = client.raw(b'{"op": "place", "id": "early", "test_point": "TP1"}')
        assert refused["error"]["name"] == "in_fault"
        assert client.job("home").ok
        early = client.raw(b'{"op": "correct", "id": "untaught", "test_point": "TP1", "wait": true}')
        assert early["result"]["error"]["name"] == "not_calibrated"
        client.request("place", id="cut", board_um=[39_000.0, 29_000.0], theta_deg=90.0)
        fresh.until(lambda truth: truth["moving"], "it never moved")
        os.kill(fresh.daemon.pid, signal.SIGKILL)
        fresh.daemon.end()

    fresh.start_daemon(started)
    with fresh.client() as client:
        cut = client.request("result", id="cut")["result"]
        assert cut["error"]["name"] == "interrupted"
        again = client.job("place", job_id="cut", board_um=[39_000.0, 29_000.0], theta_deg=90.0)
        assert again.error is not None, "the same id is answered the same way, and moves nothing"
        assert fresh.truth()["moving"] is False
    assert fresh.daemon.end() == 0, fresh.daemon.last_words()
    fresh.until(lambda truth: max(truth["white"], truth["red"]) < 0.05, "the lamps went on glowing")


def test_what_the_drive_manual_leaves_open_is_found_at_start(tmp_path: Path) -> None:
    """Drives that take the other side of every open point are homed by the same configuration."""
    knobs = ("fc43_index_order=little", "fc43_node=0", "word_order=low", "fc43_write_num=zero")
    arguments = (*FAST, *(part for knob in knobs for part in ("--set", knob)))
    with running_rig(tmp_path, arguments=arguments) as rig, rig.client() as client:
        result = client.job("home")
        assert result.ok, result.error


@pytest.mark.parametrize(
    ("change", "name"),
    [(("/bus", "/no-such-port"), "link_lost"), (("/camera", "/no-such-camera"), "camera_failed")],
)
def test_a_missing_device_is_named_and_the_daemon_goes_on(tmp_path: Path, change: tuple[str, str], name: str) -> None:
    with running_rig(tmp_path) as rig:
        assert rig.daemon.end() == 0
        settings = tmp_path / "station.toml"
        good = settings.read_text()
        settings.write_text(good.replace(change[0] + '"', change[1] + '"'))
        rig.start_daemon(in_fault)
        with rig.client() as client:
            fault = client.request("status")["fault"]
            assert fault["name"] == name
            assert fault["advice"]
            assert client.request("describe")["ops"]
