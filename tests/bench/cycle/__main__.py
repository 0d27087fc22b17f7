"""Measure place, correct and touch at real time, and print them beside the floor of their own facts.

    make bench-cycle
    python -m tests.bench.cycle [--rounds N] [--keep FOLDER] [--safe-height] [--no-seat]

The load of the machine is printed beside: seconds count on a quiet one only, requests and bytes on any.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from tests.bench.cycle import table
from tests.bench.cycle.station import bench


def say(text: str) -> None:
    """Tell how far it is."""
    sys.stderr.write(f"{text}\n")


def load() -> str:
    """Return the machine's load of the last minute beside its cores."""
    return f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"


def measure(out: Path, rounds: int, *, clearance: bool, seat: bool) -> None:
    """Measure and print."""
    before = load()
    with bench(out, say, clearance=clearance, seat=seat) as station:
        cycles = list(station.cycles(rounds))
    print(f"load of the machine: {before} before, {load()} after; times in ms, medians\n")
    if not cycles:
        raise SystemExit("nothing was measured: every round ended in an error")
    for part in (table.summary(cycles), table.where(cycles), table.asked(cycles)):
        print("\n".join(part) + "\n")


def main() -> None:
    """Read the arguments and measure."""
    options = argparse.ArgumentParser(prog="python -m tests.bench.cycle")
    options.add_argument("--rounds", type=int, default=12, help="of place, correct and touch")
    options.add_argument("--keep", type=Path, help="folder for logs, truth and the line's record; none: thrown away")
    options.add_argument("--safe-height", action="store_true", help="no figures of the head: the safe height for all")
    options.add_argument("--no-seat", action="store_true", help="head and seat stay uncalibrated: ready minutes sooner")
    chosen = options.parse_args()
    if chosen.rounds < 1:
        options.error("--rounds: at least 1")
    if chosen.keep is not None:
        chosen.keep.mkdir(parents=True, exist_ok=True)
        measure(chosen.keep, chosen.rounds, clearance=not chosen.safe_height, seat=not chosen.no_seat)
        return
    with tempfile.TemporaryDirectory() as name:
        measure(Path(name), chosen.rounds, clearance=not chosen.safe_height, seat=not chosen.no_seat)


if __name__ == "__main__":
    main()
