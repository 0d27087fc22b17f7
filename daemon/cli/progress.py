"""Progress bar of a long job, fed by the daemon's progress events."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from typing import Any

import typer
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from daemon.cli.formatting import as_commands, in_words
from daemon.cli.output import FAILED, answered, err, out, say_cure, say_json
from daemon.client import Client, NoAnswer, Subscription
from daemon.domain.results import JobResult

LOOK_AGAIN_S = 1.0
"""How long to listen before asking for the result: an event may be lost, an answer is not."""


class Interrupted(typer.Exit):
    """The person stopped the job by Ctrl-C, and was told so."""


def run_with_bar(op: str, endpoint: str, *, as_json: bool, alone: bool = True, **fields: Any) -> None:
    """Run a job, show how far it is and how it ended; exit 1 if it failed. Ctrl-C cancels the job, not only the bar.

    `alone`: the caller does not do by itself what comes next, and it is said.
    """
    job_id = f"{op}-{uuid.uuid4().hex[:12]}"
    with answered(), Client(endpoint) as client:
        events = client.request("describe")["events"]
        with Subscription(events, ("progress", "result")) as heard, _bar() as bar:
            client.request(op, id=job_id, **fields)
            result = _await(client, heard, job_id, bar, bar.add_task(op, total=None))
    if as_json:
        say_json(result.model_dump(mode="json"))
    else:
        _tell(result, alone=alone)
    if not result.ok:
        raise typer.Exit(FAILED)


def _await(client: Client, heard: Subscription, job_id: str, bar: Progress, task: TaskID) -> JobResult:
    """Follow one job to its end."""
    try:
        while True:
            event = heard.next(LOOK_AGAIN_S)
            if event is None:
                reply = client.request("result", id=job_id)
                if reply["done"]:
                    return JobResult.model_validate(reply["result"])
            elif event["topic"] == "progress" and event["job"] == job_id:
                bar.update(task, completed=event["done"], total=event["total"], description=event["doing"])
            elif event["topic"] == "result" and event["id"] == job_id:
                return JobResult.model_validate({k: event[k] for k in JobResult.model_fields})
    except KeyboardInterrupt:
        try:
            client.request("cancel", id=job_id)
            err.print("[yellow]cancelled; the head stops[/]")
        except NoAnswer:
            err.print("[red]the daemon does not answer; the job goes on[/]")
        raise Interrupted(FAILED) from None


def _bar() -> Progress:
    columns = (
        TextColumn("{task.description:<28}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(), TimeRemainingColumn(),
    )  # fmt: skip
    return Progress(*columns, console=err, transient=True)


def _tell(result: JobResult, *, alone: bool) -> None:
    """Show a result's figures, one a line."""
    if result.error is not None:
        fault = result.error
        why = f"{fault.name} ({fault.code}), {escape(as_commands(fault.message))}"
        out.print(f"[red]{result.op} failed[/]: {why}", highlight=False, soft_wrap=True)
        say_cure(fault.advice)
        if "in_force" in result.detail:
            out.print(f"  in force: {in_force_words(result.detail)}", highlight=False)
        return
    table = Table.grid(padding=(0, 2))
    for name, value in result.detail.items():
        if name not in ("void", "next"):
            table.add_row(name, figure_words(value))
    out.print(f"[green]{result.outcome}[/], {result.looks} looks, {result.moves} moves", highlight=False)
    out.print(table)
    for line in undone_words(result.detail) if alone else ():
        out.print(line, highlight=False, markup=False, soft_wrap=True)


def undone_words(detail: Mapping[str, Any]) -> list[str]:
    """Say what a new tip has made void, and what to type next; nothing where it is nothing."""
    void, following = detail.get("void"), detail.get("next")
    lines = [f"void now, for they were measured with the tip before: {', '.join(void)}"] if void else []
    return lines + ([f"next: {', then '.join(f'`reprobe {op}`' for op in following)}"] if following else [])


def figure_words(value: Any) -> str:
    """Return a figure of a result as people read it: lists in one line, no brackets, no Python."""
    return ", ".join(map(figure_words, value)) if isinstance(value, list) else in_words(value)


def in_force_words(detail: Mapping[str, Any]) -> str:
    """Say which calibration holds after one that failed."""
    which, made_at = detail["in_force"], detail.get("made_at")
    what = f"{which} {detail.get('what', 'calibration')}" if which != "none" else f"no {detail.get('what')}"
    return f"{what}, made {made_at}" if made_at else what
