"""`reprobe check-config`: every mistake of a configuration and of what it names, in one go, with line and cure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from daemon.cli.formatting import as_commands
from daemon.cli.output import USAGE, AsJson, err, out, say_json
from daemon.config.model import Config, ConfigError, load_config, unlikely
from daemon.config.problems import Problem, Unlikely, line_of, nearest, told
from daemon.domain.board import Board
from daemon.domain.errors import Fault
from daemon.station.reach import on_the_board, out_of_reach, outside_the_axes
from daemon.storage.plan_store import PlanStore, plans_folder

app = typer.Typer()


@app.command("check-config")
def check_config(
    config: Annotated[Path, typer.Argument(help="The station's TOML file.")],
    probe: Annotated[
        bool, typer.Option("--probe", help="Also ask the hardware: ports there, drives answer, camera modes.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check a configuration and the board file it names; print every problem with its line, its path and its cure.

    What is possible but hardly meant, such as a port that this computer does not have, is a warning. Exit code 2 when
    there is a problem. Nothing moves, also with --probe.
    """
    floor: list[str] = []
    odd = Unlikely([], {})
    try:
        odd = unlikely(config)
        loaded = load_config(config)
        problems, beyond = _board_problems(loaded)
        odd = Unlikely([*odd.notes, *beyond], odd.lines)
        floor = [_floor(loaded)]
        lines = odd.lines
    except ConfigError as exc:
        problems, lines = exc.problems, exc.lines
    if probe:
        problems, odd = _probed(config, problems, odd)
    if as_json:
        say_json(
            {
                "ok": not problems,
                "problems": [{"path": path, "problem": what, "line": line_of(lines, path)} for path, what in problems],
                "warnings": [{"path": path, "warning": what, "line": line_of(lines, path)} for path, what in odd.notes],
                "notes": floor,
            }
        )
    else:
        _print(config, told(problems, lines), told(odd.notes, lines), floor)
    if problems:
        raise typer.Exit(USAGE)


def _print(config: Path, problems: list[str], warnings: list[str], notes: list[str]) -> None:
    for text in problems:
        out.print(f"[red]problem[/] {escape(text)}", highlight=False, soft_wrap=True)
    for text in warnings:
        out.print(f"[yellow]warning[/] {escape(text)}", highlight=False, soft_wrap=True)
    if problems:
        total = f"{len(problems)} problem{'s' if len(problems) > 1 else ''}"
        out.print(f"{escape(str(config))}: {total}; correct the lines named above", highlight=False, soft_wrap=True)
        return
    look = f", with {len(warnings)} warning{'s' if len(warnings) > 1 else ''}: see above" if warnings else ""
    out.print(f"{escape(str(config))}: good{look}", highlight=False, soft_wrap=True)
    for note in notes:
        out.print(note, highlight=False, soft_wrap=True)


def _floor(config: Config) -> str:
    """Say how low the needle may go, and by what."""
    gantry, lowest_um = config.gantry, config.lowest_z_um
    if lowest_um > gantry.floor_z_um:
        return f"floor: Z {lowest_um:.0f} um, by axes.z.minimum"
    return (
        f"floor: Z {lowest_um:.0f} um, by gantry.touch_z_um - surface_range_um - overtravel_um; "
        f"below it, down to axes.z.minimum = {config.axes.z.minimum:.0f}, Z is never sent"
    )


def _board_problems(config: Config) -> tuple[list[Problem], list[Problem]]:
    """Return what is wrong with the board where it lies, and what is odd."""
    try:
        board = Board.load(config.board.file)
    except ValueError as exc:
        return [("board.file", str(exc))], []
    problems = [("axes", what) for what in out_of_reach(config, board)]
    if (folder := _no_folder(config.station.data_dir)) is not None:
        problems.append(("station.data_dir", f"{folder} is a file, and a folder is wanted; name another"))
    places = [*outside_the_axes(config, board), *on_the_board(config, board)]
    return problems, [*places, *_other_plans(config, board), *_foreign_nets(config, board), *_no_keys(config)]


def _no_folder(path: Path) -> Path | None:
    """Return the part of a folder's path that is there and no folder."""
    return next((one for one in (path, *path.parents) if one.exists() and not one.is_dir()), None)


def _foreign_nets(config: Config, board: Board) -> list[Problem]:
    """Return the instrument's channels of nets that the board does not have."""
    known = {point.net for point in board.points if point.net}
    channels = config.meter.channels if config.meter is not None else {}
    said = "the board file has no net {!r}{}"
    return [(f"meter.channels.{net}", said.format(net, nearest(net, known))) for net in channels if net not in known]


def _no_keys(config: Config) -> list[Problem]:
    """Say where keys are wanted and none lie; systemd may hand them over."""
    folder = config.api.keys_dir
    if not config.api.curve or folder.is_dir():
        return []
    return [
        ("api.keys_dir", f"{folder} is not there: `reprobe keys new NAME --role operate --keys {folder}` makes keys")
    ]


def _other_plans(config: Config, board: Board) -> list[Problem]:
    """Return which stored plans no run will take: they are for another board, or another file of it, or damaged."""
    stored, damaged = PlanStore(plans_folder(config.station.data_dir)).newest()
    odd = [("board.file", fault.message) for fault in damaged]
    for one in stored:
        try:
            one.plan.require_board(board)
        except Fault as fault:
            odd.append(("board.file", f"{fault.message}; no run will take it"))
    return odd


def _probed(config: Path, problems: list[Problem], odd: Unlikely) -> tuple[list[Problem], Unlikely]:
    """Return the problems with those of the hardware; a device that is not there is one then.

    The hardware is asked only when the file is good: with a wrong one, nobody knows whom to ask.
    """
    absent = [note for note in odd.notes if "is not there on this computer" in note[1]]
    odd = Unlikely([note for note in odd.notes if note not in absent], odd.lines)
    if problems or absent:
        return [*problems, *absent], odd
    from daemon.platform.logs import set_up  # noqa: PLC0415  # as the next one
    from daemon.tools.doctor.examination import examine  # noqa: PLC0415  # drivers and vision: only for this

    set_up(as_json=False, level=50)
    with err.status("asking the hardware ..."):
        checks = examine(config).checks
    said = {"fail": problems, "warn": odd.notes}
    for check in checks:
        if check.verdict in said:
            said[check.verdict].append((check.about, as_commands(f"{check.found}; {check.advice}")))
    return problems, odd
