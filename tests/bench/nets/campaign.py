"""Run the campaign: some workers, each with one station at a time.

A worker is a thread that waits for answers; the work is done by the two processes of its station.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from daemon.client import NoAnswer, Refused
from daemon.tools.demo.processes import StartError
from tests.bench.landing.campaign import REPLY_MS
from tests.bench.landing.station import Interrupted, SetUpFailed
from tests.bench.nets.boards import BoardKind
from tests.bench.nets.by_run import ByRun, RunFailed
from tests.bench.nets.faulted import Faulted
from tests.bench.nets.records import Record, Station
from tests.bench.nets.station import Shares, Tester
from tests.station.rig import Rig, running_rig

TILES = "250"
"""A station's picture of its board may take a gigabyte: drawing a large board again for each place takes the time."""
SENSE = '\n[sense]\nkind = "drive_input"\n'
BROKEN = (StartError, Refused, NoAnswer, SetUpFailed, RunFailed, OSError, ValueError, AssertionError)


@dataclass(frozen=True)
class Plan:
    """What to run. `by`: each point by a job of its own (`probe`), or a board's points by one `run`."""

    kinds: tuple[BoardKind, ...]
    out: Path
    points: int
    per_board: int
    seed: int
    speed: float
    workers: int
    kills: int
    shares: Shares
    by: str = "probe"
    faults: int = 0
    boards: int | None = None
    """Boards to be tested, each at all its points up to `per_board`; None: as many as the points take."""


@dataclass(frozen=True)
class Batch:
    """One station's share."""

    seed: int
    kind: BoardKind
    points: int
    kills: int
    faults: int = 0
    boards: int | None = None

    def goes_on(self, known: Station) -> bool:
        """Tell whether another board is to be laid in."""
        return known.points < self.points if self.boards is None else known.boards < self.boards

    def kills_in(self, board: int, per_board: int) -> bool:
        """Tell whether the daemon is killed in a board's test, counted from 0: the kills are spread over the boards."""
        boards = self.boards or -(-self.points // per_board)
        return (board + 1) * self.kills // boards > board * self.kills // boards


Tell = Callable[[Batch, Record | str], None]
"""Told what a station does, and every record; called from several threads, one at a time."""


def batches(plan: Plan) -> list[Batch]:
    """Share points and kills out among the boards, each on a station of its own."""
    n = min(len(plan.kinds), plan.points if plan.boards is None else plan.boards)

    def share(of: int, k: int) -> int:
        return of // n + (k < of % n)

    return [
        Batch(plan.seed + k, plan.kinds[k], share(plan.points, k), share(plan.kills, k), share(plan.faults, k),
              None if plan.boards is None else share(plan.boards, k))
        for k in range(n)
    ]  # fmt: skip


def run(plan: Plan, tell: Tell) -> None:
    """Run all of it; whatever ends it early, the stations' processes are ended too."""
    stop, speaking = threading.Event(), threading.Lock()

    def told(batch: Batch, what: Record | str) -> None:
        with speaking:
            tell(batch, what)

    with ThreadPoolExecutor(plan.workers) as workers:
        futures = [workers.submit(_station, plan, batch, told, stop) for batch in batches(plan)]
        try:
            for future in as_completed(futures):
                future.result()
        except BaseException:
            stop.set()
            raise


def _station(plan: Plan, batch: Batch, tell: Tell, stop: threading.Event) -> None:
    """Run one station; what it leaves on disk is kept where anything went wrong."""
    if stop.is_set():
        return
    folder = plan.out / f"station-{batch.seed}"
    shutil.rmtree(folder, ignore_errors=True)  # its journal would answer for what was run before
    folder.mkdir(parents=True)
    began_s = time.monotonic()
    life = _Life(plan, batch, folder, tell, stop)
    try:
        life.live()
    except Interrupted:
        pass
    except BROKEN as exc:
        life.learn(broken=f"{type(exc).__name__}: {exc}")
    life.learn(wall_s=round(time.monotonic() - began_s, 1))
    tell(batch, life.known)


class _Life:
    """One station's life; `known` is how far it came."""

    def __init__(self, plan: Plan, batch: Batch, folder: Path, tell: Tell, stop: threading.Event) -> None:
        self._plan, self._batch, self._folder, self._tell, self._stop = plan, batch, folder, tell, stop
        self.known = Station(batch.seed, batch.kind.name)
        self._by_run: ByRun | None = None

    def learn(self, **changes: Any) -> None:
        """Add to what is known."""
        self.known = replace(self.known, **changes)

    def live(self) -> None:
        """Set up, and test board after board."""
        with ExitStack() as stack:
            self._tell(self._batch, "starting")
            rig = stack.enter_context(_rig(self._plan, self._batch, self._folder))
            tester = Tester(rig, stack.enter_context(rig.client()), self._batch.kind, self._batch.seed, self._stop,
                            self._plan.speed)  # fmt: skip
            self.known, began_s = tester.station(), time.monotonic()
            self._by_run = ByRun(tester, self._batch.seed, self._stop) if self._plan.by == "run" else None
            self._tell(self._batch, "setting up")
            tester.set_up(self._plan.shares)
            self.learn(set_up_s=round(time.monotonic() - began_s, 1))
            while self._batch.goes_on(self.known):
                self._test_board(tester)

    def _test_board(self, tester: Tester) -> None:
        self._tell(self._batch, f"board {self.known.boards + 1}")
        tester.next_board()
        left = self._plan.per_board if self._batch.boards else self._batch.points - self.known.points
        points = tester.points(min(self._plan.per_board, left))
        if not points:
            raise ValueError(f"no point of {self._batch.kind.name} is reached by head and harness")
        kill = self._batch.kills_in(self.known.boards, self._plan.per_board)
        tests = self._by_run if self._by_run is not None else tester
        for visit in tests.test(points, kill=kill):
            self._tell(self._batch, visit)
            self.learn(points=self.known.points + (not visit.killed))
        if self.known.boards < self._batch.faults:
            self._tell(self._batch, Faulted(tester, self._batch.seed, self._stop).test(points[-1], self.known.boards))
        self.learn(boards=self.known.boards + 1, kills=self.known.kills + kill)


def _rig(plan: Plan, batch: Batch, folder: Path) -> AbstractContextManager[Rig]:
    return running_rig(
        folder, seed=batch.seed, arguments=("--unpaced", "--speed", f"{plan.speed:g}", "--tiles", TILES),
        folder=batch.kind.folder, side=batch.kind.side, assembled=batch.kind.assembled, waits_for_speed=plan.speed,
        reply_ms=REPLY_MS, pictures="failed", electric=True, more_settings=SENSE,
    )  # fmt: skip
