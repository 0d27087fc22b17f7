"""Run of a plan over a board, as the command line asks for it and shows it: a live bar, or a line for each point."""

from __future__ import annotations

import uuid
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import typer
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from daemon.cli.output import FAILED, answered, err, fail, out, say_json
from daemon.cli.plan import refuse_plan
from daemon.cli.plan_text import PlanRefused, is_plan_file, plan_text, send_plan
from daemon.client import Client, NoAnswer, Refused, Subscription
from daemon.config.plan_units import with_unit
from daemon.domain.board_run import RunSummary, in_a_sentence
from daemon.domain.point_test import PointRecord, PointVerdict
from daemon.domain.results import JobResult

ANSWER_WITHIN_S = 30.0
LOOK_AGAIN_S = 1.0
"""How long to listen before asking: an event may be lost, what the journal has is not."""
PAGE, NOT_KNOWN = 500, 3
COLOURS = {
    PointVerdict.PASS_FIRST: "green", PointVerdict.PASS_RECOVERED: "cyan", PointVerdict.FAIL: "red",
    PointVerdict.OPEN_CONFIRMED: "red", PointVerdict.CONTACT_NOT_MADE: "yellow", PointVerdict.NOT_TESTED: "dim",
}  # fmt: skip


def run_over_board(plan: str | None, endpoint: str, *, as_json: bool, **fields: Any) -> None:
    """Run a plan, named or in a file, and show it.

    Exit code 0: every point passed, at once or recovered. 1: a net is at fault, or the run stopped. 3: some points are
    not known, and none is at fault.

    Ctrl-C cancels the run, not only the bar; it can be resumed.
    """
    job_id = f"run-{uuid.uuid4().hex[:12]}"
    given = {name: value for name, value in fields.items() if value not in (None, False, [], {})}
    with answered(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client:
        if plan is not None:
            given |= _stored(client, plan, as_json=as_json)
        events = client.request("describe")["events"]
        with Subscription(events, ("progress", "point", "result")) as heard:
            client.request("run", id=job_id, **given)
            with View(as_json=as_json) as view:
                result = _follow(client, heard, job_id, view)
    _tell(result, str(fields.get("board_id")), as_json=as_json)


def _stored(client: Client, plan: str, *, as_json: bool) -> dict[str, Any]:
    """Return what names the plan: a file is stored first, as a version of its own."""
    if not is_plan_file(plan):
        return {"plan": plan}
    file = Path(plan)
    text, form, stem = plan_text(file)
    try:
        stored = send_plan(client, "store", text, form, stem)["plan"]
    except PlanRefused as exc:
        refuse_plan(file, exc.mistakes, as_json=as_json)
    return {"plan": stored["plan"]["name"], "version": stored["version"]}


@dataclass
class View:
    """What is shown of a run: a bar where somebody watches, a line for each point where not."""

    as_json: bool
    shown: int | None = None
    """How many records were shown; None before the run has told how many it began with."""
    since: int = 0
    records: list[PointRecord] = field(default_factory=list)
    bar: Progress | None = None

    def __enter__(self) -> Self:
        """Begin to show."""
        if err.is_terminal and not self.as_json:
            self.bar = Progress(
                TextColumn("{task.description:<24}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
                TimeRemainingColumn(), console=err, transient=True,
            )  # fmt: skip
            self.bar.start()
            self.bar.add_task("run", total=None)
        return self

    def __exit__(self, *_: object) -> None:
        """Take the bar away."""
        if self.bar is not None:
            self.bar.stop()

    def progress(self, done: int, total: int, doing: str) -> None:
        """Show how far it is."""
        if self.shown is None:
            self.shown = done
        if self.bar is not None:
            self.bar.update(self.bar.task_ids[0], completed=done, total=total, description=doing[:24])

    def records_from(self, reply: dict[str, Any]) -> None:
        """Show the records of a page that were not shown yet."""
        total = len(reply["run"]["plan"]["tests"])
        for told in reply["points"]:
            self.since = told["n"] + 1
            self.records.append(PointRecord.model_validate(told))
            if self.shown is not None and len(self.records) > self.shown:
                self.shown += 1
                self._point(told, total)

    def _point(self, told: dict[str, Any], total: int) -> None:
        record = self.records[-1]
        if self.as_json:
            say_json(told)
            return
        if self.bar is not None and record.verdict is PointVerdict.PASS_FIRST:
            return  # the bar says it
        line = f"{len(self.records)}/{total} {escape(in_words(record))}"
        (err if self.bar is not None else out).print(
            f"[{COLOURS[record.verdict]}]{line}[/]", highlight=False, soft_wrap=True
        )


def in_words(record: PointRecord) -> str:
    """Say what came of a point in a line."""
    net = f" ({record.net})" if record.net else ""
    by = f" by {record.recovered_by.replace('_', ' ')}" if record.recovered_by else ""
    cause = f" ({record.cause})" if record.cause else ""
    readings = record.readings
    value = (
        "" if not readings else "open" if readings[-1].overload else with_unit(readings[-1].value, readings[-1].unit)
    )
    touches = f"{record.touches} touch{'es'[: 2 * (record.touches != 1)]}"
    facts = ", ".join(filter(None, (value, touches, f"{record.seconds:.2f} s", record.reason)))
    return f"{record.point}{net} {record.verdict.replace('_', ' ')}{by}{cause}: {facts}"


def _follow(client: Client, heard: Subscription, job_id: str, view: View) -> JobResult:
    """Follow the run to the end of its job."""
    try:
        while True:
            event = heard.next(LOOK_AGAIN_S)
            if event is not None and event["topic"] == "progress" and event["job"] == job_id:
                view.progress(event["done"], event["total"], event["doing"])
            if event is None or event["topic"] in ("point", "result"):
                result = _look_up(client, job_id, view)
                if result is not None:
                    return result
    except KeyboardInterrupt:
        return _cancelled(client, job_id)


def _look_up(client: Client, job_id: str, view: View) -> JobResult | None:
    """Show what the journal has, and return the job's result if it is there."""
    reply = client.request("result", id=job_id)
    if view.shown is None and not reply["done"]:
        running = client.request("status")["running"] or {}
        if running.get("id") == job_id and running["progress"]:
            view.progress(**running["progress"])
    try:
        while (page := client.request("points", run=job_id, since=view.since, limit=PAGE))["points"]:
            view.records_from(page)
    except Refused as exc:
        if exc.error["name"] != "unknown_run":  # it has not begun, or was refused
            raise
    return JobResult.model_validate(reply["result"]) if reply["done"] else None


def _cancelled(client: Client, job_id: str) -> JobResult:
    """Cancel the run, and return its result."""
    try:
        client.request("cancel", id=job_id)
        while not (reply := client.request("result", id=job_id))["done"]:
            err.print("[yellow]cancelled; the head stops[/]")
        return JobResult.model_validate(reply["result"])
    except NoAnswer:
        err.print("[red]the daemon does not answer; the run goes on[/]")
        raise typer.Exit(FAILED) from None


def _tell(result: JobResult, board_id: str, *, as_json: bool) -> None:
    """Show how the run stands, and what to do next; exit 1 unless every point passed."""
    told = result.detail.get("summary")
    summary = RunSummary.model_validate(told) if told else None
    passed = summary is not None and summary.points == summary.passed_first + summary.false_opens
    if as_json:
        say_json(result.model_dump(mode="json"))
    elif summary is not None:
        run_id = result.detail["run"]
        out.print(f"run {escape(run_id)}: {in_a_sentence(summary)}", highlight=False, soft_wrap=True)
        if result.detail["state"] == "unfinished":
            err.print(f"unfinished: {escape(result.detail['stopped_by'])}", highlight=False, soft_wrap=True)
            err.print(
                f"  [dim]->[/] go on with it: `reprobe run --resume --board-id {escape(board_id)}`", highlight=False
            )
        else:
            out.print(
                f"  its report: `reprobe board-report {escape(run_id)} --config station.toml -o DIR`", highlight=False
            )
    if result.error is not None and not as_json:
        fault = result.error
        fail(f"{fault.name} ({fault.code}): {fault.message}", advice=fault.advice)
    if not passed or not result.ok:
        unknown = (
            result.outcome == "run_done" and summary is not None and not (summary.failed or summary.opens_confirmed)
        )
        raise typer.Exit(NOT_KNOWN if unknown else FAILED)
