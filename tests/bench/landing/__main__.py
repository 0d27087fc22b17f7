"""Run the landing campaigns: set up simulated stations, land, correct, and judge every landing by the truth.

    python -m tests.bench.landing [--trials N] [--stations N] [--workers N] [--seed S] [--speed X]
                                  [--board DIR --side top|bottom] [--steps home,tip,map,...]
                                  [--out DIR] [--no-plots] [--keep-failed] [--judge FILE]

Exit code 1 if a bound is missed, 2 if the campaigns cannot be run.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
import warnings
from pathlib import Path
from typing import NoReturn

# Before OpenCV loads in the stations' processes: the cores are shared out among processes already.
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")

from rich.console import Console

from sim_hw import __file__ as sim_file
from tests.bench.landing import judge, table
from tests.bench.landing.campaign import Plan, run
from tests.bench.landing.progress import Display
from tests.bench.landing.station import STEPS
from tests.bench.landing.trials import Record, read_lines, split

MISSED, USAGE = 1, 2
TRIALS = 5000
"""A claim of 99.94 % needs 4,992 trials without a miss to be 95 % sure."""
OWN_BOARD = Path(sim_file).parent / "demo_board"


def arguments(argv: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.landing", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--trials", type=_positive, help=f"in all (default: {TRIALS}; with --judge: as many as there are)"
    )
    parser.add_argument("--stations", type=_positive, default=10, help="that share them, seed by seed (default: 10)")
    parser.add_argument("--workers", type=_positive, default=5, help="stations at a time (default: 5)")
    parser.add_argument("--seed", type=int, default=1, help="of the first station (default: 1)")
    parser.add_argument("--speed", type=_speed, default=8.0, help="of the simulated time (default: 8)")
    parser.add_argument("--board", type=Path, default=OWN_BOARD, help="CAD folder (default: the demonstration's board)")
    parser.add_argument("--side", default="top", choices=["top", "bottom"])
    parser.add_argument("--steps", type=_steps, default=STEPS, help=f"of the set-up (default: {','.join(STEPS)})")
    parser.add_argument("--out", type=Path, default=Path("out/landing"), help="folder of the results")
    parser.add_argument("--plots", action=argparse.BooleanOptionalAction, default=True, help="draw (bench group)")
    parser.add_argument("--keep-failed", action="store_true", help="keep the pictures of failed corrections")
    parser.add_argument("--judge", type=Path, metavar="FILE", help="run nothing: judge the results in FILE again")
    return parser.parse_args(argv)


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"at least 1, not {value}")
    return value


def _speed(text: str) -> float:
    value = float(text)
    if not 1.0 <= value <= 100.0:
        raise argparse.ArgumentTypeError(f"1 to 100, not {value:g}")
    return value


def _steps(text: str) -> tuple[str, ...]:
    steps = tuple(text.split(","))
    unknown = [step for step in steps if step not in STEPS]
    if unknown:
        raise argparse.ArgumentTypeError(f"unknown {', '.join(unknown)}; known: {', '.join(STEPS)}")
    return steps


def main(argv: list[str] | None = None) -> int:
    """Run, judge, print, draw."""
    asked = arguments(argv)
    console = Console(width=None if sys.stdout.isatty() else 150)
    # Boards are read by several threads, and putting such a filter on for a while is no thread's own matter.
    warnings.filterwarnings("ignore", category=SyntaxWarning)
    # Ended from outside, it still ends the processes it started.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(MISSED))
    if asked.judge:
        records, count = _read(asked.judge), asked.trials
    else:
        if not asked.board.is_dir():
            _refuse(f"--board: {asked.board} is not a folder")
        count = asked.trials or TRIALS
        records = _run(asked, count, console)
    trials, setups = split(records)
    verdicts = judge.judge(trials, setups, count or len(trials))
    table.show(console, trials, setups, verdicts)
    if asked.plots:
        from tests.bench.landing import plots

        for path in plots.draw_all(asked.out, trials):
            console.print(f"plot: {path}", highlight=False, soft_wrap=True)
    return 0 if judge.passed(verdicts) else MISSED


def _read(path: Path) -> list[Record]:
    try:
        return read_lines(path)
    except (OSError, ValueError) as exc:
        _refuse(f"--judge: {exc}")


def _run(asked: argparse.Namespace, trials: int, console: Console) -> list[Record]:
    """Run the campaigns; the records are on disk as they come."""
    asked.out.mkdir(parents=True, exist_ok=True)
    results = asked.out / "results.jsonl"
    plan = Plan(
        asked.board.resolve(), asked.side, asked.out.resolve(), trials, asked.stations, asked.seed, asked.speed,
        asked.workers, asked.steps, asked.keep_failed,
    )  # fmt: skip
    started_s = time.monotonic()
    with results.open("w", encoding="utf-8") as lines, Display(Console(stderr=True), lines, plan.trials) as display:
        try:
            run(plan, display)
        except KeyboardInterrupt:
            console.print("interrupted: what ran so far is judged", style="yellow")
    minutes = (time.monotonic() - started_s) / 60.0
    done = len(split(display.records)[0])
    console.print(f"{done} trials in {minutes:.1f} min, results: {results}", highlight=False, soft_wrap=True)
    return display.records


def _refuse(message: str) -> NoReturn:
    sys.stderr.write(f"landing: {message}\n")
    raise SystemExit(USAGE)


if __name__ == "__main__":
    sys.exit(main())
