"""`reprobe doctor`: examination of a station, and what to do about what it finds."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.markup import escape

from daemon.cli.config_file import ConfigFile
from daemon.cli.formatting import as_commands
from daemon.cli.output import FAILED, AsJson, err, out, say_cure, say_json

app = typer.Typer()
COLOUR = {"ok": "green", "warn": "yellow", "fail": "red"}


@app.command()
def doctor(
    config: ConfigFile,
    as_json: AsJson = False,
    scan: Annotated[bool, typer.Option("--scan", help="Only look who answers, at any address, speed, parity.")] = False,
) -> None:
    """Examine a station: ports, drives, lights, camera, permissions, disk, time. The head does not move.

    A running daemon is asked what it knows instead. Exit code 1 when something keeps the station from working.
    """
    from daemon.platform.logs import set_up  # noqa: PLC0415  # as the next one
    from daemon.tools.doctor.examination import examine  # noqa: PLC0415  # drivers and vision: only for this command

    set_up(as_json=as_json, level=50)  # what the drivers log is said here in other words
    with err.status("examining ..."):
        findings = examine(config, scan=scan)
    if as_json:
        say_json(findings.as_json())
    else:
        for check in findings.checks:
            mark = f"[{COLOUR[check.verdict]}]{check.verdict:<4}[/]"
            found = escape(as_commands(check.found))
            out.print(f"{mark} [bold]{escape(check.about)}[/]: {found}", highlight=False, soft_wrap=True)
            say_cure(check.advice, indent=7)
    if not findings.good:
        raise typer.Exit(FAILED)
