"""Simulated station and daemon, wired and started as two processes, ended whatever happens.

A demonstration runs on them, and so do tests of those who have no station.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from daemon.client import Client
from daemon.domain.board import Board
from daemon.tools.demo.processes import DemoBench, Process, wait_for_daemon
from daemon.tools.demo.settings import Places, write_settings
from daemon.tools.demo.wiring import wiring_toml

JOURNAL = Path("station", "journal.sqlite")
"""Of the daemon, below the demonstration's folder."""
ANSWER_WITHIN_S = 20.0
REPLY_MS = 1000.0
"""A demonstration shares its computer with whatever else runs there; a drive that answers late is no dead one."""


@dataclass(frozen=True)
class Bench:
    """What lies on the simulated bench, and how fast its time runs."""

    folder: Path
    """Of the board's CAD."""
    assembled: bool
    seed: int
    speed: float
    paced: bool = True
    """Whether bytes take their time on the line, as at its baud rate."""


@dataclass(frozen=True)
class Running:
    """The two processes, a client of the one, and the bench socket of the other."""

    client: Client
    bench: DemoBench
    daemon: Process
    settings: Path


@contextmanager
def running(
    places: Places, board: Board, wish: Bench, held: Callable[[], AbstractContextManager[None]] = nullcontext
) -> Iterator[Running]:
    """Hold both; `held` is entered round each start, so that nobody is told to end between it and the promise to.

    Raises StartError where a process does not come up.
    """
    settings = write_settings(places, speed=wish.speed, reply_ms=REPLY_MS, pictures="failed")
    with ExitStack() as stack:

        def start(name: str, arguments: list[str], log: str, *, ready_line: bool) -> Process:
            with held():
                process = Process(name, arguments, places.out / log, ready_line=ready_line)
                stack.callback(process.end)
            return process

        told = start("simulated station", _sim_arguments(places, board.side, wish), "sim.log", ready_line=True).ready()
        bench = DemoBench(told["bench"])
        stack.callback(bench.close)
        nets = (point.net for point in board.points)
        wiring = wiring_toml(nets, bench.ask("circuit")["harness"], told["meter"])
        settings.write_text(settings.read_text() + wiring)
        arguments = ["daemon.cli", "serve", "--config", str(settings), "--json"]
        daemon = start("daemon", arguments, "daemon.log", ready_line=False)
        wait_for_daemon(daemon, places.socket("control"))
        with Client(places.socket("control"), timeout_s=ANSWER_WITHIN_S) as client:
            yield Running(client, bench, daemon, settings)


def _sim_arguments(places: Places, side: str, wish: Bench) -> list[str]:
    arguments = [
        "sim_hw", "--board", str(wish.folder), "--side", side, "--seed", str(wish.seed), "--speed", str(wish.speed),
        "--line", places.line, "--camera", places.socket("camera"), "--bench", places.socket("bench"),
        "--truth", str(places.out / "truth.jsonl"),
    ]  # fmt: skip
    arguments += [] if wish.paced else ["--unpaced"]
    return [*arguments, "--assembled"] if wish.assembled else arguments
