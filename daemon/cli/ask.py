"""What a tester asks and tells beside its jobs: `describe`, `result`, `results`, `points`, `hold`, `report`."""

from __future__ import annotations

import getpass
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.markup import escape
from rich.table import Table

from daemon.cli.formatting import sentence
from daemon.cli.health import month as month_page
from daemon.cli.output import DEFAULT_ENDPOINT, USAGE, AsJson, Endpoint, answered, fail, out, say_json
from daemon.cli.tester import ask, show
from daemon.client import Client
from daemon.config.plan_units import with_unit
from daemon.domain.results import JobResult

app = typer.Typer()
JobId = Annotated[str, typer.Argument(help="Id of the job, as its answer has it.")]
OldFile = Annotated[Path | None, typer.Option("--config", "-c", hidden=True, envvar="REPROBE_CONFIG")]


@app.command()
def describe(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Say who this station is, what you may ask of it, and which test points it knows."""
    with answered(), Client(endpoint) as client:
        reply = client.request("describe")
    if as_json:
        say_json(reply)
        return
    board, you = reply["board"], reply["you"]
    out.print(
        f"station {reply['station']}; you are {you['client']} and may {you['role']}", highlight=False, markup=False
    )
    size = f"{board['width_um'] / 1e3:g} x {board['height_um'] / 1e3:g} mm"
    out.print(f"board {board['name']}, {board['side']}, {size}", highlight=False, markup=False)
    table = Table("test point", "net", "kind", "x um", "y um")
    for point in board["test_points"]:
        words = (point["name"], point["net"] or "", point["kind"], f"{point['x_um']:.0f}", f"{point['y_um']:.0f}")
        table.add_row(*map(escape, words))
    out.print(table)


@app.command()
def result(job: JobId, endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Show how a job ended, also one of another client."""
    with answered(), Client(endpoint) as client:
        reply = client.request("result", id=job)
    if reply["result"] is None:
        if as_json:
            say_json(reply)
        else:
            out.print(f"{job} has not ended yet", highlight=False, markup=False)
        return
    show(JobResult.model_validate(reply["result"]), as_json=as_json)


@app.command()
def results(
    since: Annotated[int, typer.Option(min=0, help="First event number wanted.")] = 0,
    limit: Annotated[int, typer.Option(min=1, max=1000, help="At most so many.")] = 100,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """List results from an event number on, as a client that was away asks for them."""
    with answered(), Client(endpoint) as client:
        reply = client.request("results", since=since, limit=limit)
    if as_json:
        say_json(reply)
        return
    for one in map(JobResult.model_validate, reply["results"]):
        out.print(f"{one.seq:>8}  {sentence(one)}", highlight=False, soft_wrap=True)


@app.command()
def points(
    run: Annotated[str, typer.Argument(help="Id of a run over a board; `last`: the newest.")] = "last",
    since: Annotated[int, typer.Option(min=0, help="First number wanted.")] = 0,
    limit: Annotated[int, typer.Option(min=1, max=1000, help="At most so many.")] = 100,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """List what came of a run's points, in the order in which they were tested."""
    with answered(), Client(endpoint) as client:
        reply = client.request("points", run=run, since=since, limit=limit)
    if as_json:
        say_json(reply)
        return
    _say_records(
        reply["points"],
        ("number", "point", "net", "verdict", "value", "why"),
        lambda one: (str(one["n"]), one["point"], one["net"] or "", one["verdict"], _value(one), one["reason"]),
    )


@app.command()
def point(
    test_point: Annotated[str, typer.Argument(help="Name of the point, as CAD has it.")],
    board_id: Annotated[str | None, typer.Option("--board-id", help="Only on this board.")] = None,
    before: Annotated[
        int | None, typer.Option(min=0, help="Only older ones: the last number of the page before.")
    ] = None,
    limit: Annotated[int, typer.Option(min=1, max=500, help="At most so many.")] = 50,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Look back over the tests of one point, newest first."""
    wanted: dict[str, Any] = {"board_id": board_id, "before": before}
    given: dict[str, Any] = {name: value for name, value in wanted.items() if value is not None}
    with answered(), Client(endpoint) as client:
        reply = client.request("point", test_point=test_point, limit=limit, **given)
    if as_json:
        say_json(reply)
        return
    _say_records(
        reply["tests"],
        ("number", "when (UTC)", "board", "verdict", "value", "why"),
        lambda one: (str(one["n"]), one["at"][:19], one["board_id"] or "", one["verdict"], _value(one), one["reason"]),
    )


@app.command()
def mark(
    test_point: Annotated[str, typer.Argument(help="Name of the point, as CAD has it.")],
    what: Annotated[Literal["forbidden", "approved"], typer.Argument(help="Whether the needle may touch it.")],
    reason: Annotated[str, typer.Option(help="Why; shown wherever the point is shown.")],
    by: Annotated[str | None, typer.Option(help="Who you are; your login name by default.")] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Forbid a point of the board to the needle, or approve it again."""
    who = by or getpass.getuser()
    ask("mark", endpoint, as_json=as_json, test_point=test_point, mark=what, reason=reason, by=who)


@app.command()
def marks(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """List which points of the board people have forbidden or approved, and why."""
    with answered(), Client(endpoint) as client:
        reply = client.request("marks")
    if as_json:
        say_json(reply)
        return
    _say_records(
        reply["marks"],
        ("point", "mark", "who", "when (UTC)", "why"),
        lambda one: (one["point"], one["mark"], one["by"], one["at"][:19], one["reason"]),
    )


@app.command()
def hold(
    job: JobId,
    lease_ms: Annotated[float, typer.Option(min=200, max=30_000, help="So long from now on.")] = 2000.0,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Keep the needle down for longer: renew the lease of a touch."""
    ask("hold", endpoint, as_json=as_json, id=job, lease_ms=lease_ms)


@app.command()
def report(
    job: Annotated[str | None, typer.Argument(help="The job whose point was tested again.")] = None,
    retest: Annotated[Literal["pass", "open"] | None, typer.Option(help="What the re-test saw.")] = None,
    touches: Annotated[int, typer.Option(min=0, help="Touches since the last report.")] = 0,
    month: Annotated[str | None, typer.Option(hidden=True)] = None,
    config: OldFile = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", hidden=True)] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Tell the daemon what the re-test after a job saw, and how many touches there were; maintenance lives on it."""
    if month is not None and config is not None and output is not None:
        month_page(month, config, output)  # what `reprobe month` was called before
        return
    if retest is None and not touches:
        fail("there is nothing to report", advice="reprobe report JOB --retest pass, or --touches 20", code=USAGE)
    fields: dict[str, Any] = {"id": job, "retest": retest, "touches": touches}
    ask("report", endpoint, as_json=as_json, **{name: value for name, value in fields.items() if value is not None})


def _say_records(
    records: list[dict[str, Any]], columns: tuple[str, ...], row: Callable[[Any], tuple[str, ...]]
) -> None:
    table = Table(*columns)
    for one in records:
        table.add_row(*map(escape, row(one)))
    out.print(table)


def _value(record: dict[str, Any]) -> str:
    """Return what the last press read, with its unit."""
    last = record["readings"][-1] if record["readings"] else {"value": None, "unit": None}
    return with_unit(last["value"], last["unit"])
