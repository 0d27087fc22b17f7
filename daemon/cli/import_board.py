"""`reprobe board`: import of a board's CAD."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.table import Table

from daemon.cli.output import USAGE, AsJson, fail, out, say_json
from daemon.domain.board import Board
from daemon.tools.cad_import import import_board, summary

app = typer.Typer()


@app.command()
def board(
    folder: Annotated[Path, typer.Argument(help="Folder with Gerber, Excellon and IPC-D-356 files.")],
    side: Annotated[Literal["top", "bottom"], typer.Option(help="The side that is probed.")] = "top",
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the board file here.")] = None,
    as_json: AsJson = False,
) -> None:
    """Read a CAD folder: list what can be probed from one side and why the rest cannot; write the board file."""
    try:
        read = import_board(folder, side)
    except ValueError as exc:
        fail(str(exc), code=USAGE)
    if output is not None:
        output.write_text(read.model_dump_json(indent=1))
    if as_json:
        say_json(read.model_dump(mode="json"))
    else:
        _print(read)


def _print(read: Board) -> None:
    table = Table(title=f"{read.name}, {read.side}: {summary(read.points)}")
    for column in ("name", "kind", "x mm", "y mm", "pad um", "hole um", "net", "probe"):
        table.add_column(column, justify="left" if column in ("name", "kind", "net", "probe") else "right")
    for p in read.points:
        hole = f"{p.hole_um:.0f}" if p.hole_um else ""
        place = (f"{p.x_um / 1e3:.3f}", f"{p.y_um / 1e3:.3f}", f"{p.diameter_um:.0f}", hole)
        table.add_row(p.name, p.kind, *place, p.net or "", p.why_not or "yes")
    out.print(table)
    for name, why in read.hidden.items():
        out.print(f"{name}: {why}", highlight=False)
