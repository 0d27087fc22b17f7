"""The examination names what is wrong with a computer, a configuration and a port, and what to do."""

from __future__ import annotations

import fcntl
import json
import os
import pty
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.config.model import load_config
from daemon.tools.demo.settings import Places, write_settings
from daemon.tools.doctor import computer
from daemon.tools.doctor.computer import examine_data_dir, examine_device, examine_time
from daemon.tools.doctor.findings import CheckResult, CheckResults
from tests.daemon.tools.report.synthetic import backlash_record

pytestmark = pytest.mark.usefixtures("logging_as_before")


@pytest.fixture
def port() -> Iterator[Path]:
    """A serial port that nobody uses."""
    master, slave = pty.openpty()
    yield Path(os.ttyname(slave))
    os.close(master)
    os.close(slave)


def _only(findings: CheckResults) -> CheckResult:
    (check,) = findings.checks
    return check


def test_a_free_port_is_ok_and_one_in_use_names_who_has_it(port: Path) -> None:
    free = CheckResults()
    examine_device(free, "port", port, "dialout")
    assert _only(free).verdict == "ok"
    with port.open("rb", buffering=0) as holder:
        fcntl.flock(holder, fcntl.LOCK_EX)
        taken = CheckResults()
        examine_device(taken, "port", port, "dialout")
    assert _only(taken).verdict == "fail"
    assert "in use" in _only(taken).found


@pytest.mark.parametrize(("name", "says"), [("missing", "not there"), ("file", "no device")])
def test_a_port_that_is_none_is_named(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / "file").write_text("")
    findings = CheckResults()
    examine_device(findings, "port", tmp_path / name, "dialout")
    assert says in _only(findings).found
    assert _only(findings).advice


def test_a_port_one_may_not_use_says_which_group(port: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(computer.os, "access", lambda *_: False)
    findings = CheckResults()
    examine_device(findings, "port", port, "dialout")
    assert not findings.good
    assert "group" in _only(findings).advice


def test_a_full_disk_and_an_open_folder_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = load_config(write_settings(Places(tmp_path, tmp_path)))
    config.station.data_dir.mkdir()
    config.station.data_dir.chmod(0o777)
    usage = computer.shutil.disk_usage(tmp_path)._replace(free=50_000_000)
    monkeypatch.setattr(computer.shutil, "disk_usage", lambda _path: usage)
    findings = CheckResults()
    examine_data_dir(findings, config)
    assert {check.about: check.verdict for check in findings.checks} == {"data folder": "warn", "disk": "fail"}


def test_a_clock_before_the_last_calibration_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = load_config(write_settings(Places(tmp_path, tmp_path)))
    record = backlash_record(station=config.station.name, probe="", made_at="2999-01-01T00:00:00+00:00")
    (config.station.data_dir / "calibration").mkdir(parents=True)
    (config.station.data_dir / "calibration" / "backlash.json").write_text(record.model_dump_json())
    monkeypatch.setattr(computer, "clock_synchronized", lambda: False)
    findings = CheckResults()
    examine_time(findings, config)
    verdicts = {check.about: check.verdict for check in findings.checks}
    assert verdicts["date and time"] == "fail"
    assert "2999" in next(check.advice for check in findings.checks if check.about == "date and time")
    assert verdicts["time from the network"] == "warn"


def test_a_bad_configuration_is_all_that_is_told(tmp_path: Path) -> None:
    station = write_settings(Places(tmp_path, tmp_path))
    station.write_text(station.read_text().replace("address = 1\n", "address = 900\n"))
    done = CliRunner().invoke(app, ["doctor", "--config", str(station), "--json"])
    assert done.exit_code == 1
    told = json.loads(done.stdout)
    assert [(check["about"], check["verdict"]) for check in told["checks"]] == [
        ("configuration axes.x.address", "fail")
    ]
