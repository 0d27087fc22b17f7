"""`reprobe health`, `reprobe acknowledge`, `reprobe month`: watches, alerts and a month of a station."""

from __future__ import annotations

import asyncio
import getpass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from daemon.cli.config_file import ConfigFile, load
from daemon.cli.formatting import as_commands
from daemon.cli.output import DEFAULT_ENDPOINT, FAILED, USAGE, AsJson, Endpoint, answered, fail, out, say_cure, say_json
from daemon.client import Client
from daemon.platform.subprocess import draw

app = typer.Typer()
ALL_ALERTS = 2**62
"""No alert has so high a number: of past ones none is asked for."""
COLOURS = {"good": "green", "alert": "red", "learning": "yellow", "warning": "yellow", "serious": "red"}
PAGE_WITHIN_S = 120.0


@app.command()
@app.command("alerts", hidden=True)
def health(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Show how the station is: every alert with what to do, every watch. Exit code 0: healthy, 1: alert or fault."""
    with answered(), Client(endpoint) as client:
        reply = client.request("alerts", since=ALL_ALERTS, limit=1)
    if as_json:
        say_json(reply)
    else:
        _show(reply)
    if not reply["healthy"]:
        raise typer.Exit(FAILED)


@app.command()
def acknowledge(
    alert: Annotated[str, typer.Argument(help="Name of the alert, as `reprobe health` has it.")],
    note: Annotated[str, typer.Option(help="What you found or will do.")] = "",
    by: Annotated[str | None, typer.Option(help="Who you are; your login name by default.")] = None,
    mended: Annotated[bool, typer.Option("--mended", help="Its cause is gone: clear it and learn anew.")] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Say that you know of an alert."""
    with answered(), Client(endpoint) as client:
        reply = client.request("acknowledge", alert=alert, by=by or getpass.getuser(), note=note, mended=mended)
    if as_json:
        say_json(reply)
    else:
        known = reply["alert"]
        out.print(f"{alert}: acknowledged by {escape(known['acknowledged']['by'])}", highlight=False)


@app.command()
def month(
    month: Annotated[str, typer.Argument(help="Which month, such as 2026-11 (UTC).")],
    config: ConfigFile,
    output: Annotated[Path, typer.Option("--output", "-o", help="The page to write.")],
) -> None:
    """Write a month of the station's health as one HTML page, out of the journal; no daemon is needed."""
    loaded = load(config)
    journal = loaded.station.journal
    arguments = ["--journal", str(journal), "--month", month, "--station", loaded.station.name, "-o", str(output)]
    code, words = asyncio.run(draw("daemon.tools.report.month", arguments, PAGE_WITHIN_S))
    if code:
        fail(words or f"the page was not drawn (status {code})", code=USAGE if code == USAGE else FAILED)
    out.print(f"written to {output}", highlight=False, markup=False, soft_wrap=True)


def _show(reply: dict[str, Any]) -> None:
    """Print alerts with all that belongs to them, then the table of watches."""
    standing = reply["standing"]
    for alert in standing:
        colour, message = COLOURS[alert["severity"]], escape(as_commands(alert["message"]))
        out.print(f"[bold {colour}]{alert['severity']}[/] [bold]{alert['name']}[/]: {message}",
                  highlight=False, soft_wrap=True)  # fmt: skip
        out.print(f"  since about {alert['since_touches']} touches, {alert['since_at'][:16]} UTC", highlight=False)
        for line in alert["evidence"][-3:]:
            out.print(f"  [dim]{escape(as_commands(line))}[/]", highlight=False, soft_wrap=True)
        say_cure(alert["advice"])
        if known := alert["acknowledged"]:
            note = f": {known['note']}" if known["note"] else ""
            out.print(f"  acknowledged by {escape(known['by'] + note)}", highlight=False, soft_wrap=True)
    table = Table("group", "watch", "state", "now", "usual", "allowed", "unit", title=f"{reply['touches']} touches")
    for watch in reply["watches"]:
        table.add_row(*_cells(watch))
    out.print(table)
    learning = sum(w["state"] == "learning" for w in reply["watches"])
    alerts = f"{len(standing)} alert{'s'[: len(standing) != 1]}"
    healthy = "[green]healthy[/]" if reply["healthy"] else f"[red]{alerts}[/]"
    if missing := reply.get("not_calibrated"):
        cure = " and ".join(f"`reprobe calibrate {kind}`" for kind in missing)
        healthy = f"[red]not calibrated[/]: it corrects nothing before {cure}; {alerts}"
    if fault := reply.get("fault"):
        cure = escape(as_commands(fault["advice"]))
        healthy = f"[red]in fault: {fault['name']}[/], {escape(as_commands(fault['message']))} -> {cure}; {alerts}"
    learned = f"{learning} of {len(reply['watches'])} watches have not seen enough yet to judge"
    out.print(f"{healthy}; {learned}", highlight=False, soft_wrap=True)


def _cells(watch: dict[str, Any]) -> list[str]:
    state = watch["state"]
    learned = f" {100 * watch['learned']:.0f} %" if state == "learning" else ""
    low, high = watch["low"], watch["high"]
    allowed = f"{'' if low is None else f'{low:.4g}'} .. {'' if high is None else f'{high:.4g}'}"
    return [
        watch["group"], watch["name"], f"[{COLOURS[state]}]{state}{learned}[/]", _number(watch["figure"]),
        _number(watch["usual"]), allowed if (low, high) != (None, None) else "", watch["unit"],
    ]  # fmt: skip


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
