"""`reprobe install`: units, user, folders and device rules."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from daemon.cli.output import AsJson, fail, out, say_json
from daemon.cli.shell import made_files
from daemon.tools.install import PREFIX, InstallError, Placed, lay_out

app = typer.Typer()

FIRST = (
    ("systemd-sysusers && systemd-tmpfiles --create", "the daemon's user, and the folder of its keys"),
    ("systemctl daemon-reload", "systemd reads the units"),
)
DEVICES = (
    (
        "editor /etc/udev/rules.d/70-reprobe.rules && udevadm control --reload && udevadm trigger",
        "your adapters' numbers; afterwards: ls -l /dev/reprobe-*",
    ),
    (
        "cp /etc/reprobe/station.example.toml /etc/reprobe/station.toml",
        "put in your own numbers; or `reprobe setup` instead: it asks for all that follows, and calibrates",
    ),
    ("reprobe board CAD_FOLDER -o /etc/reprobe/board.json", "the board under test"),
    ("reprobe check-config /etc/reprobe/station.toml", "every mistake at once"),
)
LAST = (
    ("systemctl enable --now reprobe", "start it, and with every boot"),
    ("systemctl status reprobe", "it starts in fault: not homed; then `reprobe home`"),
)


@app.command()
def install(
    root: Annotated[Path, typer.Option("--root", help="Lay out below this folder; / for this computer.")],
    prefix: Annotated[Path, typer.Option("--prefix", help="Where the program's virtual environment is.")] = PREFIX,
    bench: Annotated[bool, typer.Option("--bench", help="With the simulated station instead of a real one.")] = False,
    instance: Annotated[
        str | None, typer.Option("--instance", help="With a place for one of several stations here, as reprobe@NAME.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Lay out units, user, device rules and folders; what you have edited is left alone. May be run again."""
    try:
        placed = lay_out(root, prefix, bench=bench, instance=instance, made=made_files())
    except InstallError as exc:
        fail(str(exc), advice=exc.advice)
    steps = [(_of(step, instance), why) for step, why in (*FIRST, *(() if bench else DEVICES), *LAST)]
    if as_json:
        say_json({"files": [{"path": str(p.path), "how": p.how} for p in placed], "next": [step for step, _ in steps]})
        return
    _tell(placed, steps)


def _of(step: str, instance: str | None) -> str:
    """Return a step with the names of one of several stations."""
    if instance is None:
        return step
    own = step.replace("/etc/reprobe/", f"/etc/reprobe/{instance}/")
    return own.removesuffix(" reprobe") + f" reprobe@{instance}" if own.endswith(" reprobe") else own


def _tell(placed: list[Placed], steps: list[tuple[str, str]]) -> None:
    for one in placed:
        out.print(f"{one.how:>20}  {one.path}", highlight=False, soft_wrap=True)
    out.print("\nnext:")
    for step, why in steps:
        out.print(f"  {step}\n      {why}", highlight=False, soft_wrap=True, markup=False)
