"""Commands of a tester: `home`, `place`, `correct`, `status` and the like, sent to a running daemon."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.table import Table

from daemon.cli.formatting import sentence
from daemon.cli.output import DEFAULT_ENDPOINT, AsJson, Endpoint, answered, err, out, say_json
from daemon.client import Client
from daemon.domain.results import JobResult

app = typer.Typer()
ANSWER_WITHIN_S = 5.0
"""A daemon that runs answers anything in this time, if only that it took a job."""
RESET_WITHIN_S = 30.0
JobIdOption = Annotated[str | None, typer.Option("--id", help="Idempotency key; a new one by default.")]
Theta = Annotated[float, typer.Option(help="Head angle, degrees.")]


@app.command()
def trigger(
    test_point: Annotated[str, typer.Argument(help="Name of the test point, as CAD has it.")],
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    job_id: JobIdOption = None,
    timeout_s: Annotated[float, typer.Option(help="Give up after this.")] = 60.0,
    as_json: AsJson = False,
) -> None:
    """Say that a test point reads open: the daemon looks, corrects, verifies and answers."""
    fields: dict[str, Any] = {"test_point": test_point, "deadline_ms": timeout_s * 1e3}
    run_job("correct", endpoint, as_json=as_json, job_id=job_id, timeout_s=timeout_s + 5, **fields)


@app.command()
def place(
    test_point: Annotated[str, typer.Argument(help="Name of the test point.")],
    theta_deg: Theta = 0.0,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Put the tip over a test point, at working height."""
    run_job("place", endpoint, as_json=as_json, test_point=test_point, theta_deg=theta_deg)


@app.command()
def home(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Home all axes."""
    run_job("home", endpoint, as_json=as_json)


@app.command()
def lift(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Raise the needle straight up to the safe height; nothing else moves."""
    run_job("lift", endpoint, as_json=as_json)


@app.command()
def cancel(endpoint: Endpoint = DEFAULT_ENDPOINT, job_id: JobIdOption = None, as_json: AsJson = False) -> None:
    """Stop the running job, or the one named, safely."""
    _ask("cancel", endpoint, as_json=as_json, **({"id": job_id} if job_id else {}))


@app.command()
def reset(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Clear a fault once its cause is gone."""
    _ask("reset", endpoint, as_json=as_json)


@app.command()
def status(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Say what the daemon is doing."""
    _ask("snapshot", endpoint, as_json=as_json)


def run_job(op: str, endpoint: str, *, as_json: bool, job_id: str | None = None, timeout_s: float = 120.0,
            **fields: Any) -> None:  # fmt: skip
    """Run a job, show how it ended, and exit 1 if it failed."""
    with answered(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client, err.status(f"{op} ..."):
        client.request("status")
        result = client.job(op, job_id=job_id, timeout_s=timeout_s, **fields)
    if as_json:
        say_json(result.model_dump(mode="json"))
    else:
        out.print(sentence(result), highlight=False)
        _print_timing(result)
        if result.pictures:
            out.print(f"pictures: {result.pictures}", highlight=False, soft_wrap=True)
        if result.error is not None:
            out.print(f"  [dim]->[/] {result.error.advice}", highlight=False)
    if not result.ok:
        raise typer.Exit(1)


def _print_timing(result: JobResult) -> None:
    table = Table("state", *(columns := ("motion", "bus", "light", "exposure", "software", "total")), title="ms")
    for state, row in result.timing_ms.items():
        table.add_row(state, *(f"{row.get(c, 0.0):.1f}" for c in columns))
    out.print(table)


def _ask(op: str, endpoint: str, *, as_json: bool, **fields: Any) -> None:
    """Ask something that is answered at once, and show the answer."""
    with answered(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client:
        client.request("status")
        reply = client.request(op, timeout_s=RESET_WITHIN_S, **fields)
    if as_json:
        say_json(reply)
        return
    for key, value in reply.items():
        if key not in ("v", "ok", "version", "last_result"):
            out.print(f"[bold]{key}[/]: {value}", highlight=False, soft_wrap=True)
    if reply.get("last_result"):
        out.print(f"[bold]last result[/]: {sentence(JobResult.model_validate(reply['last_result']))}", highlight=False)
