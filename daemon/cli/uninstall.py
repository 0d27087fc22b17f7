"""`reprobe uninstall`: takes away what `reprobe install` laid out, and asks before anything of a person's goes."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from daemon.cli.output import AsJson, fail, out, say_json
from daemon.cli.shell import made_files
from daemon.platform.instance_lock import NotAloneError
from daemon.tools.uninstall import find, require_stopped, take_away

app = typer.Typer()
AFTERWARDS = (
    ("systemctl daemon-reload && udevadm control --reload", "systemd and udev forget it"),
    ("userdel reprobe", "the daemon's user, if no file of its is kept"),
    ("rm -r /opt/reprobe /usr/local/bin/reprobe", "the program itself"),
)


@app.command()
def uninstall(
    root: Annotated[Path, typer.Option("--root", help="Take away below this folder; / for this computer.")],
    configuration: Annotated[
        bool, typer.Option("--configuration", help="Also delete configuration, keys and edited device rules.")
    ] = False,
    state: Annotated[bool, typer.Option("--state", help="Also delete journal, calibrations and pictures.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask; what was not named above is kept.")] = False,
    as_json: AsJson = False,
) -> None:
    """Take away units, rules, manual page and completions; configuration and state only when you say so."""
    try:
        there = find(root, tuple(made_files()))
        require_stopped(there)
    except NotAloneError as exc:
        fail(str(exc), advice="systemctl disable --now reprobe, or reprobe@NAME")
    if there.is_nothing:
        fail(f"nothing of reprobe is installed below {root}", advice="name the --root that `reprobe install` was given")
    ask = not yes and sys.stdin.isatty()
    goes = there.own
    if _goes(there.configuration, "configuration, keys and edited rules", wanted=configuration, ask=ask):
        goes += there.configuration
    if _goes(there.state, "journal, calibrations and pictures", wanted=state, ask=ask):
        goes += there.state
    removed = take_away(goes)
    kept = [path for path in (*there.own, *there.configuration, *there.state) if path not in goes and path.exists()]
    if as_json:
        say_json({"removed": [str(path) for path in removed], "kept": [str(path) for path in kept]})
        return
    for how, paths in (("removed", removed), ("kept", kept)):
        for path in paths:
            out.print(f"{how:>8}  {path}", highlight=False, markup=False, soft_wrap=True)
    out.print("\nnext:")
    for step, why in AFTERWARDS:
        out.print(f"  {step}\n      {why}", highlight=False, soft_wrap=True, markup=False)


def _goes(paths: tuple[Path, ...], what: str, *, wanted: bool, ask: bool) -> bool:
    """Return whether a person's things are deleted; nobody to ask, and not told: they stay."""
    if not paths or (not wanted and not ask):
        return False
    if not ask:
        return True
    where = ", ".join(str(path) for path in paths)
    return typer.confirm(f"delete {what} ({where})? `reprobe backup` keeps them", default=False, err=True)
