"""What a correction costs in this tree beside another one: each a station of its own, corrections by turns.

    python -m tests.bench.side_by_side OTHER_TREE [--pairs N] [--seed S]

`OTHER_TREE`: another version of the project. Both simulated stations have the same seed and run at the clock's
pace. Each pair is one correction here and one there, from the same placement; both orders occur equally often, so that
what else this computer does falls on both. Prints the difference of the pairs with a bootstrap interval, whole and by
what the time went into; judges nothing.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).parents[2]
DRAWS, SHARE = 4000, 0.95
POINT = "TP7"


class Tree:
    """A station of one tree, worked by a process that has loaded that tree's modules."""

    def __init__(self, root: Path, seed: int) -> None:
        # Without the folder of this file on the path: nothing of this tree may get into the other
        command = [sys.executable, "-P", str(Path(__file__).resolve()), "--work", "--seed", str(seed)]
        environment = {**os.environ, "PYTHONPATH": str(root)}
        self._process = subprocess.Popen(
            command, cwd=root, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ready(self) -> None:
        """Wait until the station is set up."""
        self._hear()

    def correct(self, n: int, theta_deg: float) -> dict[str, Any]:
        """Place and correct once; return the correction's times, ms."""
        self._process.stdin.write(json.dumps([n, theta_deg]) + "\n")  # type: ignore[union-attr]
        self._process.stdin.flush()  # type: ignore[union-attr]
        return self._hear()

    def close(self) -> None:
        """End the station."""
        self._process.stdin.close()  # type: ignore[union-attr]
        self._process.wait()

    def _hear(self) -> dict[str, Any]:
        line = self._process.stdout.readline()  # type: ignore[union-attr]
        if not line:
            raise SystemExit("a station ended")
        told: dict[str, Any] = json.loads(line)
        return told


def work(seed: int) -> None:
    """Be the process of one tree: set a station up, then correct for each line that comes in."""
    from tests.station.rig import running_rig  # of the tree that this process belongs to

    with (
        tempfile.TemporaryDirectory() as out,
        running_rig(Path(out), seed=seed, arguments=()) as rig,
        rig.client(120.0) as client,
    ):
        rig.session(client).set_up()
        print("{}", flush=True)
        for line in sys.stdin:
            n, theta_deg = json.loads(line)
            placed = client.job("place", test_point=POINT, theta_deg=theta_deg)
            began_s = time.perf_counter()
            result = client.job("correct", job_id=f"pair-{n}", test_point=POINT)
            whole_ms = (time.perf_counter() - began_s) * 1e3
            for one in (placed, result):
                if one.error is not None:
                    raise SystemExit(f"{one.op} failed: {one.error.message}; {one.error.advice}")
            rows = result.timing_ms.values()
            parts = {name for row in rows for name in row if name != "total"}
            spent = {name: sum(row.get(name, 0.0) for row in rows) for name in parts}
            print(json.dumps({"looks": result.looks, "whole": whole_ms, **spent}), flush=True)


def interval(differences: Sequence[float], dice: random.Random) -> tuple[float, float]:
    """Return the bootstrap interval of the median."""
    medians = sorted(statistics.median(dice.choices(differences, k=len(differences))) for _ in range(DRAWS))
    left_out = round(DRAWS * (1 - SHARE) / 2)
    return medians[left_out], medians[-1 - left_out]


def main() -> None:
    """Run the pairs and print."""
    options = argparse.ArgumentParser(prog="python -m tests.bench.side_by_side")
    options.add_argument("other", type=Path, nargs="?")
    options.add_argument("--pairs", type=int, default=40)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    asked = options.parse_args()
    if asked.work:
        work(asked.seed)
        return
    if asked.other is None or not (asked.other / "tests" / "station" / "rig.py").is_file():
        options.error("name the folder of another version of the project")
    dice = random.Random(asked.seed)
    trees = (Tree(HERE, asked.seed), Tree(asked.other.resolve(), asked.seed))
    try:
        for tree in trees:
            tree.ready()
        pairs = []
        for n in range(asked.pairs):
            theta_deg, order = dice.uniform(0.0, 100.0), (0, 1) if n % 2 else (1, 0)
            told = {which: trees[which].correct(n, theta_deg) for which in order}
            pairs.append((told[0], told[1]))
    finally:
        for tree in trees:
            tree.close()
    show(pairs, dice)


def show(pairs: Sequence[tuple[dict[str, Any], dict[str, Any]]], dice: random.Random) -> None:
    """Print the differences of the pairs that took equally many looks."""
    alike = [(here, there) for here, there in pairs if here["looks"] == there["looks"]]
    print(f"{len(pairs)} pairs, {len(alike)} of them with equally many looks; ms, this tree minus the other")
    for name in ("whole", *sorted({key for pair in alike for one in pair for key in one} - {"whole", "looks"})):
        here, there = ([pair[side].get(name, 0.0) for pair in alike] for side in (0, 1))
        differences = [a - b for a, b in zip(here, there, strict=True)]
        low, high = interval(differences, dice)
        print(
            f"{name:>10}: {statistics.median(here):7.1f} and {statistics.median(there):7.1f}; "
            f"of pairs {statistics.median(differences):+6.1f}, {SHARE:.0%} within {low:+.1f} .. {high:+.1f}"
        )


if __name__ == "__main__":
    main()
