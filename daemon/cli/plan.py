"""`reprobe plan ...`: check, store, list, show, learn and approve test plans."""

from __future__ import annotations

import getpass
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.markup import escape
from rich.table import Table

from daemon.cli.config_file import load
from daemon.cli.output import DEFAULT_ENDPOINT, USAGE, AsJson, Endpoint, answered, err, fail, out, say_json
from daemon.cli.plan_text import PlanRefused, plan_text, send_plan
from daemon.client import Client
from daemon.config.plan_file import PlanError, read_plan
from daemon.config.plan_units import with_unit
from daemon.domain.board import Board
from daemon.domain.plan import Plan, StoredPlan

app = typer.Typer()
group = typer.Typer(help="Test plans: which points are tested, how, and by which limits.", no_args_is_help=True)
app.add_typer(group, name="plan")
ANSWER_WITHIN_S = 30.0
PlanFile = Annotated[Path, typer.Argument(help="The plan, TOML or CSV.")]
Name = Annotated[
    str | None, typer.Option(help="What it is called where the file does not say; else by the file's name.")
]
By = Annotated[str | None, typer.Option(help="Who you are; your login name by default.")]
Version = Annotated[int | None, typer.Option(min=1, help="Which version; the newest by default.")]


@group.command()
def check(
    file: PlanFile,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="A station, for its board file; no daemon is needed then.")
    ] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Say all that is wrong with a plan for the station's board, each with its line. Exit code 2 if anything is."""
    if config is None:
        _show(_send("check", file, None, endpoint, as_json=as_json), as_json=as_json)
        return
    text, form, name = plan_text(file)
    try:
        board = Board.load(load(config).board.file)
        plan = read_plan(text, form, board, name)
    except PlanError as exc:
        refuse_plan(file, ({"line": one.line, "what": one.what} for one in exc.mistakes), as_json=as_json)
    except ValueError as exc:
        fail(str(exc), code=USAGE)
    _show_plan(plan, f"{file}: good", as_json=as_json)


@group.command()
def store(file: PlanFile, name: Name = None, endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """Store a plan on the station as a new version; one that says the same as the newest makes none."""
    _show(_send("store", file, name, endpoint, as_json=as_json), as_json=as_json)


@group.command("list")
def list_plans(endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False) -> None:
    """List the station's plans, the newest version of each."""
    reply = _ask(endpoint, action="list")
    if as_json:
        say_json(reply)
        return
    table = Table("plan", "version", "fingerprint", "board", "tests", "limits", "stored (UTC)")
    for plan in reply["plans"]:
        board = plan["board"] if plan["fits"] else f"[yellow]{escape(plan['board'])}: not this board file[/]"
        limits = (
            "given" if not plan["learned"] else "learned, approved" if plan["approved"] else "learned, not approved"
        )
        cells = (plan["name"], str(plan["version"]), plan["hash"], board, str(plan["tests"]), limits)
        table.add_row(*cells, plan["stored_at"][:16])
    out.print(table)
    for damaged in reply["damaged"]:
        err.print(f"[yellow]warning[/] {escape(damaged)}", highlight=False, soft_wrap=True)


@group.command()
def show(
    name: Annotated[str, typer.Argument(help="Name of the plan.")],
    version: Version = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Show a stored plan with all its limits."""
    _show(_ask(endpoint, action="show", name=name, version=version), as_json=as_json)


@group.command()
def learn(
    name: Annotated[str, typer.Argument(help="What the plan is to be called.")],
    runs: Annotated[list[str], typer.Argument(help="Ids of runs on boards that are known to be good.")],
    by: By = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Learn a plan's limits from runs on good boards; somebody has to look at them and approve them before use."""
    reply = _ask(endpoint, action="learn", name=name, learn_from=runs, by=by or getpass.getuser())
    _show(reply, as_json=as_json)
    for point, why in (reply.get("left_out") or {}).items():
        err.print(f"[yellow]left out[/] {escape(point)}: {escape(why)}", highlight=False, soft_wrap=True)


@group.command()
def approve(
    name: Annotated[str, typer.Argument(help="Name of the plan.")],
    version: Version = None,
    by: By = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Say that you looked at a plan's learned limits and take them for good."""
    reply = _ask(endpoint, action="approve", name=name, version=version, by=by or getpass.getuser())
    _show(reply, as_json=as_json)


def _send(action: str, file: Path, name: str | None, endpoint: str, *, as_json: bool) -> dict[str, Any]:
    """Send a plan's file; end with all its mistakes where it is refused."""
    text, form, stem = plan_text(file)
    try:
        with answered(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client:
            return send_plan(client, action, text, form, name or stem)
    except PlanRefused as exc:
        refuse_plan(file, exc.mistakes, as_json=as_json)


def _ask(endpoint: str, **fields: Any) -> dict[str, Any]:
    """Ask one `plan`."""
    given = {name: value for name, value in fields.items() if value is not None}
    with answered(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client:
        return client.request("plan", **given)


def refuse_plan(file: Path, mistakes: Iterable[dict[str, Any]], *, as_json: bool) -> NoReturn:
    """Say all mistakes, and end."""
    listed = list(mistakes)
    if as_json:
        say_json({"ok": False, "mistakes": listed})
        raise typer.Exit(USAGE)
    for one in listed:
        where = f"line {one['line']}: " if one["line"] is not None else ""
        out.print(f"[red]mistake[/] {escape(where + one['what'])}", highlight=False, soft_wrap=True)
    fail(f"{file}: {len(listed)} mistake{'s'[: len(listed) != 1]}; nothing was stored", code=USAGE)


def _show(reply: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        say_json(reply)
        return
    stored = StoredPlan.model_validate(reply["plan"])
    state = "good, not stored" if not stored.version else f"version {stored.version}, fingerprint {stored.hash}"
    if stored.plan.learned:
        known = stored.approved
        state += f"; learned from {', '.join(stored.plan.learned_from)}; "
        state += f"approved by {known.by}" if known else "NOT APPROVED: it is not used before `reprobe plan approve`"
    _show_plan(stored.plan, f"{stored.plan.name}: {state}", as_json=False)


def _show_plan(plan: Plan, head: str, *, as_json: bool) -> None:
    if as_json:
        say_json({"ok": True, "plan": plan.model_dump(mode="json"), "hash": plan.hash})
        return
    table = Table("point", "net", "method", "low", "high", "angle", "look", "note", title=f"{len(plan.tests)} tests")
    for test in plan.tests:
        limits = test.limits
        low, high = (with_unit(getattr(limits, end), limits.unit) if limits else "" for end in ("low", "high"))
        angle = "any" if test.theta_deg is None else f"{test.theta_deg:g}"
        table.add_row(
            escape(test.point), escape(test.net or ""), test.method, low, high, angle, test.look, escape(test.note)
        )
    out.print(table)
    out.print(escape(f"{head}; board {plan.board}"), highlight=False, soft_wrap=True)
