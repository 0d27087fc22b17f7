"""Measure our finders beside their peers, on the same scenes, in one run.

    python -m tests.bench.vision [tip|pads|disc|control|speed|all] [--scenes N] [--seed S] [--artist first|second|both]
                                 [--workers 1|2] [--plots DIR] [--csv FILE]

A target that is missed is a result, not an error: the exit code is 0.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from tests.bench.vision.campaign import Record

# Before NumPy loads: process time should be the time of one thread.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

SCENES = {"tip": 1000, "pads": 2000, "disc": 900, "control": 400, "speed": 120}
TASKS = {"speed": ("tip", "pads", "control"), "all": ("tip", "pads", "disc", "control")}


def arguments(argv: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.vision", description=__doc__.splitlines()[0])
    parser.add_argument("campaign", nargs="?", default="all", choices=[*SCENES, "all"])
    parser.add_argument("--scenes", type=_positive, help="scenes a campaign (default: tip 1000, pads 2000, ...)")
    parser.add_argument("--seed", type=int, default=1, help="first seed; the others follow on")
    parser.add_argument("--artist", default="both", choices=["first", "second", "both"])
    parser.add_argument("--workers", type=int, default=1, choices=[1, 2], help="processes (speed: always 1)")
    parser.add_argument("--plots", type=Path, help="folder for PNG plots (needs the bench group)")
    parser.add_argument("--csv", type=Path, help="file for one line a scene and method")
    return parser.parse_args(argv)


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"at least 1 scene, not {value}")
    return value


def main(argv: list[str] | None = None) -> int:
    """Measure, print, and write what was asked for."""
    asked = arguments(argv)
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from tests.bench.vision import campaign, table

    # A file or a pipe has no width of its own: the tables need this much.
    console = Console(width=None if sys.stdout.isatty() else 132)
    # A folder that cannot be made should be known before an hour of measuring.
    for folder in (asked.plots, asked.csv and asked.csv.parent):
        if folder:
            folder.mkdir(parents=True, exist_ok=True)
    if asked.plots:
        from tests.bench.vision import plots
    speed = asked.campaign == "speed"
    tasks = TASKS.get(asked.campaign, (asked.campaign,))
    names = {
        task: campaign.names_of(task, asked.artist, asked.scenes or SCENES["speed" if speed else task], asked.seed)
        for task in tasks
    }
    records: list[campaign.Record] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        for task, listed in names.items():
            bar = progress.add_task(table.TITLES[task], total=len(listed))
            workers, repeats = (1, 5) if speed else (asked.workers, 1)
            records += campaign.run(listed, workers, repeats, lambda bar=bar: progress.advance(bar))
    _show(console, names, records, speed=speed)
    if asked.csv:
        table.write_csv(asked.csv, records)
        console.print(f"records: {asked.csv}")
    if asked.plots:
        for path in plots.draw_all(asked.plots, records):
            console.print(f"plot: {path}")
    return 0


def _show(console: Console, tasks: Iterable[str], records: list[Record], *, speed: bool) -> None:
    """Print the tables: of each campaign, or of the speed alone; then which targets were met."""
    from tests.bench.vision import figures, table

    verdicts = figures.verdicts(records)
    if speed:
        table.show_speed(console, records)
        table.show_verdicts(console, [verdict for verdict in verdicts if "ms median" in verdict.target])
        return
    for task in tasks:
        part = [record for record in records if record.task == task]
        table.show_task(console, task, part)
        table.show_worst(console, task, figures.worst(part))
    table.show_verdicts(console, verdicts)


if __name__ == "__main__":
    sys.exit(main())
