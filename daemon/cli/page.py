"""`reprobe page`: the operator's page, and the people who may log in there."""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.markup import escape
from rich.table import Table

from daemon.cli.output import DEFAULT_ENDPOINT, USAGE, AsJson, fail, out, say_json
from daemon.page.people import USERS_FILE, Users, UserTrouble

app = typer.Typer()
group = typer.Typer(help="The operator's page in a browser.", invoke_without_command=True)
user = typer.Typer(help="People who may log in at the page: add, list, remove.", no_args_is_help=True)
group.add_typer(user, name="user")
app.add_typer(group, name="page")
STATE = Path("/var/lib/reprobe-page")
State = Annotated[Path, typer.Option("--state", envvar="REPROBE_PAGE_STATE", help="Folder of the page's users.")]


@group.callback()
def page(
    context: typer.Context,
    station: Annotated[
        str, typer.Option(help="Control socket of the daemon.", envvar="REPROBE_CONTROL")
    ] = DEFAULT_ENDPOINT,
    keys: Annotated[
        Path | None,
        typer.Option(
            envvar="REPROBE_PAGE_KEYS", help="Folder with page-observe.key, page-operate.key, page-maintain.key."
        ),
    ] = None,
    state: State = STATE,
    host: Annotated[str, typer.Option(envvar="REPROBE_PAGE_HOST", help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, envvar="REPROBE_PAGE_PORT")] = 8460,
    name: Annotated[list[str] | None, typer.Option(help="A further name by which browsers call it.")] = None,
    certificate: Annotated[Path | None, typer.Option(help="TLS certificate, PEM.")] = None,
    certificate_key: Annotated[Path | None, typer.Option(help="Its private key.")] = None,
    kiosk: Annotated[bool, typer.Option("--kiosk", help="This computer may look without a login.")] = False,
    watcher: Annotated[list[str] | None, typer.Option(help="With --kiosk: an address that may look, too.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Log JSON lines.")] = False,
) -> None:
    """Serve the operator's page until SIGTERM or Ctrl-C."""
    if context.invoked_subcommand is not None:
        return
    _require_installed()
    told = {
        "station": station, "keys": _text(keys), "state": str(state), "host": host, "port": port, "names": name or [],
        "certificate": _text(certificate), "certificate_key": _text(certificate_key), "kiosk": kiosk,
        "watchers": watcher or [], "as_json": as_json,
    }  # fmt: skip
    # It becomes the page: this command line alone is larger than all of that.
    os.execv(sys.executable, [sys.executable, "-m", "daemon.page", json.dumps(told)])  # noqa: S606  # no shell is wanted


@user.command()
def add(
    name: str,
    role: Annotated[Literal["observe", "operate", "maintain"], typer.Option(help="What the person may do.")],
    state: State = STATE,
) -> None:
    """Add a person, or give one another role and password; a PIN of six digits counts at the machine only.

    The password is asked for; where there is no terminal it is the first line of the input.
    """
    secret = typer.prompt("Password or PIN", hide_input=True, confirmation_prompt=True) if sys.stdin.isatty() else (
        sys.stdin.readline().rstrip("\n")
    )  # fmt: skip
    users = Users(state / USERS_FILE)
    try:
        added = users.add(name, role, secret)
    except UserTrouble as exc:
        fail(str(exc), advice=exc.advice, code=USAGE)
    where = "at the machine" if added.pin else "from anywhere"
    out.print(f"{escape(name)} may {role}, and log in {where}", highlight=False)


@user.command("list")
def list_(state: State = STATE, as_json: AsJson = False) -> None:
    """List who may log in."""
    users = Users(state / USERS_FILE)
    try:
        everybody = users.all()
    except UserTrouble as exc:
        fail(str(exc), advice=exc.advice, code=USAGE)
    if as_json:
        say_json([{"name": one.name, "role": one.role, "pin": one.pin} for one in everybody])
        return
    if not everybody:
        out.print(f"nobody is in {state}: `reprobe page user add NAME --role observe --state {state}`", soft_wrap=True)
        return
    table = Table("name", "role", "")
    for one in everybody:
        table.add_row(escape(one.name), one.role, "PIN, at the machine only" if one.pin else "")
    out.print(table)


@user.command()
def remove(name: str, state: State = STATE) -> None:
    """Remove a person; a session that is open ends at once."""
    users = Users(state / USERS_FILE)
    try:
        users.remove(name)
    except UserTrouble as exc:
        fail(str(exc), advice=exc.advice, code=USAGE)
    out.print(f"{escape(name)} may not log in any more", highlight=False)


def _require_installed() -> None:
    """End with words where the extra is missing."""
    if any(importlib.util.find_spec(part) is None for part in ("starlette", "uvicorn", "websockets")):
        fail("the page is not installed", advice="pip install 'reprobe[page]'", code=USAGE)


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)
