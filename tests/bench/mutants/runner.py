"""The runs: sound tests first, for a limit of time, then one mutant after the other in as many copies as asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import TypeVar

from tests.bench.mutants.core_files import CoreFile
from tests.bench.mutants.operators import Mutant
from tests.bench.mutants.workshop import Workshop

T = TypeVar("T")
SLOWER, SLACK_S = 4.0, 10.0
"""A mutant may take so many times as long as the sound file and so much more; then its tests hang."""
SOUND_WITHIN_S = 600.0


class NotSoundError(Exception):
    """Say that a file's tests fail before anything is changed, or that it has none."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one mutant."""

    core: CoreFile
    mutant: Mutant
    caught: bool
    timed_out: bool
    took_s: float


def check(
    root: Path,
    planned: Sequence[tuple[CoreFile, Mutant]],
    workers: int,
    limit_s: float | None,
    tell: Callable[[Outcome], None],
    options: tuple[str, ...] = (),
) -> list[Outcome]:
    """Run every planned mutant, in the order given; return what came of each.

    `limit_s`: of each mutant; None takes it from the sound run of each file. `options` go to pytest.
    Raises NotSoundError where the unchanged file's tests do not pass. An interrupt kills what runs and removes the
    copies.
    """
    files = list(dict.fromkeys(core for core, _ in planned))
    missing = [path for core in files for path in core.tests if not (root / path).exists()]
    if missing:
        raise NotSoundError(f"there is no {', no '.join(missing)}; tests/bench/mutants/core_files.py names them")
    with ExitStack() as stack:
        shops = [stack.enter_context(Workshop(root, options)) for _ in range(max(1, min(workers, len(planned))))]
        free: SimpleQueue[Workshop] = SimpleQueue()
        for shop in shops:
            free.put(shop)
        pool = stack.enter_context(ThreadPoolExecutor(len(shops)))
        try:
            sound = pool.map(lambda core: _in_one_of(free, lambda shop: _limit_s(shop, core, limit_s)), files)
            limits = dict(zip(files, sound, strict=True))
            outcomes = []
            runs = pool.map(
                lambda one: _in_one_of(free, lambda shop: _outcome(shop, one[0], one[1], limits[one[0]])), planned
            )
            for outcome in runs:
                tell(outcome)
                outcomes.append(outcome)
            return outcomes
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for shop in shops:
                shop.kill()
            raise


def _in_one_of(free: SimpleQueue[Workshop], work: Callable[[Workshop], T]) -> T:
    shop = free.get()
    try:
        return work(shop)
    finally:
        free.put(shop)


def _limit_s(shop: Workshop, core: CoreFile, limit_s: float | None) -> float:
    """Run a sound file's tests and return how long a mutant's may take."""
    run = shop.run(core, None, SOUND_WITHIN_S)
    if not run.passed:
        raise NotSoundError(f"{core.path}: its tests do not pass as it is\n{run.output[-3000:]}")
    return limit_s or SLOWER * run.took_s + SLACK_S


def _outcome(shop: Workshop, core: CoreFile, mutant: Mutant, limit_s: float) -> Outcome:
    run = shop.run(core, mutant, limit_s)
    return Outcome(core, mutant, not run.passed, run.status is None, run.took_s)
