"""`reprobe run`, `reprobe sim`, `reprobe check-config`: commands that start something, and the check before."""

from __future__ import annotations

import asyncio
import faulthandler
import importlib.util
import os
import sys
from pathlib import Path
from typing import Annotated

import typer
import zmq

from daemon.app.service import Service
from daemon.cli.config_file import load
from daemon.cli.output import USAGE, AsJson, fail, out, say_json
from daemon.config.model import Config, ConfigError, load_config
from daemon.domain.board import Board
from daemon.domain.errors import Fault
from daemon.platform.instance_lock import NotAloneError
from daemon.platform.logs import set_up
from daemon.station.reach import out_of_reach
from daemon.wire.curve_keys import KeyTrouble

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
ConfigFile = Annotated[Path, typer.Option("--config", "-c", help="The station's TOML file.")]


@app.command()
def run(config: ConfigFile, as_json: Annotated[bool, typer.Option("--json", help="Log JSON lines.")] = False) -> None:
    """Run the daemon until SIGTERM or Ctrl-C."""
    loaded = load(config)
    set_up(as_json=as_json)
    # A watchdog ends a hung daemon by SIGABRT: where it hung is then in the log.
    if not faulthandler.is_enabled():
        faulthandler.enable()
    try:
        asyncio.run(Service(loaded, config).run())
    except (Fault, KeyTrouble, NotAloneError, ValueError) as exc:
        fail(str(exc), advice="" if isinstance(exc, ValueError) else exc.advice)
    except (OSError, zmq.ZMQError) as exc:
        fail(f"cannot start: {exc}", advice="is another daemon running on these sockets?")


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
    help="Run the simulated station; all arguments are its own (see reprobe sim --help).",
)
def sim(context: typer.Context) -> None:
    """Become the simulated station: a process of its own that is reached by its wires only."""
    if importlib.util.find_spec("gerbonara") is None:
        fail("the simulated station is not installed", advice="pip install 'reprobe[sim]'", code=USAGE)
    os.execv(sys.executable, [sys.executable, "-m", "sim_hw", *context.args])  # noqa: S606  # no shell is wanted


@app.command("check-config")
def check_config(
    config: Annotated[Path, typer.Argument(help="The station's TOML file.")], as_json: AsJson = False
) -> None:
    """Check a configuration and the board file it names; print every problem with its path."""
    floor: list[str] = []
    try:
        loaded = load_config(config)
        problems = _board_problems(loaded)
        floor = [_floor(loaded)]
    except ConfigError as exc:
        problems = exc.problems
    if as_json:
        listed = [{"path": path, "problem": what} for path, what in problems]
        say_json({"ok": not problems, "problems": listed, "notes": floor})
    elif problems:
        for path, what in problems:
            out.print(f"[bold]{path}[/]: {what}", highlight=False, soft_wrap=True)
    else:
        out.print(f"{config}: good")
        for note in floor:
            out.print(note, highlight=False, soft_wrap=True)
    if problems:
        raise typer.Exit(USAGE)


def _floor(config: Config) -> str:
    """Say how low the needle may go, and by what."""
    gantry, lowest_um = config.gantry, config.lowest_z_um
    if lowest_um > gantry.floor_z_um:
        return f"floor: Z {lowest_um:.0f} um, by axes.z.minimum"
    return (
        f"floor: Z {lowest_um:.0f} um, by gantry.touch_z_um - surface_range_um - overtravel_um; "
        f"below it, down to axes.z.minimum = {config.axes.z.minimum:.0f}, Z is never sent"
    )


def _board_problems(config: Config) -> list[tuple[str, str]]:
    try:
        board = Board.load(config.board.file)
    except ValueError as exc:
        return [("board.file", str(exc))]
    return [("axes", what) for what in out_of_reach(config, board)]
