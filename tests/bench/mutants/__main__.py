"""Random small faults in the core files, and how many of them each file's own tests catch.

    python -m tests.bench.mutants [--count 100] [--seed 1] [--files board_alignment.py ...] [--workers 2]

Each mutant is one change at one place, in a temporary copy of the project; a test that fails, hangs or cannot be
imported has caught it. The same seed chooses the same mutants of the same sources. Exit status: 0 if the share caught
is `--least` or more, 1 if it is less, 2 if the tests fail before anything is changed.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from pathlib import Path

from tests.bench.mutants.core_files import chosen
from tests.bench.mutants.report import change, share, table
from tests.bench.mutants.runner import NotSoundError, Outcome, check
from tests.bench.mutants.sampling import sample

ROOT = Path(__file__).parents[3]
NO_SHRINKING = "--hypothesis-profile=first-failure"
"""That a property fails is enough; the simplest example of it is not wanted."""


def main(arguments: list[str] | None = None) -> int:
    """Choose, run, print; return the exit status."""
    asked = _parser().parse_args(arguments)
    planned = sample(ROOT, chosen(asked.files), asked.count, asked.seed)
    print(f"{len(planned)} mutants, seed {asked.seed}", flush=True)
    try:
        outcomes = check(ROOT, planned, asked.workers, asked.timeout_s, _tell, (NO_SHRINKING,))
    except NotSoundError as exc:
        print(exc)
        return 2
    print(f"\n{table(outcomes)}")
    return 0 if share(outcomes) >= asked.least else 1


def _tell(outcome: Outcome) -> None:
    how = "timed out" if outcome.timed_out else "caught" if outcome.caught else "SURVIVED"
    print(f"{how:<9} {outcome.took_s:5.1f} s  {change(outcome)}", flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.mutants", description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=_at_least_one, default=100, help="how many mutants in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--files", nargs="+", default=[], help="ends of paths of core files; default: all of them")
    parser.add_argument("--workers", type=_at_least_one, default=os.cpu_count() or 1, help="copies that work at a time")
    parser.add_argument("--timeout-s", type=float, help="limit of each mutant; default: from the sound file's run")
    parser.add_argument("--least", type=float, default=0.92, help="share that must be caught")
    return parser


def _at_least_one(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("must be 1 or more")
    return number


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # told to end: clean up as on Ctrl-C
    sys.exit(main())
