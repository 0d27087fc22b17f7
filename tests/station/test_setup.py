"""The guided set-up, from no file at all to a corrected test point, by a person who answers what is asked."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from daemon.client import Client
from daemon.config.model import load_config
from daemon.tools.demo.processes import DemoBench, Process, wait_for_daemon
from tests.station.rig import DEMO_BOARD, FAST

pytestmark = pytest.mark.timeout(1800)
TRANSCRIPT = os.environ.get("REPROBE_SETUP_TRANSCRIPT")
"""Where to keep what was said, for whoever wants to read it."""
HOMING = {"x": "21", "y": "21", "z": "19", "theta": "19"}


class Person:
    """Sits before the terminal and beside the simulated station, whose head they watch with a ruler."""

    def __init__(self, sockets: Path, bench: DemoBench) -> None:
        self._sockets, self._bench = sockets, bench
        self._axis = ""
        self._before: dict[str, float] = {}
        self._asked_for: list[str] = []
        self.quits_at: str | None = None
        self.failures = 0
        self.answered: list[tuple[str, str]] = []

    def answer(self, prompt: str, said: str) -> str:
        """Return what the person types; `said`: all that stands above the prompt since the last one."""
        if found := re.findall(r"Axis (\w+):", said):
            self._axis = found[-1]
        for asked, reply in self._replies(said):
            if asked in prompt:
                answer = reply() if callable(reply) else reply
                break
        else:
            answer = ""
        self.answered.append((prompt, answer))
        return answer

    def _replies(self, said: str) -> Iterator[tuple[str, str | Callable[[], str]]]:
        yield "Port of the drives", str(self._sockets / "bus")
        yield "Camera (", f"ipc://{self._sockets / 'camera'}"
        yield "Board file, or folder", str(DEMO_BOARD)
        yield "without parts", "y"
        yield "Socket of control", f"ipc://{self._sockets / 'control'}"
        yield "Socket of events", f"ipc://{self._sockets / 'events'}"
        # They take the spindle of X for one of 10 mm
        yield "travel with one turn", "10" if self._axis == "x" else ""
        yield "homing method", HOMING.get(self._axis, "")
        yield "homing switch", {"x": "0", "y": "0", "z": "30", "theta": "0"}.get(self._axis, "")
        yield "the other way", self._measured
        yield "The place that the page shows", lambda: ",".join(f"{v:.2f}" for v in self._bench.ask("status")["tip_px"])
        yield "Enter: try again", self._patience
        yield "Enter: move", lambda: self._watch(said)
        if self.quits_at is not None:
            yield "s: skip this step", "q" if self.quits_at in said else ""

    def _patience(self) -> str:
        """A step that a busy computer made fail is tried again, twice."""
        self.failures += 1
        return "" if self.failures <= 2 else "q"

    def _watch(self, said: str) -> str:
        self._before = dict(self._bench.ask("truth")["axes"])
        self._asked_for = re.findall(r"\(\+(\w)\)|(turns)", said)[-1:] or self._asked_for
        return ""

    def _measured(self) -> str:
        now = self._bench.ask("truth")["axes"]
        axis, turns = self._asked_for[-1]
        if turns:
            return f"{now['theta_deg'] - self._before['theta_deg']:.2f}"
        name = f"{axis.lower()}_um"
        return f"{(now[name] - self._before[name]) / 1e3:.2f}"


def _set_up(file: Path, person: Person, *more: str) -> tuple[int, str]:
    """Run the command; return its exit code and all that was on the terminal, with the answers."""
    command = [sys.executable, "-m", "daemon.cli", "setup", "-c", str(file), *more]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        said, since = "", ""
        while byte := process.stdout.read(1):
            since += byte.decode(errors="replace")
            if since.endswith(" > "):
                answer = person.answer(since.rpartition("\n")[2], since)
                said += f"{since}{answer}\n"
                since = ""
                process.stdin.write(f"{answer}\n".encode())
                process.stdin.flush()
        process.wait()
    return process.returncode, said + since


@pytest.fixture
def station(tmp_path: Path) -> Iterator[tuple[Person, Path]]:
    """A simulated station alone; nobody has configured anything."""
    with tempfile.TemporaryDirectory(prefix="reprobe-") as folder:
        sockets = Path(folder)
        arguments = ["sim_hw", "--board", str(DEMO_BOARD), "--seed", "1", "--line", str(sockets / "bus"),
                     "--camera", f"ipc://{sockets / 'camera'}", "--bench", f"ipc://{sockets / 'bench'}",
                     "--truth", str(tmp_path / "truth.jsonl"), *FAST]  # fmt: skip
        sim = Process("simulated station", arguments, tmp_path / "sim.log", ready_line=True)
        try:
            bench = DemoBench(sim.ready()["bench"])
            try:
                yield Person(sockets, bench), sockets
            finally:
                bench.close()
        finally:
            sim.end()


def test_from_no_file_to_a_corrected_point_interrupted_on_the_way(tmp_path: Path, station: tuple[Person, Path]) -> None:
    person, sockets = station
    file = tmp_path / "station.toml"
    person.quits_at = "Homing"
    code, first = _set_up(file, person)
    assert code == 1, first
    assert "goes on where this was" in first
    assert "drives 1, 2, 3, 4; others, such as relays: 5" in first, first
    assert load_config(file).axes.x.increments_per_unit == pytest.approx(327.68)
    person.quits_at = None
    code, second = _set_up(file, person)
    if TRANSCRIPT:
        Path(TRANSCRIPT).write_text(f"{first}\n{second}", encoding="utf-8")
    assert code == 0, second[-3000:]
    assert "Drives and relay on the line: done before" in second
    assert "Skipped" not in second
    assert "axes.x.increments_per_unit: 327.68 becomes 65" in second
    assert load_config(file).axes.x.increments_per_unit == pytest.approx(655.36, rel=0.002)
    for part in second.split("\n== ")[1:]:
        told = part.splitlines()[1] if "done before" not in part.splitlines()[0] else "Nothing moves."
        assert told.startswith(("Nothing moves.", "THIS MOVES: ")), "before anything else it says what moves"
    assert {"tip", "map", "rotation", "alignment", "surface"} <= _calibrated(file)
    _lands(tmp_path, file, f"ipc://{sockets / 'control'}")


def _calibrated(file: Path) -> set[str]:
    folder = load_config(file).station.data_dir / "calibration"
    return {path.stem for path in folder.glob("*.json")} | ({"tip"} if (folder / "probe.npz").exists() else set())


def _lands(folder: Path, file: Path, control: str) -> None:
    """The station that was set up corrects a test point."""
    daemon = Process("daemon", ["daemon.cli", "serve", "--config", str(file)], folder / "daemon.log", ready_line=False)
    try:
        wait_for_daemon(daemon, control)
        with Client(control, timeout_s=60.0) as client:
            assert client.job("home").ok
            assert client.job("place", test_point="TP7").ok
            result = client.job("correct", test_point="TP7")
            assert result.ok, result.error
    finally:
        daemon.end()
