"""A station in an emulated machine: the installed program on real device nodes, the simulated station behind them."""

from __future__ import annotations

import contextlib
import re
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from daemon.client import Client
from daemon.domain.board import Board
from daemon.tools.board_import import Options, import_board
from daemon.tools.demo.processes import DemoBench, Process
from daemon.tools.demo.settings import Places, write_settings
from tests.station.rig import DEMO_BOARD, FAST
from tests.system.machine import build_wheel
from tests.vm.vm import HOST_ADDRESS, NETWORK, OWN_ADDRESS, Vm, Wires, booted

HERE = Path(__file__).parent
PYTHON, REPROBE = "/opt/reprobe/bin/python", "/opt/reprobe/bin/reprobe"
CONTROL_PORT = 5555
LINE, OTHER_LINE = "/dev/ttyS1", "/dev/ttyS2"
CAMERA, OTHER_CAMERA = "/dev/video0", "/dev/video1"
CAMERA_NAME = "station camera"
FRAME_PERIOD_S = 0.25
"""Slower than any camera: drawing, carrying and copying a picture takes an emulated machine a good part of this."""
RULES = {
    'ENV{ID_VENDOR_ID}=="0403", ENV{ID_SERIAL_SHORT}=="FT000000"': 'KERNEL=="ttyS1"',
    'ENV{ID_VENDOR_ID}=="32e4", ENV{ID_SERIAL_SHORT}=="0001"': f'ATTR{{name}}=="{CAMERA_NAME}"',
}
"""What a person puts into the device rules: how this station's adapter and camera are told."""
DROP_IN = f"""\
[Service]
# Testers on the emulated network, with keys; and an emulated processor is some thirty times slower than a real one.
IPAddressAllow={NETWORK}
TimeoutStartSec=300
WatchdogSec=60
TimeoutStopSec=120
"""
FEED = f"""\
[Unit]
Description=pictures of the simulated camera for the loopback device
[Service]
Type=notify
ExecStart={PYTHON} /root/feed.py {{endpoint}} {CAMERA} {FRAME_PERIOD_S:g}
Restart=on-failure
RestartSec=1
"""
SETTINGS = {
    r'name = "demo"': 'name = "emulated"',
    r'data_dir = "station"': 'data_dir = "/var/lib/reprobe"',
    r'port = "[^"]*"': 'port = "/dev/reprobe-bus"',
    r'parity = "N"': 'parity = "E"',
    r'kind = "stream"\nendpoint = "[^"]*"': 'kind = "v4l2"\ndevice = "/dev/reprobe-camera"',
    r'control = "[^"]*"': f'control = "tcp://{OWN_ADDRESS}:{CONTROL_PORT}"\ncurve = true',
    r'events = "[^"]*"': f'events = "tcp://{OWN_ADDRESS}:{CONTROL_PORT + 1}"',
    r'live = "[^"]*"': 'live = "ipc:///run/reprobe/live"',
}
MORE_SETTINGS = "\n[servo]\njob_timeout_s = 1200.0\n"
REPLY_MS = 3000.0
NOWHERE = Path("/nowhere")
"""What the demonstration would lay out there, the emulated machine has elsewhere: the name must not be left."""


@dataclass
class Station:
    """A machine that is laid out and wired, and what a person beside it sees; the daemon is not started yet."""

    vm: Vm
    bench: DemoBench
    board: Board
    endpoint: str
    key: Path

    def client(self) -> Client:
        """Return a tester's connection, from outside and with its key."""
        return Client(self.endpoint, timeout_s=120.0, keys=self.key)


@contextmanager
def station(work: Path) -> Iterator[Station]:
    """Start the simulated station, boot the machine on it, and lay the program out in there as the README says."""
    camera = f"tcp://127.0.0.1:{_free_port()}"
    control_port = _free_port()
    with _simulated(work, camera) as bench, booted(work, Wires(work / "line", {control_port: CONTROL_PORT})) as vm:
        vm.join_network()
        _install(vm, work)
        # Without layers: to lay CAD over a picture takes the emulated machine minutes; that is tried on real ones.
        board = import_board(DEMO_BOARD, "top", Options(bare=True)).model_copy(update={"layers": None})
        _configure(vm, board)
        _plug_in(vm, camera.replace("127.0.0.1", HOST_ADDRESS))
        key = work / "tester.key"
        key.touch(0o600)
        key.write_text(vm.get("/root/tester.key"))
        yield Station(vm, bench, board, f"tcp://127.0.0.1:{control_port}", key)


@contextmanager
def _simulated(work: Path, camera: str) -> Iterator[DemoBench]:
    with tempfile.TemporaryDirectory(prefix="reprobe-") as sockets, contextlib.ExitStack() as stack:
        arguments = [
            "sim_hw", "--board", str(DEMO_BOARD), "--line", str(work / "line"), "--camera", camera,
            "--bench", f"ipc://{sockets}/bench", "--truth", str(work / "truth.jsonl"), *FAST,
        ]  # fmt: skip
        simulated = Process("simulated station", arguments, work / "sim.log", ready_line=True)
        stack.callback(simulated.end)
        bench = DemoBench(simulated.ready()["bench"])
        stack.callback(bench.close)
        yield bench


def _install(vm: Vm, work: Path) -> None:
    """Install the wheel and lay out what the service manager needs."""
    wheel = build_wheel(work)
    vm.put(f"/root/{wheel.name}", wheel.read_bytes())
    pip = ("/opt/reprobe/bin/pip", "install", "-q", "--disable-pip-version-check", "--no-index", "--no-deps")
    vm.run(*pip, f"/root/{wheel.name}", within_s=300.0)
    vm.run(REPROBE, "install", "--root", "/", within_s=300.0)
    vm.run("systemd-sysusers")
    vm.run("systemd-tmpfiles", "--create", "--prefix=/etc")


def _configure(vm: Vm, board: Board) -> None:
    """Do what a person does: name the devices, write the configuration, make a tester's key."""
    rules = vm.get("/etc/udev/rules.d/70-reprobe.rules")
    for shipped, own in RULES.items():
        assert shipped in rules, shipped
        rules = rules.replace(shipped, own)
    vm.put("/etc/udev/rules.d/70-reprobe.rules", rules)
    vm.run("udevadm", "control", "--reload")
    vm.put("/etc/reprobe/station.toml", emulated_settings())
    vm.put("/etc/reprobe/board.json", board.model_dump_json())
    vm.run(REPROBE, "keys", "new", "tester", "--role", "maintain", "--out", "/root/tester.key", within_s=300.0)
    vm.put("/etc/systemd/system/reprobe.service.d/emulated.conf", DROP_IN)


def emulated_settings() -> str:
    """Return the demonstration's configuration for the devices, places and times of the emulated machine."""
    with tempfile.TemporaryDirectory() as draft:
        text = write_settings(Places(Path(draft), NOWHERE), reply_ms=REPLY_MS, pictures="failed").read_text()
    for pattern, replacement in SETTINGS.items():
        text, times = re.subn(pattern, lambda _found, new=replacement: new, text)  # type: ignore[misc]
        assert times == 1, pattern
    return text + MORE_SETTINGS


def _plug_in(vm: Vm, endpoint: str) -> None:
    """Make the cameras, the first of which shows what the simulated one sees."""
    vm.run("udevadm", "trigger", "--settle", "--subsystem-match=tty")
    vm.run("modprobe", "v4l2loopback", "video_nr=0", "max_buffers=4", f"card_label={CAMERA_NAME}")
    # As an HDMI receiver: as a web camera it has no 1600 x 1200.
    vm.run("modprobe", "vivid", "n_devs=1", "node_types=0x1", "num_inputs=1", "input_types=0x3", "vid_cap_nr=1")
    vm.run("udevadm", "settle")
    vm.put("/root/feed.py", (HERE / "feed.py").read_bytes())
    vm.put("/etc/systemd/system/camera-feed.service", FEED.format(endpoint=endpoint))
    vm.run("systemctl", "daemon-reload")
    vm.run("systemctl", "start", "camera-feed", within_s=300.0)


def _free_port() -> int:
    """Return a port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def until_open(station: Station) -> None:
    """Start the daemon if it does not run, and wait until it has opened its devices."""
    code, said = station.vm.call("systemctl", "start", "reprobe", within_s=300.0)
    assert code == 0, said + station.vm.log()
    station.vm.until(
        lambda: station.vm.show("StatusText").startswith(("fault: not_homed", "idle")), "the devices were not opened"
    )
