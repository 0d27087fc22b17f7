"""`reprobe look`: tip and pads in stored images, or through a running daemon's camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.markup import escape

from daemon.cli.board_look import BoardAsked
from daemon.cli.output import DEFAULT_ENDPOINT, FAILED, USAGE, AsJson, Endpoint, err, fail, out, say_cure, say_json
from daemon.cli.picture_files import SUFFIXES, check_target, write_picture
from daemon.cli.points import point_option
from daemon.cli.stored_look import Asked, StoredLook, look_at
from daemon.cli.tester import run_job

app = typer.Typer()


@app.command()
def look(
    what: Annotated[
        str | None, typer.Argument(metavar="[TEST_POINT | PICTURE]", help="Under the tip now; or a stored picture.")
    ] = None,
    white: Annotated[Path | None, typer.Option(help="Stored white picture: find the tip in it.")] = None,
    probe: Annotated[Path | None, typer.Option(help="The taught probe (.npz), for --white.")] = None,
    red: Annotated[Path | None, typer.Option(help="Stored red picture: find the test points round the tip.")] = None,
    around: Annotated[str | None, typer.Option(help="Look round X,Y in px instead of round the tip.")] = None,
    control_point: Annotated[bool, typer.Option("--control-point", help="Find a control point in PICTURE.")] = False,
    expected_radius_px: Annotated[float | None, typer.Option(help="The pad's radius as CAD has it, px.")] = None,
    expected_hole_radius_px: Annotated[
        float | None, typer.Option(help="Its hole's radius as CAD has it, px; 0: it has none.")
    ] = None,
    reach_px: Annotated[
        float | None, typer.Option(help="How far to look: 30 px by default, 60 for a control point.")
    ] = None,
    arm_px: Annotated[
        float | None, typer.Option(help="A control point's arm from its centre, 60 px by default.")
    ] = None,
    board: Annotated[
        Path | None, typer.Option(help="Board file with layers: register its CAD in --red and draw it.")
    ] = None,
    at: Annotated[
        str | None, typer.Option(help="With --board: the target's name, or X,Y on it in um, below the tip.")
    ] = None,
    pose_map: Annotated[
        Path | None, typer.Option("--map", help="With --board: the station's map, calibration/map.json.")
    ] = None,
    theta_deg: Annotated[float, typer.Option(help="With --board: the head's angle.")] = 0.0,
    sheet: Annotated[Path | None, typer.Option("--out", "-o", help="Write an annotated picture here.")] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Look at stored pictures and say what is seen; without any, let the daemon take a look where the head is.

    The daemon keeps its pictures and nothing moves. Stored pictures need no daemon: exit code 0 when all that was asked
    for was found, 1 when not, 2 when something cannot be read or was asked for wrongly.
    """
    sizes = (expected_radius_px, expected_hole_radius_px)
    options = (white, probe, red, around, *sizes, reach_px, arm_px, board, at, pose_map, sheet)
    if not control_point and all(option is None for option in options):
        _let_daemon_look(what, endpoint, as_json=as_json)
        return
    picture = None if what is None else Path(what)
    if picture is not None and (white if control_point else red) is not None:
        _refuse("PICTURE is given twice", f"leave out PICTURE or {'--white' if control_point else '--red'}")
    point = None if around is None else point_option(around, "--around")
    of_white, of_red = (white or picture, red) if control_point else (white, red or picture)
    of_board = _board_asked(board, at, pose_map, theta_deg)
    asked = Asked(of_white, of_red, probe, point, control_point, *sizes, reach_px, arm_px, of_board)
    _refuse_incomplete(asked)
    if sheet is not None:
        check_target(sheet, asked.pictures)
    try:
        findings = look_at(asked)
    except ValueError as exc:
        fail(str(exc), code=USAGE)
    if sheet is not None and findings.page is not None:
        write_picture(sheet, findings.page)
    _tell(asked, findings, sheet, as_json=as_json)


def _board_asked(board: Path | None, at: str | None, pose_map: Path | None, theta_deg: float) -> BoardAsked | None:
    """Return what is to be registered; ends where a part of it is missing."""
    if board is None and at is None and pose_map is None:
        return None
    if board is None or at is None or pose_map is None:
        _refuse(
            "--board, --at and --map belong together",
            "--board: made by `reprobe board -o`; --at: the target below the tip; --map: calibration/map.json",
        )
    return BoardAsked(board, at, pose_map, theta_deg)


def _let_daemon_look(test_point: str | None, endpoint: str, *, as_json: bool) -> None:
    if test_point is not None and Path(test_point).suffix.lower() in SUFFIXES:
        advice = "give --around X,Y (and --control-point for one); for the tip, give it as --white with --probe"
        _refuse(f"{test_point} is a picture: what is looked for, and where?", advice)
    fields: dict[str, Any] = {"test_point": test_point} if test_point else {}
    run_job("look", endpoint, as_json=as_json, pictures=True, **fields)


def _refuse_incomplete(asked: Asked) -> None:
    """End with what to give when the options do not say what to look for, or contradict each other."""
    if asked.control_point:
        if (asked.red, asked.probe, *asked.sizes_px) != (None,) * 4:
            _refuse("a control point is looked for in one white picture", "leave out --red, --probe and the radii")
        if asked.white is None or asked.around_px is None:
            _refuse("which picture, and where in it?", "reprobe look PICTURE --control-point --around X,Y")
        return
    if asked.board is not None and asked.red is None:
        _refuse("a board is registered in a red picture", "give it with --red")
    if asked.arm_px is not None:
        _refuse("--arm-px is a control point's", "add --control-point")
    if asked.white is None and asked.red is None:
        _refuse("which picture?", "give --white with --probe, --red, or a PICTURE with --around X,Y")
    if (asked.white is None) != (asked.probe is None):
        _refuse("--white and --probe belong together", "give both; `reprobe teach` makes a probe")
    if asked.red is None and (asked.around_px, asked.reach_px, *asked.sizes_px) != (None,) * 4:
        _refuse("--around, --reach-px and the expected radii are for a red picture", "give it with --red")
    if asked.white is None and asked.around_px is None:
        _refuse("round which point?", "give --around X,Y, or --white and --probe to look round the tip")


def _refuse(problem: str, advice: str) -> NoReturn:
    fail(problem, advice=advice, code=USAGE)


def _tell(asked: Asked, findings: StoredLook, sheet: Path | None, *, as_json: bool) -> None:
    """Say what was found, what was not, and where the annotated picture is; exit accordingly."""
    if as_json:
        files = {"white": asked.white, "red": asked.red, "probe": asked.probe, "annotated": sheet}
        named = {name: None if path is None else str(path) for name, path in files.items()}
        kinds = ("tip", "test_points", "board", "control_point")
        say_json({"ok": findings.ok, **named, **{kind: findings.facts.get(kind) for kind in kinds}})
    else:
        for table in findings.tables:
            out.print(table)
        if sheet is not None:
            out.print(f"annotated picture: {escape(str(sheet))}", highlight=False, soft_wrap=True)
        _tell_missing(findings, shown=sheet is not None)
    if not findings.ok:
        raise typer.Exit(FAILED)


def _tell_missing(findings: StoredLook, *, shown: bool) -> None:
    for kind, facts in findings.facts.items():
        if not facts["found"]:
            what = f"{kind.replace('_', ' ')}: {facts['reason']}, {facts['message']}"
            err.print(f"[bold red]not found:[/] {escape(what)}", highlight=False, soft_wrap=True)
    if not findings.ok and not shown:
        say_cure("add --out look.png to see what was seen", to=err)
