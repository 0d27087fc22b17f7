"""Run the fault campaign: kills, resets, faults in every state, fuzzed messages; count what must never be.

    python -m tests.bench.faults [--seed S] [--kills N] [--resets N] [--cancels N] [--hangups N] [--disks N]
                                 [--peers N] [--calibrations N] [--rows N] [--messages N]
                                 [--stations N] [--workers N] [--speed X] [--only PART:NUMBER]

A count of 0 leaves a part out. Exit code 1 if a bound is broken or something asked was not done.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
import time
import warnings

# Before OpenCV loads in the stations' processes: the cores are shared out among processes already.
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")

from rich.console import Console

from tests.bench.faults.campaign import PARTS, Plan, run
from tests.bench.faults.table import show

COUNTS = {
    "kills": 200, "resets": 50, "cancels": 30, "hangups": 20, "disks": 12, "peers": 6, "calibrations": 8, "rows": 256,
    "messages": 100_000,
}  # fmt: skip


def arguments(argv: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.faults", description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    for part in PARTS:
        parser.add_argument(f"--{part}", type=int, default=COUNTS[part], help=f"(default: {COUNTS[part]})")
    # More than there are cores: half of an item is waiting, for a lamp that should stay dark or a head on its way.
    parser.add_argument("--stations", type=int, default=3, help="that share the work, seed by seed (default: 3)")
    parser.add_argument("--workers", type=int, default=3, help="stations at a time (default: 3)")
    parser.add_argument("--speed", type=float, default=5.0, help="of the simulated time (default: 5)")
    parser.add_argument("--only", metavar="PART:NUMBER", help="one item, with the same dice; the counts as they were")
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Run, judge, print."""
    asked = arguments(argv)
    # Boards are read by several threads, and putting such a filter on for a while is no thread's own matter.
    warnings.filterwarnings("ignore", category=SyntaxWarning)
    # Ended from outside, each station ends its item and its processes, and the table tells of what was done.
    enough = threading.Event()
    for ends in (signal.SIGTERM, signal.SIGINT):
        signal.signal(ends, lambda *_: enough.set())
    counts = {part: getattr(asked, part) for part in PARTS}
    plan = Plan(asked.seed, counts, asked.stations, asked.workers, asked.speed, asked.only)
    console, began_s = Console(width=None if sys.stdout.isatty() else 150), time.monotonic()
    tally = run(
        plan, lambda text: console.print(f"{time.monotonic() - began_s:6.1f} s {text}", highlight=False), enough
    )
    good = show(console, plan, tally)
    console.print(f"{(time.monotonic() - began_s) / 60:.1f} min")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
