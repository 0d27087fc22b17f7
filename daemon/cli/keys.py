"""`reprobe keys ...`: client keys, their roles, and the allow-list."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.markup import escape
from rich.table import Table

from daemon.cli.config_file import load
from daemon.cli.output import USAGE, AsJson, fail, out, say_json
from daemon.wire.curve_keys import CLIENTS, REVOKED, ClientKey, KeyTrouble, clients, new_client, revoke

app = typer.Typer()
group = typer.Typer(help="Keys of clients that reach the daemon from outside: new, list, revoke.", no_args_is_help=True)
app.add_typer(group, name="keys")
Folder = Annotated[Path, typer.Option("--keys", envvar="REPROBE_KEYS", help="The station's key folder (api.keys_dir).")]
Config = Annotated[Path | None, typer.Option("--config", "-c", help="Take the folder from this station.toml.")]
FOLDER = Path("/etc/reprobe/keys")


@group.command()
def new(
    name: Annotated[str, typer.Argument(help="Of the client; it stands in logs and in the list.")],
    role: Annotated[Literal["observe", "operate", "maintain"], typer.Option(help="What it may do.")],
    out_file: Annotated[Path | None, typer.Option("--out", "-o", help="Its private file; NAME.key by default.")] = None,
    keys: Folder = FOLDER,
    config: Config = None,
    as_json: AsJson = False,
) -> None:
    """Make a client's key, put it on the allow-list, and write the private file that the client comes with.

    The first one makes the station's own key too. Hand the file over by a way you trust; the station does not need it.
    """
    private = out_file or Path(f"{name}.key")
    try:
        key = new_client(_folder(keys, config), name, role, private)
    except KeyTrouble as exc:
        fail(str(exc), advice=exc.advice, code=USAGE)
    if as_json:
        say_json({"name": key.name, "role": key.role, "public": key.public, "file": str(private)})
    else:
        out.print(f"{key.name} may {key.role}; its private key is {private}", highlight=False, soft_wrap=True)


@group.command("list")
def list_(keys: Folder = FOLDER, config: Config = None, as_json: AsJson = False) -> None:
    """List who may come in, and who may not any more."""
    folder = _folder(keys, config)
    if not folder.is_dir():
        fail(f"there is no folder {folder}", advice="`reprobe keys new NAME --role operate` makes it", code=USAGE)
    try:
        rows = [
            (key, state) for state, which in (("", CLIENTS), ("revoked", REVOKED)) for key in clients(folder, which)
        ]
    except KeyTrouble as exc:
        fail(str(exc), advice=exc.advice, code=USAGE)
    if as_json:
        say_json([_facts(key, revoked=bool(state)) for key, state in rows])
        return
    table = Table("name", "role", "public key", "made", "")
    for key, state in rows:
        table.add_row(key.name, key.role, escape(key.public), key.made_at, f"[red]{state}[/]" if state else "")
    out.print(table)


@group.command("revoke")
def revoke_(
    name: Annotated[str, typer.Argument(help="Of the client.")],
    keys: Folder = FOLDER,
    config: Config = None,
    as_json: AsJson = False,
) -> None:
    """Take a client off the allow-list; a running daemon refuses its next message."""
    try:
        key = revoke(_folder(keys, config), name)
    except KeyTrouble as exc:
        fail(str(exc), advice=exc.advice, code=USAGE)
    if as_json:
        say_json(_facts(key, revoked=True))
    else:
        out.print(f"{escape(key.name)} may not come in any more", highlight=False)


def _folder(keys: Path, config: Path | None) -> Path:
    """Return the key folder meant."""
    if config is None:
        return keys
    return load(config).api.keys_dir


def _facts(key: ClientKey, *, revoked: bool) -> dict[str, object]:
    return {"name": key.name, "role": key.role, "public": key.public, "made_at": key.made_at, "revoked": revoked}
