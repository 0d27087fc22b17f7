"""Run the campaigns: some workers, each with one station at a time, and one station by the clock beside them.

A worker is a thread that waits for answers; the work is done by the two processes of its station.
"""

from __future__ import annotations

import shutil
import threading
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol

from daemon.client import NoAnswer, Refused
from daemon.tools.demo.processes import StartError
from tests.bench.landing.judge import misses
from tests.bench.landing.station import Interrupted, Operator, SetUpFailed, processor_ms
from tests.bench.landing.trials import Question, Record, Setup
from tests.station.rig import Rig, running_rig

REPLY_MS = 1500.0
"""Stations share the cores, and a process that waits for its turn is no lost link."""
BROKEN = (StartError, Refused, NoAnswer, OSError, ValueError)


@dataclass(frozen=True)
class Plan:
    """What to run."""

    board: Path
    side: Literal["top", "bottom"]
    out: Path
    trials: int
    stations: int
    seed: int
    speed: float
    workers: int
    steps: tuple[str, ...]
    keep_failed: bool


@dataclass(frozen=True)
class Batch:
    """One station's share. `by_clock`: no trials, only the time that its set-up takes."""

    seed: int
    trials: int
    by_clock: bool = False

    @property
    def name(self) -> str:
        """Name of its folder and in the progress display."""
        return f"station-{self.seed}{'-by-clock' if self.by_clock else ''}"


class Watcher(Protocol):
    """Whoever is told what happens; called from several threads, one at a time."""

    def doing(self, batch: Batch, text: str) -> None:
        """A station begins something."""

    def took(self, batch: Batch, record: Record) -> None:
        """There is a record."""

    def ended(self, batch: Batch) -> None:
        """A station is over."""


def batches(plan: Plan) -> list[Batch]:
    """Share the trials out among stations, the seeds following on."""
    stations = min(plan.stations, plan.trials)
    shares = [plan.trials // stations + (k < plan.trials % stations) for k in range(stations)]
    return [Batch(plan.seed + k, share) for k, share in enumerate(shares)]


def run(plan: Plan, watcher: Watcher) -> None:
    """Run all of it; whatever ends it early, the stations' processes are ended too."""
    stop, speaking = threading.Event(), threading.Lock()
    clocked = [Batch(plan.seed, 0, by_clock=True)] if "rotation" in plan.steps else []
    with ThreadPoolExecutor(1) as beside, ThreadPoolExecutor(plan.workers) as workers:
        futures = [beside.submit(run_station, plan, batch, watcher, speaking, stop) for batch in clocked]
        futures += [workers.submit(run_station, plan, batch, watcher, speaking, stop) for batch in batches(plan)]
        try:
            for future in as_completed(futures):
                future.result()
        except BaseException:
            stop.set()
            raise


def run_station(plan: Plan, batch: Batch, watcher: Watcher, speaking: threading.Lock, stop: threading.Event) -> None:
    """Run one station from its start to its end and tell what came of it."""
    if stop.is_set():
        return
    folder = plan.out / batch.name
    shutil.rmtree(folder, ignore_errors=True)  # its journal would answer for what was run before
    folder.mkdir(parents=True)
    told = _Told(batch, watcher, speaking)
    try:
        _Run(plan, batch, folder, told, stop).go()
    finally:
        if not told.trouble:
            shutil.rmtree(folder, ignore_errors=True)
        with speaking:
            watcher.ended(batch)


class _Told:
    """Tell the watcher, one thread at a time, and remember whether anything is worth keeping."""

    def __init__(self, batch: Batch, watcher: Watcher, speaking: threading.Lock) -> None:
        self._batch, self._watcher, self._speaking = batch, watcher, speaking
        self.trouble = False

    def doing(self, text: str) -> None:
        with self._speaking:
            self._watcher.doing(self._batch, text)

    def took(self, record: Record) -> None:
        bad = record.broken is not None if isinstance(record, Setup) else bool(misses([record]))
        self.trouble = self.trouble or bad
        with self._speaking:
            self._watcher.took(self._batch, record)


class _Run:
    """One station's life."""

    def __init__(self, plan: Plan, batch: Batch, folder: Path, told: _Told, stop: threading.Event) -> None:
        self._plan, self._batch, self._folder, self._told, self._stop = plan, batch, folder, told, stop
        self._known = Setup(batch.seed, batch.by_clock, 1.0 if batch.by_clock else plan.speed)

    def go(self) -> None:
        """Set up, try, and leave one record of the set-up, whatever came."""
        try:
            self._live()
        except SetUpFailed as exc:
            self._learn(steps=exc.steps, broken=str(exc))
        except Interrupted:
            return
        except BROKEN as exc:
            self._learn(broken=f"{type(exc).__name__}: {exc}")
        self._told.took(self._known)

    def _learn(self, **changes: Any) -> None:
        self._known = replace(self._known, **changes)

    def _live(self) -> None:
        plan, batch, speed = self._plan, self._batch, self._known.speed
        arguments = () if batch.by_clock else ("--unpaced", "--speed", f"{speed:g}")
        steps = plan.steps[: plan.steps.index("rotation") + 1] if batch.by_clock else plan.steps
        with ExitStack() as stack:
            self._told.doing("starting")
            rig = stack.enter_context(
                running_rig(
                    self._folder, seed=batch.seed, arguments=arguments, folder=plan.board, side=plan.side,
                    waits_for_speed=speed, reply_ms=REPLY_MS, pictures="failed" if plan.keep_failed else "none",
                )
            )  # fmt: skip
            operator = Operator(rig, stack.enter_context(rig.client()), plan.board, batch.seed, self._stop)
            self._learn(steps=tuple(operator.set_up(steps, self._told.doing)))
            self._told.doing("trials" if batch.trials else "ending")
            self._try_all(operator, rig)

    def _try_all(self, operator: Operator, rig: Rig) -> None:
        """Run the trials and book what they cost."""
        pids = rig.sim.pid, rig.daemon.pid
        began_s, began_ms = time.monotonic(), [processor_ms(pid) for pid in pids]
        self._learn(setup_ms=round(sum(began_ms)))
        for index in range(self._batch.trials):
            if self._stop.is_set():
                raise Interrupted
            self._told.took(operator.run(Question.drawn(self._batch.seed, index, operator.test_points)))
            sim_ms, daemon_ms = (round(processor_ms(pid) - ms) for pid, ms in zip(pids, began_ms, strict=True))
            took_s = round(time.monotonic() - began_s, 2)
            self._learn(trials=index + 1, trials_s=took_s, sim_ms=sim_ms, daemon_ms=daemon_ms)
