"""Simulated station with its daemon, set up and ready to probe, for tests that are written without a real one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from daemon.domain.board import Board
from daemon.tools.board_import import Options, import_board
from daemon.tools.demo.processes import DemoBench, StartError
from daemon.tools.demo.running import Bench, running
from daemon.tools.demo.session import Session
from daemon.tools.demo.settings import Places

ANGLES = 24
"""At which the head's rotation is calibrated."""
SPEED = 3.0


@dataclass(frozen=True)
class Simulated:
    """A station that runs: where its daemon listens, and its bench, by which things are broken."""

    control: str
    board: Board
    bench: DemoBench


def own_board() -> Board:
    """Return the board that lies in the simulated station."""
    return import_board(_folder(), "top", Options(keep=False, bare=True))


@contextmanager
def simulated_station(out: Path, seed: int = 1, say: Callable[[str], None] = lambda _text: None) -> Iterator[Simulated]:
    """Start station and daemon, set them up as a person would, and end them; `out` is an empty folder.

    Raises:
        StartError: a process did not come up.
        SetUpError: a step of the set-up failed.

    """
    board = own_board()
    board.save(out / "board.json")
    wish = Bench(_folder(), assembled=False, seed=seed, speed=SPEED, paced=False)
    with TemporaryDirectory(prefix="reprobe-") as sockets:
        places = Places(out, Path(sockets))
        say("starting the simulated station and the daemon")
        with running(places, board, wish) as station:
            session = Session(station.client, station.bench, board, seed, say)
            session.set_up()
            session.calibrate_fully(ANGLES)
            yield Simulated(places.socket("control"), board, station.bench)


def _folder() -> Path:
    """Return the folder of the board that comes along; its package is found, not imported."""
    spec = find_spec("sim_hw")
    if spec is None or spec.origin is None:
        raise StartError("the simulated station is not installed: pip install 'reprobe[sim]'")
    return Path(spec.origin).parent / "demo_board"
