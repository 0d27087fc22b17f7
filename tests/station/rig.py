"""A running simulated station with its daemon, for tests."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from daemon.client import Client
from daemon.domain.board import Board
from daemon.tools.board_import import Options, import_board
from daemon.tools.demo.processes import DemoBench, Process, wait_for_daemon
from daemon.tools.demo.session import Session
from daemon.tools.demo.settings import Places, write_settings
from daemon.tools.demo.wiring import wiring_toml

ROOT = Path(__file__).parents[2]
EVENTUALLY_S = 60.0
STARTED_WITHIN_S = 60.0
PATIENT_REPLY_MS = 500.0
"""The stations of several tests share few cores: an answer may be later than on a line of its own."""
FAST = ("--unpaced", "--speed", "3")
"""The plant and the pixels stay as they are; only the clock and the line are hurried."""
PROGRAM = ("daemon.cli",)
"""Module that is run as the daemon, and what comes before its own arguments."""
DEMO_BOARD = ROOT / "sim_hw" / "demo_board"


@dataclass
class Rig:
    """A running simulated station with its daemon."""

    places: Places
    board: Board
    sim: Process
    bench: DemoBench
    daemon: Process
    program: tuple[str, ...] = PROGRAM
    meter: str = ""
    """Where the simulated station's meter listens, host:port."""

    @property
    def control(self) -> str:
        return self.places.socket("control")

    @property
    def events(self) -> str:
        return self.places.socket("events")

    def client(self, timeout_s: float = EVENTUALLY_S) -> Client:
        return Client(self.control, timeout_s=timeout_s)

    def session(self, client: Client, seed: int = 1) -> Session:
        return Session(client, self.bench, self.board, seed, lambda _text: None)

    def start_daemon(self, wait: Callable[[Process, str], Any] = wait_for_daemon) -> None:
        arguments = [*self.program, "run", "--config", str(self.places.out / "station.toml"), "--json"]
        self.daemon = Process("daemon", arguments, self.places.out / "daemon.log", ready_line=False)
        wait(self.daemon, self.control)

    def until(self, holds: Callable[[dict[str, Any]], bool], complaint: str) -> None:
        """Wait until something is true of the simulated station's head or lamps."""
        give_up_s = time.monotonic() + EVENTUALLY_S
        while not holds(self.head()):
            assert time.monotonic() < give_up_s, complaint
            time.sleep(0.01)

    def truth(self) -> dict[str, Any]:
        return self.bench.ask("truth")

    def head(self) -> dict[str, Any]:
        """Return the truth without what lies about the tip: for who asks often."""
        return self.bench.ask("head")

    def truth_start(self) -> dict[str, Any]:
        """Return what was drawn when the simulated station started."""
        start: dict[str, Any] = json.loads((self.places.out / "truth.jsonl").read_text().splitlines()[0])
        return start

    @contextmanager
    def fault(self, name: str, **parameters: Any) -> Iterator[None]:
        """Hold a fault of the simulated station."""
        self.bench.ask("fault", name=name, on=True, **parameters)
        try:
            yield
        finally:
            self.bench.ask("fault", name=name, on=False)


def until_status(holds: Callable[[dict[str, Any]], Any]) -> Callable[[Process, str], None]:
    """Return a wait for a daemon that starts: until what it says of itself holds."""

    def wait(process: Process, control: str) -> None:
        give_up_s = time.monotonic() + STARTED_WITHIN_S
        with Client(control, timeout_s=1.0) as client:
            while time.monotonic() < give_up_s:
                assert process.alive(), process.last_words()
                try:
                    if holds(client.request("status")):
                        return
                except TimeoutError:
                    continue
                time.sleep(0.05)
        raise AssertionError(process.last_words())

    return wait


answering = until_status(lambda _status: True)
"""Waits for the first answer, whatever it says."""
in_fault = until_status(lambda status: status["fault"])
"""Waits for the fault in which a start ends; before that there is none."""
started = until_status(lambda status: status["fault"] or status["state"] == "idle")
"""Waits for the end of a start, whatever it is."""


@contextmanager
def running_rig(
    out: Path,
    *,
    seed: int = 1,
    arguments: tuple[str, ...] = FAST,
    folder: Path = DEMO_BOARD,
    side: Literal["top", "bottom"] = "top",
    waits_for_speed: float = 1.0,
    reply_ms: float = PATIENT_REPLY_MS,
    pictures: Literal["failed", "all", "none"] = "all",
    more_settings: str = "",
    assembled: bool = False,
    program: tuple[str, ...] = PROGRAM,
    electric: bool = False,
) -> Iterator[Rig]:
    """Start the simulated station and a daemon on it; `waits_for_speed` shortens what the daemon waits for by clock.

    `assembled`: parts stand on the board, and the board file knows of them. `electric`: the station has the simulated
    meter, its harness, the reference pad and the brush.
    """
    board = import_board(folder, side, Options(bare=not assembled))
    board.save(out / "board.json")
    with tempfile.TemporaryDirectory(prefix="reprobe-") as sockets:
        places = Places(out, Path(sockets))
        settings = write_settings(places, speed=waits_for_speed, reply_ms=reply_ms, pictures=pictures)
        settings.write_text(settings.read_text() + more_settings)
        sim_arguments = [
            "sim_hw", "--board", str(folder), "--side", side, "--seed", str(seed), "--line", places.line,
            "--camera", places.socket("camera"), "--bench", places.socket("bench"),
            "--truth", str(out / "truth.jsonl"), *arguments, *(("--assembled",) if assembled else ()),
        ]  # fmt: skip
        sim = Process("simulated station", sim_arguments, out / "sim.log", ready_line=True)
        try:
            told = sim.ready()
            bench = DemoBench(told["bench"])
            if electric:
                nets = (point.net for point in board.points)
                more = wiring_toml(nets, bench.ask("circuit")["harness"], told["meter"])
                settings.write_text(settings.read_text() + more)
            rig = Rig(places, board, sim, bench, sim, program, told["meter"])
            try:
                rig.start_daemon()
                yield rig
            finally:
                if rig.daemon is not sim:
                    rig.daemon.end()
                bench.close()
        finally:
            sim.end()
