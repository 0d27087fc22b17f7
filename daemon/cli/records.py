"""Commands of kept results, orders and pictures, of the settings in force, and of a lamp for the live picture."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.markup import escape
from rich.table import Table

from daemon.cli.formatting import in_words, sentence
from daemon.cli.output import DEFAULT_ENDPOINT, AsJson, Endpoint, answered, fail, out, say_json
from daemon.cli.tester import ask
from daemon.client import Client
from daemon.domain.results import JobResult

app = typer.Typer()
JobId = Annotated[str, typer.Argument(help="Id of the job, as its answer has it.")]
Before = Annotated[int | None, typer.Option(min=0, help="Only older ones: the last number of the page before.")]
Limit = Annotated[int, typer.Option(min=1, max=500, help="At most so many.")]


@app.command()
def history(
    of: Annotated[str | None, typer.Option(help="Of one operation, such as correct.")] = None,
    test_point: Annotated[str | None, typer.Option(help="Of one test point.")] = None,
    board_id: Annotated[str | None, typer.Option(help="Of one board, as its request named it.")] = None,
    outcome: Annotated[str | None, typer.Option(help="Such as corrected, or failed.")] = None,
    before: Before = None,
    limit: Limit = 50,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Look back over results, newest first."""
    wanted = {"of": of, "test_point": test_point, "board_id": board_id, "outcome": outcome, "before": before}
    given = {name: value for name, value in wanted.items() if value is not None}
    reply = _asked("history", endpoint, limit=limit, **given)
    if as_json:
        say_json(reply)
        return
    for one in reply["results"]:
        said = sentence(JobResult.model_validate(one))
        board = f"  board {escape(one['board_id'])}" if one.get("board_id") else ""
        out.print(f"{one['seq']:>8}  {said}{board}", highlight=False, soft_wrap=True)


@app.command()
def audit(
    before: Before = None, limit: Limit = 50, endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False
) -> None:
    """Show who gave which order, newest first."""
    given = {} if before is None else {"before": before}
    reply = _asked("audit", endpoint, limit=limit, **given)
    if as_json:
        say_json(reply)
        return
    table = Table("number", "when (UTC)", "who", "key", "may", "order", "what came of it")
    for one in reply["entries"]:
        what = f"{one['op']} {in_words(one['fields'])}" if one["fields"] else one["op"]
        row = (str(one["n"]), one["at"][:19], one["by"] or "", one["client"], one["role"], what, one["outcome"] or "")
        table.add_row(*map(escape, row))
    out.print(table)


@app.command()
def records(
    since: Annotated[int, typer.Option(min=0, help="First number wanted.")] = 0,
    journal: Annotated[str | None, typer.Option(help="Id of the journal it is a number of.")] = None,
    kind: Annotated[
        list[str] | None, typer.Option(help="Only of this kind, such as alert; may be given again.")
    ] = None,
    limit: Limit = 100,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Show all that is kept, oldest first and under one count, as `reprobe uplink` fetches it."""
    given: dict[str, Any] = ({} if journal is None else {"journal": journal}) | ({"kinds": kind} if kind else {})
    reply = _asked("records", endpoint, since=since, limit=limit, **given)
    if as_json:
        say_json(reply)
        return
    if lost := reply["lost"]:
        out.print(f"[yellow]trimmed[/]: {lost['from_seq']} to {lost['to_seq']}", highlight=False)
    for one in reply["records"]:
        what = "gone" if one["body"] is None else record_in_words(one["kind"], one["body"])
        line = f"{one['seq']:>8}  {(one['at'] or '')[:19]:19}  {one['kind']:<11}  {what}"
        out.print(escape(line), highlight=False, no_wrap=True, overflow="ellipsis", crop=True)
    more = reply.get("through_seq", reply["next_seq"]) + 1
    following = f", more: --since {more} --journal {reply['journal']}" if more < reply["next_seq"] else ""
    kept = f"journal {reply['journal']}, kept from {reply['oldest_seq']} on{following}"
    out.print(f"[dim]{escape(kept)}[/]", highlight=False, soft_wrap=True)


def record_in_words(kind: str, body: dict[str, Any]) -> str:
    """Return what a record says; of an order, which is kept when it is taken and when it has ended, that first."""
    if kind == "order":
        body = {"op": body.get("op"), "outcome": body.get("outcome") or "taken"} | {
            name: said for name, said in body.items() if name not in ("op", "outcome")
        }
    return in_words(body)


@app.command()
def note(
    what: Annotated[Literal["login", "logout", "refused"], typer.Argument(help="What a person did.")],
    by: Annotated[str, typer.Option(help="Who did it.")],
    detail: Annotated[str, typer.Option(help="In a few words.")] = "",
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Write down what a person did at a program of your own; `reprobe audit` shows it."""
    ask("note", endpoint, as_json=as_json, what=what, by=by, detail=detail)


@app.command()
def pictures(job: JobId, endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """List the pictures that are kept of a job."""
    reply = _asked("pictures", endpoint, id=job)
    if as_json:
        say_json(reply)
    elif not reply["pictures"]:
        out.print(f"none are kept of {escape(job)}", highlight=False)
    for which in [] if as_json else reply["pictures"]:
        out.print(escape(which), highlight=False)


@app.command()
def picture(
    job: JobId,
    which: Annotated[str, typer.Argument(help="As `reprobe pictures JOB` lists it, such as before-red.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The JPEG file to write.")],
    endpoint: Endpoint = DEFAULT_ENDPOINT,
) -> None:
    """Fetch one kept picture of a job."""
    reply = _asked("picture", endpoint, id=job, which=which)
    try:
        output.write_bytes(base64.b64decode(reply["jpeg"]))
    except OSError as exc:
        fail(f"{output} cannot be written: {exc.strerror}", advice="name another file by -o")
    out.print(f"written to {escape(str(output))}", highlight=False, soft_wrap=True)


@app.command()
def config(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Show the settings in force, and which of them the station's file does not give."""
    reply = _asked("config", endpoint)
    if as_json:
        say_json(reply)
        return
    for problem in reply["refused"]:
        out.print(f"[yellow]not taken[/]: {escape(problem)}", highlight=False, soft_wrap=True)
    for one in reply["settings"]:
        value = "" if one["value"] is None else str(one["value"])
        source = "" if one["source"] == "file" else "  [dim](default)[/]"
        out.print(f"{escape(one['name'])} = {escape(value)}{source}", highlight=False, soft_wrap=True)


@app.command()
def light(
    colour: Annotated[Literal["white", "red", "off"], typer.Argument(help="Which lamp.")],
    lease_ms: Annotated[float, typer.Option(min=200, max=30_000, help="Dark again after so long.")] = 5000.0,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Switch a lamp on for a while, in idle only: to see with the live picture."""
    ask("light", endpoint, as_json=as_json, colour=colour, lease_ms=lease_ms)


def _asked(op: str, endpoint: str, **fields: Any) -> dict[str, Any]:
    with answered(), Client(endpoint) as client:
        return client.request(op, **fields)
