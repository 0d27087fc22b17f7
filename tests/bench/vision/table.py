"""Print the figures side by side, the verdict, and the worst scenes; write the records as CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import astuple, fields
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from tests.bench.vision.campaign import Record
from tests.bench.vision.figures import BLOCKS, Line, Verdict, by_artist, by_method, line
from tests.bench.vision.methods import OURS_KNOWN, missing_peers

TITLES = {
    "tip": "Tip of the needle",
    "pads": "Test points",
    "disc": "Disc on plain ground, against the Cramer-Rao bound",
    "control": "Control point",
}
NOTES = {
    "tip": "Peers are taught on the same golden picture and search the same window; the error they make there is taken "
    "off. In 'defects', missed is right: the needle is bent, worn, out of focus or not there.",
    "pads": "All peers see the same window, spikes taken out, know both radius classes and the view where the camera's "
    "is known, and are asked whether the circle steps up all round; a dark hole gives their target as it gives "
    "ours. The nearest answer counts. With no pad there, silence is right and counts nowhere.",
    "disc": "x CRB: rms error over the bound with place, size, form, levels and hole unknown.",
    "control": "Ours only: no peer package looks for this mark.",
}
LICENCES = "Licences of the peers: OpenCV Apache-2.0, subpixel-edges and circle-fit MIT; none had to be left out."
RENAMED = "subpixel-edges 0.1.1 still names np.int, gone since NumPy 1.24; the name is lent to it while it compiles."
KNOWN = "needle known: it is also given the tip found in a white frame of the same needle (the first artist only)."


def number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def _row(block: str, figures: Line) -> list[str]:
    return [
        block,
        figures.method,
        str(figures.scenes),
        str(figures.found),
        str(figures.missed),
        str(figures.wrong),
        number(figures.rms_px, 3),
        number(figures.p99_px, 3),
        number(figures.ms, 2),
    ]


def _figures_table(title: str, task: str, first: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column(first)
    table.add_column("method", no_wrap=True)
    for head in ("n", "found", "missed", "wrong", "rms px", "p99 px", "median ms"):
        table.add_column(head, justify="right")
    if task == "disc":
        table.add_column("x CRB", justify="right")
    return table


def _add(table: Table, task: str, first: str, groups: dict[str, list[Record]]) -> None:
    for method, part in groups.items():
        figures = line(method, part)
        ratio = [number(figures.crb_ratio, 2)] if task == "disc" else []
        table.add_row(*_row(first, figures), *ratio, style="bold" if method.startswith("ours") else "")
        first = ""


def show_task(console: Console, task: str, records: Sequence[Record]) -> None:
    """Print one task's table: blocks of scenes, in each ours and the peers; then ours by artist."""
    table = _figures_table(TITLES[task], task, "scenes")
    for block, keep in BLOCKS[task].items():
        _add(table, task, block, by_method(filter(keep, records)))
        table.add_section()
    console.print(table)
    if len(by_artist(records)) > 1:
        _show_artists(console, task, [record for record in records if record.method.startswith("ours")])
    console.print(NOTES[task], style="dim")
    if any(record.method == OURS_KNOWN for record in records):
        console.print(KNOWN, style="dim")
    if task in {"pads", "disc"}:
        console.print(f"{LICENCES} {RENAMED}", style="dim")
        for peer, packages in missing_peers().items():
            console.print(f"Not measured: {peer} (install {packages}; `make bench-vision` does).", style="yellow")
    console.print()


def _show_artists(console: Console, task: str, ours: Sequence[Record]) -> None:
    table = _figures_table("Ours, by artist", task, "scenes")
    for block, keep in BLOCKS[task].items():
        for artist, part in by_artist(filter(keep, ours)).items():
            _add(table, task, f"{block}: {artist}", by_method(part))
        table.add_section()
    console.print(table)


def show_speed(console: Console, records: Sequence[Record]) -> None:
    """Print times only."""
    table = Table(title="Time, one thread, process time", title_justify="left", title_style="bold")
    for head in ("task", "method"):
        table.add_column(head)
    for head in ("n", "median ms", "p95 ms"):
        table.add_column(head, justify="right")
    for task, title in TITLES.items():
        name = title
        for method, part in by_method(record for record in records if record.task == task).items():
            figures = line(method, part)
            table.add_row(name, method, str(figures.scenes), number(figures.ms, 2), number(figures.p95_ms, 2))
            name = ""
    console.print(table)
    console.print()


def show_verdicts(console: Console, verdicts: Sequence[Verdict]) -> None:
    table = Table(title="Verdict", title_justify="left", title_style="bold")
    for head in ("target", "measured", ""):
        table.add_column(head)
    words = {True: "[green]reached[/]", False: "[red]missed[/]", None: "[dim]not measured[/]"}
    for verdict in verdicts:
        table.add_row(verdict.target, verdict.measured, words[verdict.reached])
    console.print(table)
    console.print()


def show_worst(console: Console, task: str, records: Sequence[Record]) -> None:
    """Print the scenes to look at first: each can be drawn again from artist, kind and seed."""
    table = Table(title=f"Worst scenes of ours: {TITLES[task]}", title_justify="left", title_style="bold")
    for head in ("artist", "kind", "seed", "noise", "outcome", "error px", "reason"):
        table.add_column(head)
    for record in records:
        noise = f"{record.noise:g}" if record.noise else ""
        error = number(record.error_px, 3)
        row = (record.artist, record.kind, str(record.seed), noise, record.outcome, error, record.reason)
        table.add_row(*row)
    console.print(table)
    console.print()


def _cell(value: object) -> object:
    return "" if isinstance(value, float) and not np.isfinite(value) else value


def write_csv(path: Path, records: Sequence[Record]) -> None:
    """Write one line a record; dx, dy and the error are empty where nothing was found."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(Record)])
        writer.writerows([_cell(value) for value in astuple(record)] for record in records)
