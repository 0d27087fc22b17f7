"""Run methods over scenes, one scene at a time: drawn, shown to every method, reduced to a few numbers, dropped."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import cv2
import numpy as np

from tests.bench.vision.methods import OURS_KNOWN, methods, prepare
from tests.bench.vision.scenes import RIGHT_PX, Artist, Name, PadScene, artists, draw, plan, split

Outcome = Literal["found", "missed", "wrong", "quiet"]


@dataclass(frozen=True)
class Record:
    """What one method said of one scene. ms is process time; bound_px the scene's Cramer-Rao bound (0: none)."""

    task: str
    artist: str
    kind: str
    seed: int
    hard: bool
    defect: bool
    empty: bool
    hidden: float
    noise: float
    method: str
    outcome: Outcome
    dx_px: float
    dy_px: float
    ms: float
    reason: str
    bound_px: float

    @property
    def error_px(self) -> float:
        return float(np.hypot(self.dx_px, self.dy_px))

    @property
    def plain_kind(self) -> str:
        return split(self.kind)[0]


@cache
def artist_of(name: str) -> Artist:
    return artists(name)[0]


def one_thread() -> None:
    """Keep OpenCV to one thread, so that process time is the time of one core."""
    cv2.setNumThreads(1)


def judge(name: Name, repeats: int = 1) -> list[Record]:
    """Draw one scene and return every method's record of it; its time is the median of `repeats`."""
    scene = draw(artist_of(name.artist), name)
    records = []
    for method in methods(name.task):
        if method == OURS_KNOWN and (not isinstance(scene, PadScene) or scene.flat is None):
            continue  # this artist draws no white frame of the same needle
        call = prepare(name.task, method, scene)
        if name.task not in _warm:
            call()
        times = []
        for _ in range(repeats):
            start = time.process_time()
            answer = call()
            times.append(1e3 * (time.process_time() - start))
        records.append(record_of(name, scene, method, answer.at_px, answer.reason, float(np.median(times))))
    _warm.add(name.task)
    return records


# Tasks whose methods have run once in this process: just-in-time compilers and caches are not measured.
_warm: set[str] = set()


def record_of(name: Name, scene: Any, method: str, at: tuple[float, float] | None, reason: str, ms: float) -> Record:
    """Judge an answer by the scene's truth: where it is off, and what that makes of it."""
    truth = scene.truth_px
    dx = dy = float("nan")
    if at is None:
        outcome: Outcome = "quiet" if truth is None else "missed"
    elif truth is None:
        outcome = "wrong"
    else:
        dx, dy = at[0] - truth[0], at[1] - truth[1]
        outcome = "found" if np.hypot(dx, dy) <= RIGHT_PX else "wrong"
    return Record(
        name.task,
        name.artist,
        name.kind,
        name.seed,
        bool(getattr(scene, "hard", False)),
        bool(getattr(scene, "defect", False)),
        truth is None,
        float(getattr(scene, "hidden", 0.0)),
        name.noise,
        method,
        outcome,
        dx,
        dy,
        ms,
        reason,
        float(getattr(scene, "bound_px", 0.0)),
    )


def names_of(task: str, which: str, scenes: int, seed: int) -> list[Name]:
    """Return the names of about `scenes` scenes of a task, shared out among the artists."""
    drawing = artists(which)
    share = max(scenes // len(drawing), 1)
    return [name for artist in drawing for name in plan(artist, task, share, seed)]


def run(names: list[Name], workers: int, repeats: int, on_done: Callable[[], None]) -> Iterator[Record]:
    """Yield the records of all scenes as they come; `on_done` is called once for each scene."""
    if workers == 1:
        one_thread()
        for name in names:
            yield from judge(name, repeats)
            on_done()
        return
    with multiprocessing.get_context("spawn").Pool(workers, one_thread) as pool:
        jobs = ((name, repeats) for name in names)
        for records in pool.imap(_judge, jobs, chunksize=4):
            yield from records
            on_done()


def _judge(job: tuple[Name, int]) -> list[Record]:
    return judge(*job)
