"""What a station lets be seen: metrics, the live view, journal, bundle and doctor, beside a running daemon."""

from __future__ import annotations

import json
import re
import socket
import tarfile
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest
from typer.testing import CliRunner, Result

from daemon.cli.app import app
from daemon.cli.watch import follow
from daemon.cli.watch_view import WatchView
from tests.station.rig import EVENTUALLY_S, Rig, running_rig

pytestmark = pytest.mark.usefixtures("logging_as_before")


@pytest.fixture(scope="module")
def homed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Rig, int]]:
    """A station that serves its metrics, homed and with one failed job; and the port of the metrics."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    metrics = f"\n[metrics]\nport = {port}\n"
    with running_rig(tmp_path_factory.mktemp("seen"), pictures="failed", more_settings=metrics) as rig:
        with rig.client() as client:
            assert client.job("home").ok
            assert client.job("place", job_id="there", test_point="TP1", theta_deg=0.0).ok
            assert not client.job("correct", job_id="untaught", test_point="TP1").ok
        yield rig, port


def _run(rig: Rig, *arguments: str) -> Result:
    return CliRunner().invoke(app, [*arguments, "--config", str(rig.places.out / "station.toml")])


def _scrape(port: int) -> str:
    with urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
        text: str = answer.read().decode()
    return text


def _value(text: str, sample: str) -> float:
    found = re.search(rf"^{re.escape(sample)} (\S+)$", text, re.MULTILINE)
    assert found, f"no {sample}"
    return float(found[1])


def test_a_scrape_shows_what_the_station_did_and_how_it_is(homed: tuple[Rig, int]) -> None:
    rig, port = homed
    with rig.client() as client:
        before = _value(_scrape(port), "reprobe_touches_total")
        client.request("report", touches=20, retest="open", id="there")
    text = _scrape(port)
    assert _value(text, "reprobe_touches_total") == before + 20
    assert _value(text, 'reprobe_jobs_total{op="place",outcome="placed"}') >= 1
    assert _value(text, 'reprobe_job_errors_total{error="not_calibrated",op="correct"}') == 1
    assert _value(text, 'reprobe_job_spent_seconds_sum{op="home",state="move",wait="motion"}') > 0
    assert _value(text, 'reprobe_state{state="idle"}') == 1
    assert _value(text, 'reprobe_bus_requests_total{bus="main"}') > 100
    assert _value(text, "reprobe_camera_grabbed_total") > 0
    assert _value(text, "reprobe_journal_bytes") > 0
    assert _value(text, "reprobe_event_loop_lag_seconds_count") > 0
    assert _value(text, "process_open_fds") > 0


def test_the_view_follows_over_a_restart_and_shows_the_results(homed: tuple[Rig, int]) -> None:
    rig, _ = homed
    view = WatchView()
    give_up_s = time.monotonic() + 3 * EVENTUALLY_S
    restarted = False

    class Enough(Exception):
        pass

    def shown() -> None:
        nonlocal restarted
        assert time.monotonic() < give_up_s, view
        if view.state == "idle" and not restarted:
            restarted = True
            assert rig.daemon.end() == 0
            rig.start_daemon()
            with rig.client() as client:
                client.job("place", job_id="after-restart", test_point="TP2", theta_deg=0.0)
        if restarted and any(result.id == "after-restart" for result in view.results):
            raise Enough

    with pytest.raises(Enough):
        follow(rig.control, view, shown)
    assert view.links["buses"]["main"]["connected"] == 1


def test_piped_watch_prints_lines(homed: tuple[Rig, int]) -> None:
    rig, _ = homed
    done = CliRunner().invoke(
        app, ["watch", "--endpoint", rig.control, "--topic", "heartbeat", "--count", "2", "--json"]
    )
    assert [json.loads(line)["topic"] for line in done.stdout.splitlines()] == ["heartbeat", "heartbeat"]


def test_the_journal_is_listed_shown_and_exported_while_the_daemon_runs(homed: tuple[Rig, int], tmp_path: Path) -> None:
    rig, _ = homed
    listed = [json.loads(line) for line in _run(rig, "journal", "list", "--json").stdout.splitlines()]
    assert {"there", "untaught"} <= {row["id"] for row in listed}
    failed = _run(rig, "journal", "list", "--failed", "--since", "1h", "--json").stdout.splitlines()
    assert [json.loads(line)["error_name"] for line in failed] == ["not_calibrated"]
    page = tmp_path / "page.html"
    shown = _run(rig, "journal", "show", "there", "--open-page", str(page))
    assert "placed" in shown.output
    assert "there" in page.read_text()
    table, whole = tmp_path / "jobs.csv", tmp_path / "jobs.jsonl"
    assert _run(rig, "journal", "export", "--csv", str(table), "--jsonl", str(whole)).exit_code == 0
    assert "untaught,correct" in table.read_text()
    assert [json.loads(line)["id"] for line in whole.read_text().splitlines()][1] == "there"
    assert _run(rig, "journal", "show", "nobody").exit_code == 1


def test_a_bundle_of_a_running_station_has_its_metrics_and_its_answer(homed: tuple[Rig, int], tmp_path: Path) -> None:
    rig, _ = homed
    assert _run(rig, "bundle", "-o", str(tmp_path / "b.tar.gz")).exit_code == 0
    with tarfile.open(tmp_path / "b.tar.gz") as parts:
        names = {name.removeprefix("reprobe-bundle/") for name in parts.getnames()}
    assert {"metrics.txt", "snapshot.json", "journal.jsonl", "config.json", "manifest.json"} <= names


def test_every_line_of_a_job_in_the_log_names_it(homed: tuple[Rig, int]) -> None:
    rig, _ = homed
    lines = [json.loads(line) for line in (rig.places.out / "daemon.log").read_text().splitlines()]
    begun = [n for n, line in enumerate(lines) if "idle --trigger" in line.get("change", "")]
    over = [n for n, line in enumerate(lines) if line["event"] == "job_done"]
    assert begun
    for first, last in zip(begun, over, strict=True):
        assert {(line["job"], line["op"]) for line in lines[first : last + 1]} == {
            (lines[last]["job"], lines[last]["op"])
        }


def test_the_doctor_asks_a_running_daemon_and_examines_the_devices_without_one(homed: tuple[Rig, int]) -> None:
    """The last test of the module: it ends the daemon."""
    rig, _ = homed
    asked = json.loads(_run(rig, "doctor", "--json").stdout)
    verdicts = {check["about"]: check["verdict"] for check in asked["checks"]}
    assert asked["ok"]
    assert (verdicts["running daemon"], verdicts["devices"]) == ("ok", "warn")
    rig.daemon.end()
    before = rig.truth()["axes"]
    with rig.fault("dead_lamp", lamp="red"):
        done = _run(rig, "doctor", "--json")
    told = {check["about"]: check for check in json.loads(done.stdout)["checks"]}
    assert done.exit_code == 1
    assert [check["about"] for check in told.values() if check["verdict"] == "fail"] == ["red lamp"], told
    assert "wire" in told["red lamp"]["advice"]
    for about in ("bus main", "axis theta", "axis x mapping", "camera frame rate", "white lamp", "exposure lock"):
        assert told[about]["verdict"] == "ok", told[about]
    assert "firmware" in told["axis x"]["found"]
    assert rig.truth()["axes"] == before, "nothing moved"
