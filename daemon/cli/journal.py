"""`reprobe journal ...`: reading the journal, beside a running daemon or without one."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from daemon.cli.config_file import ConfigFile, load
from daemon.cli.formatting import as_commands, in_words, one_line
from daemon.cli.job_page import pictures_of, write_job_page
from daemon.cli.output import FAILED, USAGE, AsJson, err, fail, out, say_cure, say_json
from daemon.platform.atomic_file import replace_whole
from daemon.platform.clock import WAITS
from daemon.platform.spreadsheet import plain_cell
from daemon.storage.journal_reader import JobRow, JournalReader, NoJournal, Step

app = typer.Typer()
group = typer.Typer(help="The station's journal: list, show, export.", no_args_is_help=True)
app.add_typer(group, name="journal")
Failed = Annotated[bool, typer.Option("--failed", help="Only jobs that failed.")]
Op = Annotated[str | None, typer.Option("--op", help="Only this operation.")]
Since = Annotated[str | None, typer.Option(help="From then on: 2h, 3d, or a moment as ISO 8601 (UTC).")]
COLUMNS = (
    "id", "op", "received_at", "finished_at", "ok", "outcome", "test_point", "error_before_um", "error_after_um",
    "looks", "moves", "seconds", "error_code", "error_name", "error_message", "pictures",
)  # fmt: skip
_SPAN = re.compile(r"(\d+(?:\.\d+)?)([smhd])")
_UNIT_S = {"s": 1, "m": 60, "h": 3600, "d": 86400}


@group.command("list")
def list_jobs(
    config: ConfigFile, failed: Failed = False, op: Op = None, since: Since = None,
    limit: Annotated[int, typer.Option(min=1, help="At most so many, the newest.")] = 20, as_json: AsJson = False,
) -> None:  # fmt: skip
    """List jobs, the newest first."""
    with _journal(config) as journal:
        rows = islice(journal.jobs(failed=failed, op=op, since=_since(since), newest_first=True), limit)
        if as_json:
            for row in rows:
                say_json(flat(row))
            return
        table = Table("received (UTC)", "id", "op", "test point", "outcome", "um before", "um after", "s")
        for row in rows:
            table.add_row(*_cells(row))
        out.print(table)


@group.command()
def show(
    job: Annotated[str, typer.Argument(help="Id of the job.")],
    config: ConfigFile,
    page: Annotated[Path | None, typer.Option("--open-page", help="Write one HTML page with the pictures.")] = None,
    as_json: AsJson = False,
) -> None:
    """Show one job: its looks and moves, where its time went, how it ended, its pictures."""
    with _journal(config) as journal:
        row, steps = journal.job(job), journal.steps(job)
    if row is None:
        fail(f"the journal has no job {job!r}", advice="reprobe journal list --config ...")
    if as_json:
        say_json({**flat(row), "request": row.request, "result": row.result, "steps": [vars(s) for s in steps]})
    else:
        _tell(row, steps)
    if page is not None:
        write_job_page(row, steps, page)
        err.print(f"wrote {page}", highlight=False, soft_wrap=True)


@group.command()
def export(
    config: ConfigFile,
    as_csv: Annotated[Path | None, typer.Option("--csv", help="Write a table, one line a job.")] = None,
    as_jsonl: Annotated[Path | None, typer.Option("--jsonl", help="Write everything, one JSON object a job.")] = None,
    failed: Failed = False, op: Op = None, since: Since = None,
) -> None:  # fmt: skip
    """Write jobs to plain files, oldest first; any length, in constant memory."""
    if as_csv is None and as_jsonl is None:
        fail("say where to: --csv FILE or --jsonl FILE", code=USAGE)
    chosen: dict[str, Any] = {"failed": failed, "op": op, "since": _since(since)}
    with _journal(config) as journal:
        try:
            if as_csv is not None:
                replace_whole(as_csv, lambda path: _write_csv(path, journal.jobs(**chosen)))
            if as_jsonl is not None:
                replace_whole(as_jsonl, lambda path: write_jsonl(path, journal, journal.jobs(**chosen)))
        except OSError as exc:
            fail(f"cannot write: {exc}", advice="see that its folder is there and that you may write into it")


@contextmanager
def _journal(config: Path) -> Iterator[JournalReader]:
    """Open the journal of the station, or say why not."""
    folder = load(config).station.data_dir
    try:
        with JournalReader(folder / "journal.sqlite") as journal:
            yield journal
    except NoJournal as exc:
        fail(str(exc), advice=exc.advice, code=FAILED)


def _since(text: str | None) -> str | None:
    """Return a moment in the journal's own form."""
    if text is None:
        return None
    span = _SPAN.fullmatch(text)
    try:
        moment = (
            datetime.now(UTC) - timedelta(seconds=float(span[1]) * _UNIT_S[span[2]])
            if span else datetime.fromisoformat(text)
        )  # fmt: skip
    except (ValueError, OverflowError):
        fail(f"--since {text!r} is neither 2h, 3d nor a moment as 2026-01-31T12:00", code=USAGE)
    moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    return moment.isoformat(timespec="milliseconds")


def flat(row: JobRow) -> dict[str, Any]:
    """Return a job as one line of a table, under `COLUMNS`."""
    result, error = row.result or {}, row.error or {}
    return {
        "id": row.id, "op": row.op, "received_at": row.received_at, "finished_at": row.finished_at, "ok": row.ok,
        **{name: result.get(name) for name in COLUMNS[5:11]},
        "seconds": None if row.seconds is None else round(row.seconds, 3),
        **{f"error_{name}": error.get(name) for name in ("code", "name", "message")},
        "pictures": result.get("pictures"),
    }  # fmt: skip


def _write_csv(path: Path, jobs: Iterator[JobRow]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        for row in jobs:
            table.writerow({name: plain_cell(value) for name, value in flat(row).items()})


def write_jsonl(path: Path, journal: JournalReader, jobs: Iterator[JobRow]) -> None:
    """Write one JSON object a job: request, result and every look and move."""
    with path.open("w", encoding="utf-8") as file:
        for row in jobs:
            file.write(journal.line(row) + "\n")


def _cells(row: JobRow) -> list[str]:
    line = flat(row)
    outcome = "(no result)" if row.ok is None else line["error_name"] or line["outcome"]
    colour = "yellow" if row.ok is None else "green" if row.ok else "red"
    numbers = ["" if line[name] is None else f"{line[name]:.1f}" for name in COLUMNS[7:9]]
    return [
        row.received_at[:19], escape(one_line(row.id)), row.op,
        escape(one_line(str(line["test_point"] or (row.request.get("what") if row.op == "calibrate" else "") or ""))),
        f"[{colour}]{outcome}[/]", *numbers, "" if row.seconds is None else f"{row.seconds:.2f}",
    ]  # fmt: skip


def _tell(row: JobRow, steps: list[Step]) -> None:
    """Print one job for people."""
    out.print(f"[bold]{row.op}[/] {escape(one_line(row.id))}, received {row.received_at}", highlight=False)
    begun = datetime.fromisoformat(row.received_at)
    for step in steps:
        after_s = (datetime.fromisoformat(step.at) - begun).total_seconds()
        numbers = in_words(step.body)
        out.print(
            f"  {after_s:8.3f} s  [bold]{step.kind:<5}[/] {escape(one_line(numbers))}", highlight=False, soft_wrap=True
        )
    if row.result is None:
        out.print("[yellow]no result yet[/]")
        return
    table = Table("state", *(columns := (*WAITS, "software", "total")), title="ms")
    for state, spent in row.result["timing_ms"].items():
        table.add_row(state, *(f"{spent.get(c, 0.0):.1f}" for c in columns))
    out.print(table)
    if (error := row.error) is not None:
        why = f"{error['name']} ({error['code']}), {escape(as_commands(error['message']))}"
        out.print(f"[red]failed[/]: {why}", highlight=False, soft_wrap=True)
        say_cure(error["advice"])
        if technical := error["detail"].get("technical"):
            out.print(f"  [dim]in the maker's terms: {escape(one_line(str(technical)))}[/]", highlight=False)
    else:
        out.print(f"[green]{row.result['outcome']}[/]", highlight=False)
    for picture in pictures_of(row):
        out.print(f"picture: {picture}", highlight=False, soft_wrap=True)
