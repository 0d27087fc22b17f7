"""What is laid out for the service manager: whole, twice the same as once, and nothing of anybody's overwritten."""

from __future__ import annotations

import configparser
import os
import re
import shutil
import stat
import subprocess
import tomllib
from pathlib import Path

import pytest

from daemon.config.model import load_config
from daemon.tools.install import INSTANCE_UNIT, KEY, KEY_LINK, InstallError, Placed, instance_unit, lay_out, shipped

UNIT = "usr/local/lib/systemd/system/reprobe.service"
FLEET = ("reprobe-uplink.service", "reprobe-collect.service")
PAGE_UNIT = "usr/local/lib/systemd/system/reprobe-page.service"
SIM_UNIT = "usr/local/lib/systemd/system/reprobe-sim.service"
ANALYZE = shutil.which("systemd-analyze")
EXPOSURE_TENTHS = 15
needs_analyze = pytest.mark.skipif(ANALYZE is None, reason="systemd-analyze is not installed (Debian: systemd)")


def _how(placed: list[Placed], root: Path) -> dict[str, str]:
    return {str(p.path.relative_to(root)): p.how for p in placed}


def _unit(path: Path) -> dict[str, list[str]]:
    """Return all values of each key of a unit, in their order."""
    values: dict[str, list[str]] = {}
    for line in path.read_text().replace("\\\n", " ").splitlines():
        key, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            values.setdefault(key, []).append(value)
    return values


def test_everything_is_laid_out_and_twice_is_once(tmp_path: Path) -> None:
    first = _how(lay_out(tmp_path), tmp_path)
    assert set(first.values()) == {"written"}
    assert set(first) >= {UNIT, "usr/local/lib/sysusers.d/reprobe.conf", "etc/udev/rules.d/70-reprobe.rules", KEY_LINK}
    assert stat.S_IMODE((tmp_path / UNIT).stat().st_mode) == 0o644
    assert stat.S_IMODE((tmp_path / "etc/reprobe/keys").stat().st_mode) == 0o700
    assert os.readlink(tmp_path / KEY_LINK) == KEY  # noqa: PTH115  # its target is not there
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    again = _how(lay_out(tmp_path), tmp_path)
    assert set(again.values()) <= {"as it was", "yours, left alone"}
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_what_a_person_edits_is_left_alone_and_our_files_are_brought_up_to_date(tmp_path: Path) -> None:
    lay_out(tmp_path, bench=True)
    theirs = ["etc/reprobe/station.toml", "etc/reprobe/board.json", "etc/udev/rules.d/70-reprobe.rules"]
    for name in theirs:
        (tmp_path / name).write_text("mine\n")
    (tmp_path / UNIT).write_text("old\n")
    (tmp_path / "etc/reprobe/keys").chmod(0o750)
    how = _how(lay_out(tmp_path, bench=True), tmp_path)
    assert {how[name] for name in theirs} == {"yours, left alone"}
    assert {(tmp_path / name).read_text() for name in theirs} == {"mine\n"}
    assert how[UNIT] == "brought up to date"
    assert "Type=notify" in (tmp_path / UNIT).read_text()
    assert stat.S_IMODE((tmp_path / "etc/reprobe/keys").stat().st_mode) == 0o750


def test_a_real_station_gets_no_configuration_that_would_move_it(tmp_path: Path) -> None:
    lay_out(tmp_path)
    assert not (tmp_path / "etc/reprobe/station.toml").exists()
    assert not (tmp_path / SIM_UNIT).exists()
    assert (tmp_path / "etc/reprobe/station.example.toml").is_file()


def test_a_bench_gets_one_that_reaches_its_simulated_station(tmp_path: Path) -> None:
    lay_out(tmp_path, bench=True)
    config = load_config(tmp_path / "etc/reprobe/station.toml")
    command = _unit(tmp_path / SIM_UNIT)["ExecStart"][0]
    assert f"--line {config.bus['main'].port} " in command
    assert f"--camera {config.camera.endpoint} " in command
    (board,) = re.findall(r"--board (\S+)", command)
    assert any((tmp_path / board.lstrip("/")).iterdir())
    assert config.station.data_dir == Path("/var/lib/reprobe")


def test_another_prefix_stands_in_every_command(tmp_path: Path) -> None:
    lay_out(tmp_path, Path("/srv/probe"), bench=True)
    for name in (UNIT, SIM_UNIT, PAGE_UNIT):
        assert "/opt/reprobe" not in (tmp_path / name).read_text()
        assert _unit(tmp_path / name)["ExecStart"][0].startswith("/srv/probe/bin/reprobe ")
    with pytest.raises(InstallError, match="absolute"):
        lay_out(tmp_path, Path("here"))


def test_a_place_that_cannot_be_written_is_said_and_nothing_is_raised_but_that(tmp_path: Path) -> None:
    (tmp_path / "etc").write_text("a file, not a folder")
    with pytest.raises(InstallError, match="etc"):
        lay_out(tmp_path)


def test_the_wheel_carries_what_is_laid_out(tmp_path: Path) -> None:
    settings = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())
    carried = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    assert carried == {"systemd": "daemon/units"}
    assert shipped().name == "systemd", "a checkout lays out its own"


def test_unit_rules_and_example_speak_of_the_same_devices() -> None:
    unit = _unit(shipped() / "reprobe.service")
    allowed = {value.split()[0] for value in unit["DeviceAllow"]}
    rules = (shipped() / "70-reprobe.rules").read_text()
    named = {f"/dev/reprobe-{name}" for name in re.findall(r'ENV\{REPROBE\}="(\w+)"', rules)}
    assert allowed == named == {f"/dev/reprobe-{name}" for name in ("bus", "relay", "camera", "meter")}
    example = load_config(shipped() / "station.example.toml")
    assert {example.bus["main"].port, example.camera.device} <= allowed
    assert example.station.data_dir == Path("/var/lib") / unit["StateDirectory"][0]


def test_the_unit_has_what_the_daemon_counts_on() -> None:
    unit = _unit(shipped() / "reprobe.service")
    assert unit["Type"] == ["notify"]
    assert float(unit["WatchdogSec"][0]) > 0
    assert unit["Restart"] == ["on-failure"]
    assert unit["RestartPreventExitStatus"] == ["2"], "what a wrong configuration exits with"
    assert unit["SystemCallErrorNumber"] == ["EPERM"], "or numpy is killed"
    assert "sched_setscheduler" in unit["SystemCallFilter"][-1], "or ZeroMQ aborts"
    assert "AF_NETLINK" in unit["RestrictAddressFamilies"][0], "or ZeroMQ aborts"
    assert unit["DevicePolicy"] == ["closed"]


def test_the_page_has_a_user_a_folder_and_a_budget_of_its_own_and_no_device() -> None:
    unit = _unit(shipped() / "reprobe-page.service")
    assert unit["User"] == ["reprobe-page"]
    assert "u reprobe-page " in (shipped() / "reprobe.sysusers.conf").read_text()
    assert unit["StateDirectory"] == ["reprobe-page"]
    assert unit["Wants"] == ["reprobe.service"]
    assert "Requires" not in unit, "a page that is down must stop no daemon"
    assert (unit["MemoryMax"], unit["CPUQuota"]) == (["200M"], ["50%"])
    assert "DeviceAllow" not in unit
    assert "sched_setscheduler" in unit["SystemCallFilter"][-1], "or ZeroMQ aborts"


@pytest.mark.parametrize("name", FLEET)
def test_what_serves_the_fleet_has_no_device_keeps_nothing_and_the_daemon_never_waits_for_it(name: str) -> None:
    unit = _unit(shipped() / name)
    assert unit["DynamicUser"] == ["yes"]
    assert not {"DeviceAllow", "StateDirectory", "Requires"} & set(unit)
    assert unit["RestartPreventExitStatus"] == ["2"]
    assert name not in (shipped() / "reprobe.service").read_text()


@needs_analyze
def test_systemd_finds_nothing_to_complain_about(tmp_path: Path) -> None:
    prefix = tmp_path / "opt"
    (prefix / "bin").mkdir(parents=True)
    (prefix / "bin" / "reprobe").symlink_to("/bin/true")
    lay_out(tmp_path, prefix, bench=True)
    for name in (UNIT, SIM_UNIT, INSTANCE_UNIT.replace("@", "@left")):
        if not (tmp_path / name).exists():
            (tmp_path / name).symlink_to(tmp_path / INSTANCE_UNIT)
        done = subprocess.run(
            [str(ANALYZE), "verify", str(tmp_path / name)], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")


@needs_analyze
@pytest.mark.parametrize("unit", ["reprobe.service", "reprobe-page.service", *FLEET])
def test_the_unit_is_exposed_no_more_than_it_must(unit: str) -> None:
    ask = [str(ANALYZE), "security", "--offline=true", f"--threshold={EXPOSURE_TENTHS}"]
    done = subprocess.run([*ask, str(shipped() / unit)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_no_unit_names_a_key_twice_that_counts_once() -> None:
    """A second value would silently win."""
    several = {"DeviceAllow", "LoadCredential", "SystemCallFilter", "Environment"}
    for name in ("reprobe.service", "reprobe-page.service", "reprobe-sim.service", *FLEET):
        doubled = {key for key, values in _unit(shipped() / name).items() if len(values) > 1} - several
        assert not doubled
        parser = configparser.ConfigParser(strict=False, interpolation=None)
        parser.read_string((shipped() / name).read_text())
        assert parser.sections() == ["Unit", "Service", "Install"]


def test_stations_on_one_computer_share_no_file_folder_device_nor_key(tmp_path: Path) -> None:
    """What the unit of one station names as its own is another's in no place."""
    own = r"/etc/reprobe/[^\s']+|/dev/reprobe\S+|/var/\S+reprobe\S*|\S*server\.key|(?<=Directory=)reprobe\S*"
    alone, several = (
        (shipped() / "reprobe.service").read_text(),
        instance_unit((shipped() / "reprobe.service").read_text()),
    )
    places, instances = re.findall(own, alone), re.findall(own, several)
    assert len(places) == len(instances) > 10
    assert all("%i" in place for place in instances)
    lay_out(tmp_path, instance="left")
    lay_out(tmp_path, instance="right")
    example = tmp_path / "etc/reprobe/{}/station.example.toml"
    left, right = (load_config(Path(str(example).format(name))) for name in ("left", "right"))
    assert left.station.data_dir == Path("/var/lib/reprobe-left")
    assert left.bus["main"].port == "/dev/reprobe-left-bus"
    for one, other in (
        (left.station, right.station),
        (left.bus["main"], right.bus["main"]),
        (left.camera, right.camera),
    ):
        assert one != other
    assert {left.api.control, left.api.events}.isdisjoint({right.api.control, right.api.events})
    assert stat.S_IMODE((tmp_path / "etc/reprobe/left/keys").stat().st_mode) == 0o700
    rules = (tmp_path / "etc/udev/rules.d/70-reprobe.rules").read_text()
    assert 'SYMLINK+="reprobe-$env{REPROBE_STATION}-$env{REPROBE}"' in rules
    assert "reprobe@$env{REPROBE_STATION}.service" in rules


@pytest.mark.parametrize("name", ["", "Left", "a/b", "../x", "a b", "%i", "-x", "a" * 40])
def test_a_name_that_no_station_can_have_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InstallError, match="small letters"):
        lay_out(tmp_path, instance=name)
    assert not list(tmp_path.iterdir())


def test_modem_manager_is_kept_from_the_ports_also_where_the_rules_were_edited_long_ago(tmp_path: Path) -> None:
    (tmp_path / "etc/udev/rules.d").mkdir(parents=True)
    (tmp_path / "etc/udev/rules.d/70-reprobe.rules").write_text('SUBSYSTEM=="tty", ENV{REPROBE}="bus"')
    lay_out(tmp_path)
    kept_away = [
        path for path in (tmp_path / "etc/udev/rules.d").iterdir() if "ID_MM_DEVICE_IGNORE" in path.read_text()
    ]
    assert [path.name > "70-reprobe.rules" for path in kept_away] == [True]
