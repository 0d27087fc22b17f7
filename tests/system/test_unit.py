"""The unit under a real systemd: started, watched, reloaded and stopped as on a station, on the simulated hardware."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator

import pytest
import zmq

from daemon.client import Client
from daemon.domain.board import Board
from daemon.tools.demo.processes import DemoBench
from daemon.tools.demo.session import Session
from tests.system.machine import Machine, booted, why_not

REQUIRED = os.environ.get("REPROBE_TEST_SYSTEMD") == "build"
WHY_NOT = why_not()
pytestmark = [
    pytest.mark.timeout(400),
    pytest.mark.skipif(WHY_NOT is not None and not REQUIRED, reason=WHY_NOT or ""),
]
STATION = "/etc/reprobe/station.toml"
WATCHDOG_S = 3.0
TESTER = "/root/tester.key"
OPENS = "import sys; open(sys.argv[1], 'rb', buffering=0).close()"
SENDS = "import socket, sys; s = socket.socket(type=socket.SOCK_DGRAM); s.sendto(b'x', (sys.argv[1], 9))"


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    """A machine on which the README's steps have been done."""
    assert WHY_NOT is None, WHY_NOT
    with booted(tmp_path_factory.mktemp("system")) as up:
        up.run("systemd-sysusers")
        up.run("systemd-tmpfiles", "--create", "--prefix=/etc")
        up.run("/opt/reprobe/bin/reprobe", "keys", "new", "tester", "--role", "operate", "--out", TESTER)
        # Control through the file system, where the test can reach it from outside of the machine's network.
        settings = up.path(STATION)
        text = settings.read_text().replace("tcp://127.0.0.1:5555", "ipc:///run/reprobe/control")
        # Other tests may keep both cores busy: a slave that is slow is not what is tested here.
        settings.write_text(text.replace("timeout_ms = 200", "timeout_ms = 1500"))
        drop_in = up.path("/etc/systemd/system/reprobe.service.d/quick.conf")
        drop_in.write_text(f"[Service]\nWatchdogSec={WATCHDOG_S:g}\nRestartSec=100ms\n")
        _hurry(up)
        up.run("systemctl", "daemon-reload")
        up.run("systemctl", "start", "reprobe-sim")
        yield up


def _hurry(machine: Machine) -> None:
    """Hurry the simulated station's clock and line: other tests may keep both cores busy."""
    unit = machine.path("/usr/local/lib/systemd/system/reprobe-sim.service").read_text().replace("\\\n", " ")
    (command,) = re.findall(r"^ExecStart=(.*)$", unit, re.MULTILINE)
    folder = machine.path("/etc/systemd/system/reprobe-sim.service.d")
    folder.mkdir()
    (folder / "quick.conf").write_text(f"[Service]\nExecStart=\nExecStart={command} --unpaced --speed 3\n")


@pytest.fixture
def running(machine: Machine) -> Machine:
    """The same with the daemon up."""
    machine.run("systemctl", "start", "reprobe")
    return machine


@pytest.fixture
def client(running: Machine) -> Iterator[Client]:
    with Client(f"ipc://{running.path('/run/reprobe/control')}", timeout_s=30.0) as connected:
        yield connected


@pytest.fixture(scope="module")
def bench(machine: Machine) -> Iterator[DemoBench]:
    """What a person beside the simulated station would see."""
    sees = DemoBench(f"ipc://{machine.path('/run/reprobe-sim/bench')}")
    yield sees
    sees.close()


def _takes(machine: Machine, name: str) -> float:
    return int(machine.show(name)) / 1e6


def test_the_start_is_over_when_the_state_is_known(running: Machine) -> None:
    assert running.show("ActiveState") == "active"
    assert running.show("StatusText").startswith("fault: not_homed")
    took_s = _takes(running, "ActiveEnterTimestampMonotonic") - _takes(running, "ExecMainStartTimestampMonotonic")
    print(f"start to READY: {took_s:.2f} s")  # noqa: T201  # a figure for the README; judged by nobody here


def test_it_runs_as_its_own_user_without_any_right(running: Machine) -> None:
    status = running.run("cat", f"/proc/{running.main_pid()}/status")
    facts = dict(line.split(":\t", 1) for line in status.splitlines() if ":\t" in line)
    user = running.run("id", "-u", "reprobe").strip()
    assert set(facts["Uid"].split()) == {user}
    assert int(facts["CapEff"], 16) == int(facts["CapBnd"], 16) == 0
    assert facts["NoNewPrivs"] == "1"
    assert facts["Seccomp"] == "2"


def test_keys_are_handed_over_and_stay_roots(running: Machine) -> None:
    pid = running.main_pid()
    environment = running.path(f"/proc/{pid}/environ").read_text().split("\0")
    (folder,) = [v.partition("=")[2] for v in environment if v.startswith("CREDENTIALS_DIRECTORY=")]
    as_daemon = ("setpriv", "--reuid=reprobe", "--regid=reprobe", "--clear-groups")
    key = running.path("/etc/reprobe/keys/server.key").read_text()
    assert running.run(*as_daemon, "cat", f"{folder}/server.key") == key
    assert "Permission denied" in running.run(*as_daemon, "cat", "/etc/reprobe/keys/server.key", fails=True)
    as_other = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups")
    assert "Permission denied" in running.run(*as_other, "cat", f"{folder}/server.key", fails=True)


def test_devices_beside_its_own_are_refused(running: Machine) -> None:
    python = ("/opt/reprobe/bin/python", "-c", OPENS)
    line = str(running.path("/run/reprobe-sim/bus").readlink())
    running.run(*python, "/dev/kmsg")  # outside of the unit it opens: what refuses below is the unit's list
    assert not running.in_group_of("reprobe.service", *python, "/dev/kmsg")
    assert running.in_group_of("reprobe.service", *python, "/dev/null")
    assert running.in_group_of("reprobe.service", *python, line), "its own port"


def test_only_this_computer_is_reached(running: Machine) -> None:
    python = ("/opt/reprobe/bin/python", "-c", SENDS)
    running.run(*python, "192.0.2.1")  # an address of the machine's own, but not loopback's
    assert not running.in_group_of("reprobe.service", *python, "192.0.2.1")
    assert running.in_group_of("reprobe.service", *python, "127.0.0.1")


def test_a_bad_configuration_is_refused_on_reload_and_a_good_one_taken(running: Machine, client: Client) -> None:
    settings = running.path(STATION)
    good, pid = settings.read_text(), running.main_pid()
    settings.write_text(good.replace("[head]", "[head]\nradius = 1"))
    code, _ = running.call("systemctl", "reload", "reprobe", within_s=90.0)
    assert code != 0, "a person at a terminal sees at once that it was not taken"
    assert "head.radius: there is no key 'radius' in [head]; is 'radius_um' meant?" in running.log()
    running.until_status("refused")
    assert "head.radius" in running.show("StatusText")
    assert "head.radius" in client.request("status")["configuration_refused"][0]
    board = running.path("/etc/reprobe/board.json")
    running.path("/etc/reprobe/other.json").write_text(board.read_text().replace('"name": "', '"name": "other ', 1))
    settings.write_text(good.replace("/board.json", "/other.json").replace('"board.json"', '"other.json"'))
    running.run("systemctl", "reload", "reprobe")
    running.until(lambda: client.request("describe")["board"]["name"].startswith("other"), "it was not taken over")
    running.until(lambda: running.show("ActiveState") == "active", "the reload never ended")
    assert client.request("status")["configuration_refused"] == []
    settings.write_text(good)
    assert running.main_pid() == pid


def test_a_correction_is_done_under_all_restrictions(running: Machine, client: Client, bench: DemoBench) -> None:
    board = Board.load(running.path("/etc/reprobe/board.json"))
    Session(client, bench, board, 1, lambda _text: None).set_up()
    assert client.job("place", test_point="TP4", theta_deg=10.0).ok
    result = client.job("correct", test_point="TP4")
    assert result.ok, result.error
    running.until_status("last: correct TP4")
    pages = running.path("/var/lib/reprobe/calibration/reports")
    assert any(pages.glob("map-*.html")), "the page of a calibration is drawn by a process under the same restrictions"


def test_sigterm_in_the_middle_of_a_move_stops_lifts_and_darkens(
    running: Machine, client: Client, bench: DemoBench
) -> None:
    assert client.job("home").ok
    client.job("place", board_um=[0.0, 0.0])
    client.request("place", id="cut-short", board_um=[39_000.0, 29_000.0], theta_deg=90.0)
    running.until(lambda: bool(bench.ask("truth")["moving"]), "it never moved")
    began_s = time.monotonic()
    running.run("systemctl", "stop", "reprobe")
    print(f"stop in a move: {time.monotonic() - began_s:.2f} s")  # noqa: T201
    assert running.show("Result") == "success"
    assert running.show("ActiveState") == "inactive"
    truth = bench.ask("truth")
    assert not truth["moving"]
    assert truth["axes"]["z_um"] > 11_900.0
    running.until(lambda: max(bench.ask("truth")[lamp] for lamp in ("white", "red")) < 0.05, "the lamps glow on")


def test_a_hung_daemon_is_started_anew_and_moves_nothing(running: Machine, client: Client, bench: DemoBench) -> None:
    before = bench.ask("truth")["axes"]
    hung, starts = running.main_pid(), int(running.show("NRestarts"))
    running.run("/bin/sh", "-c", f"kill -STOP {hung}")
    began_s = time.monotonic()
    running.until(lambda: int(running.show("NRestarts")) == starts + 1, "the watchdog did not bite")
    took_s = time.monotonic() - began_s
    running.until(lambda: running.show("ActiveState") == "active", "it did not come back")
    print(f"watchdog of {WATCHDOG_S:g} s: bit after {took_s:.2f} s, back after {time.monotonic() - began_s:.2f} s")  # noqa: T201
    assert running.main_pid() != hung
    assert "watchdog" in running.run("journalctl", "-b", "--no-pager", "-u", "reprobe").lower()
    assert bench.ask("truth")["axes"] == before
    assert client.request("status")["state"] in ("idle", "fault")


def test_a_wrong_configuration_is_not_tried_again_and_again(running: Machine) -> None:
    settings = running.path(STATION)
    good = settings.read_text()
    settings.write_text(good[: len(good) // 2])
    running.run("systemctl", "restart", "reprobe", fails=True)
    assert running.show("ActiveState") == "failed"
    assert running.show("ExecMainStatus") == "2"
    assert running.show("NRestarts") == "0"
    settings.write_text(good)
    running.run("systemctl", "reset-failed", "reprobe")
    running.run("systemctl", "start", "reprobe")


def test_with_keys_only_who_is_on_the_list_comes_in(running: Machine) -> None:
    """The daemon reads its key and the list from its credentials: root's folder is closed to it."""
    settings = running.path(STATION)
    good = settings.read_text()
    settings.write_text(good.replace("[api]", "[api]\ncurve = true"))
    running.run("systemctl", "restart", "reprobe")
    ask = ("/opt/reprobe/bin/reprobe", "status", "--json", "--endpoint", "ipc:///run/reprobe/control")
    assert '"state"' in running.run(*ask, "--key", TESTER)
    running.path("/root/other.key").write_text(_of_another_station(running.path(TESTER).read_text()))
    running.path("/root/other.key").chmod(0o600)
    assert '"state"' not in running.run("timeout", "5", *ask, "--key", "/root/other.key", fails=True)
    assert '"state"' not in running.run("timeout", "5", *ask, fails=True)
    settings.write_text(good)
    running.run("systemctl", "restart", "reprobe")


def _of_another_station(private: str) -> str:
    """Return the private file of a client that has a sound key pair, which is on no list here."""
    public, secret = (part.decode() for part in zmq.curve_keypair())
    private = re.sub(r"(?m)^public = .*$", f"public = '{public}'", private)
    return re.sub(r"(?m)^secret = .*$", f"secret = '{secret}'", private)


def test_a_second_install_changes_nothing(running: Machine) -> None:
    settings = running.path(STATION).read_text()
    words = running.run("/opt/reprobe/bin/reprobe", "install", "--root", "/", "--bench")
    assert "written" not in words
    assert "brought up to date" not in words
    assert running.path(STATION).read_text() == settings
