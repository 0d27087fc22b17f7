"""Show how far the campaigns are, and write every record at once: what ran counts even if the rest is interrupted."""

from __future__ import annotations

from types import TracebackType
from typing import Self, TextIO

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tests.bench.landing.campaign import Batch
from tests.bench.landing.judge import misses
from tests.bench.landing.trials import Record, Trial, to_line

SPEED_OVER_S = 120.0
"""The remaining time follows the pace of the last minutes, for set-ups come in bursts."""


class Display:
    """A bar for all trials and one for each station under way."""

    def __init__(self, console: Console, lines: TextIO, trials: int) -> None:
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description:<44}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        self._progress = Progress(*columns, console=console, transient=True, speed_estimate_period=SPEED_OVER_S)
        self._lines = lines
        self._all: TaskID = self._progress.add_task("trials", total=trials)
        self._stations: dict[Batch, TaskID] = {}
        self._missed = 0
        self.records: list[Record] = []

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._progress.stop()

    def doing(self, batch: Batch, text: str) -> None:
        """Name what a station does."""
        if batch not in self._stations:
            self._stations[batch] = self._progress.add_task("", total=batch.trials or None)
        self._progress.update(self._stations[batch], description=f"  {batch.name}: {text}")

    def took(self, batch: Batch, record: Record) -> None:
        """Keep a record and count it."""
        self.records.append(record)
        self._lines.write(to_line(record) + "\n")
        self._lines.flush()
        if isinstance(record, Trial):
            self._missed += bool(misses([record]))
            self._progress.advance(self._all)
            self._progress.advance(self._stations[batch])
            self._progress.update(self._all, description=f"trials, {self._missed} missed")

    def ended(self, batch: Batch) -> None:
        """Take a station's bar away."""
        if batch in self._stations:
            self._progress.remove_task(self._stations.pop(batch))
