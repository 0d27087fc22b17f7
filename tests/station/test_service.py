"""The daemon as a service: what it tells its manager, SIGHUP and SIGTERM, on the simulated station."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from daemon.client import Client
from daemon.tools.demo.processes import Process
from tests.station.rig import EVENTUALLY_S, Rig, running_rig

FAR: dict[str, Any] = {"board_um": [39_000.0, 29_000.0], "theta_deg": 90.0}
SAFE_UM, TOUCH_UM = 12_000.0, 5_000.0
WATCHDOG_S = 2.0
STOP_WITHIN_S = 30.0
"""TimeoutStopSec of the unit."""


class Manager:
    """A service manager's end of the notification socket."""

    def __init__(self, listening: socket.socket) -> None:
        self.words: list[dict[str, str]] = []
        self._new: queue.Queue[dict[str, str]] = queue.Queue()
        # A manager reads at once: the socket's queue holds ten datagrams.
        self._thread = threading.Thread(target=self._listen, args=(listening,))
        self._thread.start()

    def _listen(self, listening: socket.socket) -> None:
        while word := listening.recv(4096).decode():
            self._new.put(dict(line.split("=", 1) for line in word.splitlines()))

    def close(self) -> None:
        self._thread.join()

    def until(self, key: str, holds: str) -> dict[str, str]:
        """Wait for a message whose `key` contains something."""
        give_up_s = time.monotonic() + EVENTUALLY_S
        while True:
            assert time.monotonic() < give_up_s, f"{key} never told of {holds!r}: {self.words[-8:]}"
            with contextlib.suppress(queue.Empty):
                word = self._new.get(timeout=0.5)
                self.words.append(word)
                if holds in word.get(key, ""):
                    return word


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A station that has been homed, no more."""
    with running_rig(tmp_path_factory.mktemp("rig")) as running:
        with running.client() as client:
            assert client.job("home").ok
        yield running


@pytest.fixture(scope="module")
def manager(rig: Rig) -> Iterator[Manager]:
    """A manager under which every daemon of this module is started."""
    assert rig.daemon.end() == 0
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening, pytest.MonkeyPatch.context() as patch:
        listening.bind(str(rig.places.sockets / "notify"))
        patch.setenv("NOTIFY_SOCKET", str(rig.places.sockets / "notify"))
        patch.setenv("WATCHDOG_USEC", str(int(WATCHDOG_S * 1e6)))
        manager = Manager(listening)
        yield manager
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
            end.sendto(b"", str(rig.places.sockets / "notify"))
        manager.close()


@pytest.fixture
def daemon(rig: Rig, manager: Manager) -> Iterator[Rig]:
    """A daemon that has just come up, idle: the drives kept their reference. It ends with the test in any case."""
    manager.words.clear()
    rig.start_daemon(lambda _process, _control: manager.until("READY", "1"))
    yield rig
    if rig.daemon.alive():
        rig.daemon.end()


def _stop(rig: Rig, manager: Manager) -> None:
    """Stop the daemon as systemd does, within systemd's patience."""
    os.kill(rig.daemon.pid, signal.SIGTERM)
    began_s = time.monotonic()
    while rig.daemon.alive():
        assert time.monotonic() < began_s + STOP_WITHIN_S, rig.daemon.last_words()
        time.sleep(0.02)
    assert rig.daemon.end() == 0, rig.daemon.last_words()
    manager.until("STOPPING", "1")


def _dark_and_still(truth: dict[str, Any]) -> bool:
    return not truth["moving"] and max(truth["white"], truth["red"]) < 0.05


def test_it_is_ready_in_a_known_state_and_keeps_its_manager_told(daemon: Rig, manager: Manager) -> None:
    ready = manager.words[-1]
    assert ready["READY"] == "1"
    assert ready["STATUS"].startswith("idle; last: ")
    manager.until("WATCHDOG", "1")
    with daemon.client() as client:
        assert client.job("place", test_point="TP4", theta_deg=10.0).ok
        manager.until("STATUS", "last: place TP4 placed")
        assert not client.job("correct", test_point="TP4").ok
        manager.until("STATUS", "last: correct TP4 failed, not_calibrated")
    _stop(daemon, manager)


def test_a_bad_configuration_is_refused_whole_and_a_good_one_taken_over(daemon: Rig, manager: Manager) -> None:
    file = daemon.places.out / "station.toml"
    good = file.read_text()
    with daemon.client() as client:
        try:
            file.write_text(good.replace("[api]", '[servo]\ntolerance_um = -1.0\nquick = "yes"\n[api]'))
            os.kill(daemon.daemon.pid, signal.SIGHUP)
            assert int(manager.until("RELOADING", "1")["MONOTONIC_USEC"]) > 0
            refused = manager.until("READY", "1")["STATUS"]
            assert "refused" in refused
            assert "servo.tolerance_um" in refused
            assert client.job("place", test_point="TP4", theta_deg=10.0).ok, "it goes on with the old one"
            file.write_text(good.replace('file = "board.json"', 'file = "b.json"'))
            board = (daemon.places.out / "board.json").read_text()
            (daemon.places.out / "b.json").write_text(board.replace(daemon.board.name, "another board"))
            os.kill(daemon.daemon.pid, signal.SIGHUP)
            manager.until("RELOADING", "1")
            assert "refused" not in manager.until("READY", "1")["STATUS"]
            assert client.request("describe")["board"]["name"] == "another board"
            assert client.job("place", test_point="TP4", theta_deg=10.0).ok
        finally:
            file.write_text(good)
    _stop(daemon, manager)


def test_a_new_configuration_waits_for_the_job_under_way(daemon: Rig, manager: Manager) -> None:
    file = daemon.places.out / "station.toml"
    good = file.read_text()
    with daemon.client() as client:
        client.job("place", board_um=[0.0, 0.0])
        try:
            file.write_text(good.replace("[board]", "[servo]\ntolerance_um = 16.0\n[board]"))
            client.request("place", id="far-off", **FAR)
            daemon.until(lambda truth: truth["moving"], "it never moved")
            os.kill(daemon.daemon.pid, signal.SIGHUP)
            assert "waits" in manager.until("READY", "1")["STATUS"]
            assert client.job("place", job_id="far-off", **FAR).ok, "the job is not disturbed"
            assert "waits" not in manager.until("READY", "1")["STATUS"]
        finally:
            file.write_text(good)
    _stop(daemon, manager)


def test_sigterm_in_the_middle_of_a_move_stops_lifts_and_darkens(daemon: Rig, manager: Manager) -> None:
    with daemon.client() as client:
        client.job("place", board_um=[0.0, 0.0])
        client.request("place", id="cut-short", **FAR)
        daemon.until(lambda truth: truth["moving"], "it never moved")
        _stop(daemon, manager)
    truth = daemon.truth()
    assert truth["moving"] is False
    assert truth["axes"]["z_um"] > SAFE_UM - 100.0
    daemon.until(_dark_and_still, "the lamps went on glowing")


@pytest.fixture
def pressing(rig: Rig) -> Iterator[None]:
    """A configuration whose working height lies below the board's surface."""
    file = rig.places.out / "station.toml"
    good = file.read_text()
    pressed = good.replace("work_z_um = 5200.0", "work_z_um = 4750.0").replace(
        "touch_z_um = 5000.0", "touch_z_um = 4700.0\nsurface_range_um = 0.0"
    )
    assert pressed != good
    file.write_text(pressed)
    yield
    file.write_text(good)


def test_sigterm_while_the_pin_is_pressed_lifts_it_off_the_board(pressing: None, daemon: Rig, manager: Manager) -> None:
    with daemon.client() as client:
        assert client.request("result", id="cut-short")["result"]["error"]["name"] == "shutting_down"
        assert client.job("place", test_point="TP4", theta_deg=10.0).ok
        assert daemon.truth()["axes"]["z_um"] < TOUCH_UM - 100.0, "it is not pressed"
        _stop(daemon, manager)
    assert daemon.truth()["axes"]["z_um"] > SAFE_UM - 100.0
    daemon.until(_dark_and_still, "the lamps went on glowing")


def test_sigterm_with_the_cable_out_ends_in_time_and_moves_nothing(daemon: Rig, manager: Manager) -> None:
    with daemon.client() as client:
        client.job("place", test_point="TP4", theta_deg=10.0)
        client.request("place", id="cable", **FAR)
        daemon.until(lambda truth: truth["moving"], "it never moved")
        with daemon.fault("cable_out"):
            _stop(daemon, manager)
    daemon.until(lambda truth: not truth["moving"], "it went on for ever")


def test_a_daemon_started_anew_is_ready_and_stands_where_it_was(daemon: Rig, manager: Manager) -> None:
    before = daemon.truth()["axes"]
    manager.until("WATCHDOG", "1")
    assert daemon.truth()["axes"] == before
    with Client(daemon.control, timeout_s=EVENTUALLY_S) as client:
        assert client.request("result", id="cable")["result"]["ok"] is False
    _stop(daemon, manager)


def test_a_second_daemon_of_the_same_station_ends_at_once_and_the_first_does_not_notice(
    daemon: Rig, manager: Manager
) -> None:
    settings = str(daemon.places.out / "station.toml")
    second = Process(
        "second", ["daemon.cli", "run", "-c", settings], daemon.places.out / "second.log", ready_line=False
    )
    assert second.wait() == 1
    assert f"another daemon (process {daemon.daemon.pid})" in " ".join(second.last_words().split())
    with daemon.client() as client:
        assert client.request("status")["state"] == "idle"
        assert client.job("place", test_point="TP4", theta_deg=10.0).ok
    _stop(daemon, manager)


def test_sigterm_when_the_whole_station_is_gone_ends_in_time(daemon: Rig, manager: Manager) -> None:
    """The last one here: nobody answers any more, neither on the line nor at the camera."""
    with daemon.client() as client:
        client.request("home", id="gone")
        daemon.until(lambda truth: truth["moving"], "it never moved")
        daemon.sim.kill()
        assert client.job("home", job_id="gone").error is not None
    _stop(daemon, manager)
    assert '"camera.hangs"' in daemon.daemon.last_words() or '"camera.lost"' in daemon.daemon.last_words()
