"""Test whole boards on simulated stations, and judge every verdict by the truth.

    python -m tests.bench.nets [--points N] [--seed S] [--workers N] [--by probe|run] [--kills N] [--faults N]
                               [--boards demo,glasgow-top,...] [--per-board N] [--speed X] [--opens 0.01]
                               [--unattended [BOARDS]]
                               [--out DIR] [--judge FILE]

Exit code 1 if a bound is missed, 2 if the campaign cannot be run.
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

from tests.bench.nets import judge, table
from tests.bench.nets.boards import KINDS, BoardKind, known
from tests.bench.nets.campaign import Batch, Plan, run
from tests.bench.nets.records import Record, Station, Visit, read_lines, to_line
from tests.bench.nets.station import Shares

MISSED, USAGE = 1, 2
POINTS, BOARDS = 20_000, 200


def arguments(argv: list[str] | None = None) -> argparse.Namespace:
    """Return what was asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.nets", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--points", type=_positive, help=f"in all (default: {POINTS}; with --judge: as many as there are)"
    )
    parser.add_argument(
        "--boards", type=_kinds, default=None, help=f"of {','.join(kind.name for kind in KINDS)} (default: all)"
    )
    parser.add_argument("--per-board", type=_positive, default=100, help="points of each board laid in (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="of the first station (default: 1)")
    parser.add_argument("--workers", type=_positive, default=2, help="stations at a time (default: 2)")
    parser.add_argument("--kills", type=int, default=0, help="boards in whose test the daemon is killed (default: 0)")
    parser.add_argument(
        "--faults", type=int, default=0, help="boards after which a fault comes into a test (default: 0)"
    )
    parser.add_argument("--speed", type=_speed, default=6.0, help="of the simulated time (default: 6)")
    parser.add_argument("--by", choices=["probe", "run"], default="probe", help="a job a point, or a run a board")
    parser.add_argument(
        "--unattended", type=_positive, nargs="?", const=BOARDS, metavar="BOARDS",
        help=f"so many boards ({BOARDS}), each by a run, the daemon killed in each tenth; not with points, kills or by",
    )  # fmt: skip
    for name, text in (("misplaced", "ways that end up to 400 um aside"), ("oxide", "pads with a film"),
                       ("stubborn", "pads with a film that hardly breaks"), ("debris", "touches that soil the needle"),
                       ("opens", "nets with a broken trace")):  # fmt: skip
        default = getattr(Shares(), _KNOBS[name])
        parser.add_argument(f"--{name}", type=_share, default=default, help=f"share of {text} (default: {default:g})")
    parser.add_argument("--out", type=Path, default=Path("out/nets"), help="folder of the results")
    parser.add_argument("--judge", type=Path, metavar="FILE", help="run nothing: judge the results in FILE again")
    asked = parser.parse_args(argv)
    if asked.unattended:
        if asked.points or asked.kills:
            parser.error("--unattended brings its own number of points and kills")
        asked.by, asked.kills = "run", asked.unattended // judge.EACH
    return asked


_KNOBS = {"misplaced": "misplaced_share", "oxide": "oxide_share", "stubborn": "stubborn_share",
          "debris": "debris_share", "opens": "open_share"}  # fmt: skip


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"at least 1, not {value}")
    return value


def _share(text: str) -> float:
    value = float(text)
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"0 to 1, not {value:g}")
    return value


def _speed(text: str) -> float:
    value = float(text)
    if not 1.0 <= value <= 100.0:
        raise argparse.ArgumentTypeError(f"1 to 100, not {value:g}")
    return value


def _kinds(text: str) -> tuple[BoardKind, ...]:
    try:
        return tuple(known(name) for name in text.split(","))
    except ValueError as exc:
        raise argparse.ArgumentTypeError(str(exc)) from exc


def main(argv: list[str] | None = None) -> int:
    """Run, judge, print."""
    asked = arguments(argv)
    console = Console(width=None if sys.stdout.isatty() else 170)
    # Boards are read by several threads, and putting such a filter on for a while is no thread's own matter.
    warnings.filterwarnings("ignore", category=SyntaxWarning)
    # Ended from outside, it still ends the processes it started.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(MISSED))
    if asked.judge:
        try:
            records = read_lines(asked.judge)
        except (OSError, ValueError) as exc:
            _refuse(f"--judge: {exc}")
        count = asked.points
    else:
        count = asked.points or (None if asked.unattended else POINTS)
        records = _run(asked, count, console)
    visits, stations = judge.split(records)
    rows = judge.judge(visits, stations, count or sum(not one.killed for one in visits), asked.unattended)
    table.show(console, visits, stations, rows)
    return 0 if judge.passed(rows) else MISSED


def _run(asked: argparse.Namespace, points: int | None, console: Console) -> list[Record]:
    """Run the campaign; the records are on disk as they come."""
    missing = [kind for kind in asked.boards or () if not kind.here]
    if missing:
        _refuse(f"--boards: {missing[0].folder} is not there")
    kinds = asked.boards or tuple(kind for kind in KINDS if kind.here)
    asked.out.mkdir(parents=True, exist_ok=True)
    shares = Shares(**{knob: getattr(asked, name) for name, knob in _KNOBS.items()})
    plan = Plan(kinds, asked.out.resolve(), points or 0, asked.per_board, asked.seed, asked.speed, asked.workers,
                asked.kills, shares, asked.by, asked.faults, asked.unattended)  # fmt: skip
    records: list[Record] = []
    progress, began_s = Console(stderr=True), time.monotonic()
    results = asked.out / "results.jsonl"
    with results.open("w", encoding="utf-8") as lines:

        def tell(batch: Batch, what: Record | str) -> None:
            if isinstance(what, str):
                progress.print(f"{batch.kind.name} ({batch.seed}): {what}", highlight=False)
                return
            if isinstance(what, Station):
                ended = what.broken or f"{what.points} points"
                progress.print(f"{batch.kind.name} ({batch.seed}): {ended}", highlight=False, markup=False)
            records.append(what)
            lines.write(to_line(what) + "\n")
            lines.flush()
            done = sum(isinstance(one, Visit) for one in records)
            if done % 50 == 0 and isinstance(what, Visit):
                of = f" of {points}" if points else ""
                progress.print(f"{done}{of} points, {time.monotonic() - began_s:.0f} s", highlight=False)

        try:
            run(plan, tell)
        except KeyboardInterrupt:
            console.print("interrupted: what ran so far is judged", style="yellow")
    minutes = (time.monotonic() - began_s) / 60.0
    console.print(f"{sum(isinstance(one, Visit) for one in records)} points in {minutes:.1f} min, results: {results}",
                  highlight=False, soft_wrap=True)  # fmt: skip
    return records


def _refuse(message: str) -> NoReturn:
    sys.stderr.write(f"nets: {message}\n")
    raise SystemExit(USAGE)


if __name__ == "__main__":
    sys.exit(main())
