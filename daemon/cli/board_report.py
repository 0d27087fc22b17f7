"""`reprobe board-report`: pages and tables of a run over a board, out of the journal."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from daemon.cli.config_file import ConfigFile, load
from daemon.cli.output import USAGE, fail, out
from daemon.storage.journal_reader import NoJournal
from daemon.tools.report.run_facts import NoRun, read_run
from daemon.tools.report.run_page import write_run

app = typer.Typer()


@app.command("board-report")
def board_report(
    run: Annotated[str, typer.Argument(help="Id of a run over a board; `last`: the newest.")],
    config: ConfigFile,
    output: Annotated[Path, typer.Option("--output", "-o", help="The folder to write into.")],
) -> None:
    """Write a run over a board as a page with its map, CSV, JSON lines and JUnit XML; no daemon is needed."""
    loaded = load(config)
    try:
        page = write_run(read_run(loaded.station.journal, run), output)
    except NoJournal as exc:
        fail(str(exc), advice=exc.advice)
    except NoRun as exc:
        fail(str(exc), advice=exc.advice, code=USAGE)
    out.print(f"written to {escape(str(page))}", highlight=False, soft_wrap=True)
