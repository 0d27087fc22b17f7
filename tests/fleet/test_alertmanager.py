"""Routes of Alertmanager: who is told of what, and what a station that is gone silences. Judged by its own programs."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fleet.engines import end, free_port, wait_for_port
from tests.packages import not_installed

SHIPPED = Path(__file__).parents[2] / "systemd"
ROUTES, RULES = SHIPPED / "alertmanager.yml", SHIPPED / "prometheus-rules.yml"
MANAGER = shutil.which("prometheus-alertmanager") or shutil.which("alertmanager")
pytestmark = pytest.mark.skipif(
    MANAGER is None or shutil.which("amtool") is None, reason=not_installed("prometheus-alertmanager")
)
TOLD = {
    "StationGone": "on-call",
    "StationAlert": "maintenance",
    "StationStandsApart": "maintenance",
    "StationMissesApart": "maintenance",
    "CalibrationOld": "maintenance",
    "MixedVersions": "maintenance",
    "PadMissesEverywhere": "test-engineering",
    "RecordsLost": "centre",
    "RecordsRefused": "centre",
    "CollectorGone": "centre",
}


def _amtool(*words: str) -> str:
    done = subprocess.run(["amtool", *words], capture_output=True, text=True, check=False)  # noqa: S607
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def _alerts() -> dict[str, str]:
    """Return the alerts of the shipped rules with their severity."""
    found = re.findall(r"- alert: (\w+)\n.*?severity: (\w+)", RULES.read_text(), re.DOTALL)
    return dict(found)


def test_the_shipped_configuration_is_one() -> None:
    assert "SUCCESS" in _amtool("check-config", str(ROUTES))


def test_each_alert_of_the_rules_goes_to_who_can_do_something() -> None:
    alerts = _alerts()
    assert alerts.keys() == TOLD.keys()
    for alert, severity in alerts.items():
        labels = (f"alertname={alert}", f"severity={severity}", "station=a")
        said = _amtool("config", "routes", "test", f"--config.file={ROUTES}", *labels)
        assert said.strip() == TOLD[alert], alert


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[str]:
    """An Alertmanager with the shipped routes; it sends nothing within a test, for it waits a minute for more."""
    port, log = free_port(), tmp_path / "log"
    assert MANAGER is not None
    words = [f"--config.file={ROUTES}", f"--storage.path={tmp_path}", f"--web.listen-address=127.0.0.1:{port}"]
    with log.open("ab") as out:
        process = subprocess.Popen([MANAGER, *words, "--cluster.listen-address="], stdout=out, stderr=out)
    try:
        wait_for_port(port, process, log)
        yield f"http://127.0.0.1:{port}"
    finally:
        end(process)


@pytest.mark.timeout(60)
def test_what_else_ails_a_station_that_is_gone_is_told_to_nobody(manager: str) -> None:
    _tell(manager, ("StationGone", "a"), ("StationAlert", "a"), ("StationAlert", "b"))
    expected = {("StationGone", "a"): False, ("StationAlert", "a"): True, ("StationAlert", "b"): False}
    while _quiet(manager, "inhibitedBy") != expected:  # the test's own timeout ends it
        time.sleep(0.1)


@pytest.mark.timeout(60)
def test_an_alert_that_a_person_silences_by_name_and_note_is_quiet_for_that_station_alone(manager: str) -> None:
    _tell(manager, ("StationAlert", "a"), ("StationAlert", "b"), ("StationMissesApart", "a"))
    which = ("alertname=StationAlert", "station=a")
    note = ("--author=M. Weber", "--comment=needle is ordered", "--duration=2h")
    _amtool("silence", "add", f"--alertmanager.url={manager}", *note, *which)
    expected = {("StationAlert", "a"): True, ("StationAlert", "b"): False, ("StationMissesApart", "a"): False}
    while _quiet(manager, "silencedBy") != expected:  # the test's own timeout ends it
        time.sleep(0.1)
    said = _amtool("silence", "query", f"--alertmanager.url={manager}", "--output=json")
    assert [(one["createdBy"], one["comment"]) for one in json.loads(said)] == [("M. Weber", "needle is ordered")]


def _tell(manager: str, *alerts: tuple[str, str]) -> None:
    body = [{"labels": {"alertname": name, "station": station}} for name, station in alerts]
    request = urllib.request.Request(  # noqa: S310  # loopback
        f"{manager}/api/v2/alerts", json.dumps(body).encode(), {"Content-Type": "application/json"}
    )
    urllib.request.urlopen(request).close()  # noqa: S310  # loopback


def _quiet(manager: str, why: str) -> dict[tuple[str, str], bool]:
    with urllib.request.urlopen(f"{manager}/api/v2/alerts") as answer:  # noqa: S310  # loopback
        found = json.load(answer)
    return {(one["labels"]["alertname"], one["labels"]["station"]): bool(one["status"][why]) for one in found}
