"""Maintenance on the whole station: a bent needle, a lens out of focus, a noisy line are told, and kept."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daemon.client import Client, Refused, Subscription
from tests.station.rig import EVENTUALLY_S, Rig, running_rig

WINDOWS = '\n[maintenance]\nbaseline = 10\nbatch = 2\ncheck_s = 1.0\noff = ["frames_missed"]\n'
"""A station learns from 60 numbers; a test has no time for that, and its computer none for every picture."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A station with short windows, set up."""
    with running_rig(tmp_path_factory.mktemp("rig"), pictures="none", reply_ms=500.0) as running:
        assert running.daemon.end() == 0
        settings = running.places.out / "station.toml"
        settings.write_text(settings.read_text() + WINDOWS)
        running.start_daemon()
        with running.client() as client:
            running.session(client).set_up()
            _correct(client, 8)
        yield running


def _correct(client: Client, times: int) -> None:
    """Touch one point from another place each time and report it."""
    for k in range(times):
        assert client.job("place", test_point="TP4", theta_deg=10.0 + k).ok
        result = client.job("correct", test_point="TP4")
        client.request("report", id=result.id, retest="pass", touches=20)


def _standing(client: Client) -> dict[str, dict[str, Any]]:
    reply = client.request("alerts", since=2**60)
    return {alert["name"]: alert for alert in reply["standing"]}


def _until_standing(client: Client, name: str, *, stands: bool = True) -> dict[str, Any]:
    give_up_s = time.monotonic() + EVENTUALLY_S
    while (name in (standing := _standing(client))) != stands:
        assert time.monotonic() < give_up_s, f"{name}: {sorted(standing)}"
        time.sleep(0.05)
    return standing.get(name, {})


def _health(rig: Rig, *more: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "daemon.cli", "health", "--endpoint", rig.control, *more]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_a_healthy_station_is_healthy_and_its_watches_have_numbers(rig: Rig, client: Client) -> None:
    reply = client.request("alerts")
    assert reply["healthy"], reply["standing"]
    watches = {watch["name"]: watch for watch in reply["watches"]}
    learned = [name for name in ("light_white", "light_red", "focus", "tip_bend") if watches[name]["learned"] < 0.5]
    assert not learned, "every correction is measured"
    assert watches["light_white"]["unit"] == "levels"
    assert "frames_missed" not in watches
    shown = _health(rig)
    assert shown.returncode == 0, shown.stderr
    assert "healthy" in shown.stdout
    assert json.loads(_health(rig, "--json").stdout)["healthy"] is True


def test_a_needle_that_is_refused_is_an_alert_that_can_be_acknowledged(rig: Rig, client: Client) -> None:
    describe = client.request("describe")
    with rig.fault("bent", px=4.0), Subscription(describe["events"], ("alert",)) as heard:
        for _ in range(6):
            client.job("correct", test_point="TP4")
        alert = _until_standing(client, "tip_refused")
        assert alert["severity"] in ("warning", "serious")
        assert "calibrate tip" in alert["advice"]
        told = []
        while not told or told[-1]["name"] != "tip_refused":
            event = heard.next(EVENTUALLY_S)
            assert event is not None, told
            told.append(event)
        assert [(one["name"], one["raised"], one["change"]) for one in told] == [
            ("repeated_failures", True, "raised"),
            ("tip_refused", True, "raised"),
        ]
        shown = _health(rig)
        assert shown.returncode == 1
        assert "tip_refused" in shown.stdout
        known = client.request("acknowledge", alert="tip_refused", by="Kim", note="needle ordered")
        assert known["alert"]["acknowledged"]["by"] == "Kim"
        assert _standing(client)["tip_refused"]["acknowledged"]["note"] == "needle ordered"
    client.request("acknowledge", alert="tip_refused", by="Kim", note="changed", mended=True)
    assert "tip_refused" not in _standing(client)
    with pytest.raises(Refused, match="unknown_alert"):
        client.request("acknowledge", alert="tip_refused", by="Kim")


def test_a_noisy_line_is_told_before_it_stops_the_station(rig: Rig, client: Client) -> None:
    with rig.fault("crc_noise", rate=0.03):
        give_up_s = time.monotonic() + 3 * EVENTUALLY_S
        while not (found := sorted({"bus_garbled_main", "bus_timeouts_main"} & set(standing := _standing(client)))):
            assert time.monotonic() < give_up_s, sorted(standing)
            if client.job("correct", test_point="TP4").error is not None:  # three bad answers in a row are rare
                client.raw(b'{"op": "reset"}', timeout_s=60.0)
        alert = standing[found[0]]  # a garbled request is not answered, a garbled answer is
    assert "replace the cable" in alert["advice"]
    assert alert["figure"] > 0.002
    for name in {"bus_garbled_main", "bus_timeouts_main"} & set(_standing(client)):
        client.request("acknowledge", alert=name, by="Kim", mended=True)


def test_a_lens_out_of_focus_is_told_by_the_needle_s_own_rim_and_kept_over_a_restart(rig: Rig, client: Client) -> None:
    rig.bench.ask("set", name="camera_blur_px", value=1.9)
    try:
        _correct(client, 10)
        alert = _until_standing(client, "focus")
    finally:
        rig.bench.ask("set", name="camera_blur_px", value=1.0)
    assert alert["figure"] < alert["usual"]
    assert rig.daemon.end() == 0
    rig.start_daemon()
    with rig.client() as again:
        assert _standing(again)["focus"]["raised_at"] == alert["raised_at"], "raised once"
        raised = [event for event in again.request("alerts")["alerts"] if event["name"] == "focus"]
        assert [event["change"] for event in raised if event["change"] == "raised"] == ["raised"]


def test_a_month_is_drawn_from_the_journal(rig: Rig, client: Client, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    now = client.request("status")
    assert now["ok"]
    command = [sys.executable, "-m", "daemon.cli", "report", "--config", str(rig.places.out / "station.toml"),
               "--month", time.strftime("%Y-%m", time.gmtime()), "-o", str(page)]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stderr
    text = page.read_text()
    assert "tip_refused" in text
    assert "<svg" in text
    assert "needle ordered" in text


def test_an_unreadable_journal_is_moved_aside_told_and_the_daemon_goes_on(rig: Rig, client: Client) -> None:
    data = rig.places.out / "station"
    assert rig.daemon.end() == 0
    (data / "journal.sqlite").write_bytes(b"\x13" * 50_000)
    rig.start_daemon()
    with rig.client() as again:
        alert = _until_standing(again, "journal_moved_aside")
        assert "journal-corrupt-" in alert["message"]
        assert list(data.glob("journal-corrupt-*.sqlite"))
        assert again.job("place", test_point="TP4").ok
        again.request("acknowledge", alert="journal_moved_aside", by="Kim", note="kept")
        assert "journal_moved_aside" not in _standing(again)
        assert again.request("alerts")["alerts"][-1]["change"] == "cleared"


def test_a_journal_of_a_newer_version_is_refused_and_says_so(rig: Rig) -> None:
    assert rig.daemon.end() == 0
    file = rig.places.out / "station" / "journal.sqlite"
    db = sqlite3.connect(file)
    version = db.execute("PRAGMA user_version").fetchone()[0]
    db.execute("PRAGMA user_version=99")
    db.close()
    command = [sys.executable, "-m", "daemon.cli", "run", "--config", str(rig.places.out / "station.toml")]
    refused = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert refused.returncode != 0
    assert "newer version" in refused.stderr
    assert "install the newer program" in refused.stderr
    db = sqlite3.connect(file)
    db.execute(f"PRAGMA user_version={version}")
    db.close()
    rig.start_daemon()
