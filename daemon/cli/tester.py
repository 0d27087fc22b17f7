"""Commands of a tester: `home`, `place`, `correct`, `status` and the like, sent to a running daemon."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import typer
from rich.markup import escape

from daemon.cli.formatting import as_commands, calibrated, doubts, in_words, sentence
from daemon.cli.output import DEFAULT_ENDPOINT, USAGE, AsJson, Endpoint, answered, err, fail, out, say_cure, say_json
from daemon.cli.points import point_option
from daemon.client import Client, Refused
from daemon.domain.results import JobResult

app = typer.Typer()
ANSWER_WITHIN_S = 5.0
"""A daemon that runs answers anything in this time, if only that it took a job."""
RESET_WITHIN_S = 30.0
JobIdOption = Annotated[str | None, typer.Option("--id", help="Idempotency key; a new one by default.")]
Theta = Annotated[float, typer.Option(help="Head angle, degrees.")]
BoardId = Annotated[
    str | None,
    typer.Option("--board-id", help="Which board lies in the nest; refused unless it is the one that was aligned."),
]


@app.command()
@app.command("trigger", hidden=True)
def correct(
    test_point: Annotated[str, typer.Argument(help="Name of the test point, as CAD has it.")],
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    job_id: JobIdOption = None,
    timeout_s: Annotated[float, typer.Option(help="Give up after this.")] = 60.0,
    board_id: BoardId = None,
    as_json: AsJson = False,
) -> None:
    """Say that a test point reads open: the daemon looks, corrects, verifies and answers."""
    fields: dict[str, Any] = {"test_point": test_point, "deadline_ms": timeout_s * 1e3, "board_id": board_id}
    run_job("correct", endpoint, as_json=as_json, job_id=job_id, timeout_s=timeout_s + 5, **fields)


@app.command()
def place(
    test_point: Annotated[str | None, typer.Argument(help="Name of the test point.")] = None,
    at: Annotated[
        str | None, typer.Option("--at", help="Instead of a test point: a place X,Y of the board, um from its corner.")
    ] = None,
    theta_deg: Theta = 0.0,
    board_id: BoardId = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Put the tip over a test point or a place of the board, at working height."""
    if (test_point is None) == (at is None):
        fail("name either a test point or a place", advice="reprobe place TP7, or --at 12500,8000", code=USAGE)
    where: dict[str, Any] = (
        {"test_point": test_point} if at is None else {"board_um": point_option(at, "--at", example="12500,8000")}
    )
    run_job("place", endpoint, as_json=as_json, theta_deg=theta_deg, board_id=board_id, **where)


@app.command()
def home(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Home all axes."""
    run_job("home", endpoint, as_json=as_json)


@app.command()
def jog(
    axis: Annotated[Literal["x", "y", "z", "theta"], typer.Argument(help="Which axis.")],
    um: Annotated[float | None, typer.Option("--um", min=-1000, max=1000, help="x, y, z: so far, um.")] = None,
    deg: Annotated[float | None, typer.Option("--deg", min=-5, max=5, help="theta: so far, degrees.")] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Move one axis by one small step: sideways only at the safe height, down only where no surface can be."""
    if (um is None) != (axis == "theta") or (deg is None) == (axis == "theta"):
        fail("theta is moved by --deg, every other axis by --um", advice="reprobe jog x --um -100", code=USAGE)
    run_job("jog", endpoint, as_json=as_json, axis=axis, by_um=um, by_deg=deg)


@app.command()
def cancel(endpoint: Endpoint = DEFAULT_ENDPOINT, job_id: JobIdOption = None, as_json: AsJson = False) -> None:
    """Stop the running job, or the one named, safely."""
    ask("cancel", endpoint, as_json=as_json, **({"id": job_id} if job_id else {}))


@app.command()
def pause(endpoint: Endpoint = DEFAULT_ENDPOINT, job_id: JobIdOption = None, as_json: AsJson = False) -> None:
    """Have the run that is under way end after the point under test; `reprobe run --resume` goes on with it."""
    ask("pause", endpoint, as_json=as_json, **({"id": job_id} if job_id else {}))


@app.command()
def reset(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Clear a fault once its cause is gone; where only homing is left then, the reset has worked, and says so."""
    with answered(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client:
        client.request("status")
        try:
            reply = client.request("reset", timeout_s=RESET_WITHIN_S)
        except Refused as exc:
            if exc.error["detail"].get("reset") != "done":
                raise
            reply = {"v": 1, "ok": True, "reset": "done", "fault": exc.error}
    if as_json:
        say_json(reply)
    elif "reset" in reply:
        left = reply["fault"]
        out.print(f"[green]reset[/]: {escape(as_commands(left['message']))}", highlight=False, soft_wrap=True)
        say_cure(left["advice"])
    else:
        tell(reply)


@app.command()
def status(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Say what the daemon is doing."""
    ask("snapshot", endpoint, as_json=as_json)


def run_job(op: str, endpoint: str, *, as_json: bool, job_id: str | None = None, timeout_s: float = 120.0,
            **fields: Any) -> None:  # fmt: skip
    """Run a job, show how it ended, and exit 1 if it failed; fields that are None are left out of its request."""
    given = {name: value for name, value in fields.items() if value is not None}
    with answered(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client, err.status(f"{op} ..."):
        client.request("status")
        result = client.job(op, job_id=job_id, timeout_s=timeout_s, **given)
    show(result, as_json=as_json)


def show(result: JobResult, *, as_json: bool) -> None:
    """Show how a job ended, and exit 1 if it failed."""
    if as_json:
        say_json(result.model_dump(mode="json"))
    else:
        out.print(sentence(result), highlight=False)
        for doubt, advice in doubts(result.detail) if result.ok else ():
            out.print(f"  [yellow]{escape(doubt)}[/]", highlight=False, soft_wrap=True)
            say_cure(advice)
        _print_timing(result)
        if result.pictures:
            out.print(f"pictures: {result.pictures}", highlight=False, soft_wrap=True)
        if result.error is not None:
            say_cure(result.error.advice)
    if not result.ok:
        raise typer.Exit(1)


def _print_timing(result: JobResult) -> None:
    """Say how long it took, and in which states; `--json` has where each of them spent it."""
    spent = {state: row.get("total", 0.0) / 1e3 for state, row in result.timing_ms.items()}
    if spent:
        parts = ", ".join(f"{state} {seconds:.2f}" for state, seconds in spent.items())
        out.print(f"[dim]took {sum(spent.values()):.2f} s: {parts}[/]", highlight=False, soft_wrap=True)


def ask(op: str, endpoint: str, *, as_json: bool, **fields: Any) -> None:
    """Ask something that is answered at once, and show the answer."""
    with answered(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client:
        client.request("status")
        reply = client.request(op, timeout_s=RESET_WITHIN_S, **fields)
    if as_json:
        say_json(reply)
        return
    tell(reply)


def tell_fault(fault: dict[str, Any]) -> None:
    """Show a fault that stands, with what to do."""
    why = escape(as_commands(fault["message"]))
    out.print(f"[bold red]fault[/]: {fault['name']}: {why}", highlight=False, soft_wrap=True)
    say_cure(fault["advice"])


def tell(reply: dict[str, Any]) -> None:
    """Show a reply, a line for each thing it says."""
    for key, value in reply.items():
        if key == "fault" and value:
            tell_fault(value)
        elif key == "calibration":
            out.print(f"[bold]calibrated[/]: {calibrated(value)}", highlight=False, soft_wrap=True)
        elif key not in ("v", "ok", "version", "last_result"):
            told = escape(as_commands(in_words(value)))
            out.print(f"[bold]{key.replace('_', ' ')}[/]: {told}", highlight=False, soft_wrap=True)
    if reply.get("last_result"):
        out.print(f"[bold]last result[/]: {sentence(JobResult.model_validate(reply['last_result']))}", highlight=False)
