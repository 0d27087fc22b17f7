"""`reprobe demo`: three processes, twelve points, one table, one report."""

from __future__ import annotations

import importlib.util
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from daemon.cli.output import FAILED, USAGE, AsJson, err, fail, out, say_json
from daemon.client import Client, NoAnswer, Refused
from daemon.domain.board import Board
from daemon.tools.cad_import import import_board
from daemon.tools.demo.processes import DemoBench, Process, StartError, wait_for_daemon
from daemon.tools.demo.report import write_report
from daemon.tools.demo.session import LIMIT_UM, Landing, Session, SetUpError, choose_points
from daemon.tools.demo.settings import Places, write_settings

app = typer.Typer()
MARK = ".reprobe-demo"
"""File that tells a folder of a demonstration from every other."""
ROTATION_ANGLES = 24
"""Enough for a smooth model of the head."""


@app.command()
def demo(
    board: Annotated[
        Path | None, typer.Option(help="A board's CAD folder; the project's own board by default.")
    ] = None,
    side: Annotated[Literal["top", "bottom"], typer.Option(help="The side that is probed.")] = "top",
    seed: Annotated[int, typer.Option(help="Of everything random in the simulated station.")] = 1,
    points: Annotated[int, typer.Option(min=1, help="At most so many test points.")] = 12,
    speed: Annotated[float, typer.Option(min=0.1, max=10.0, help="Speed of the simulated time.")] = 1.0,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the report.")] = Path("out/demo"),
    as_json: AsJson = False,
) -> None:
    """Run simulated station, daemon and tester; exit 1 if any point ends more than 50 um off or without an answer."""
    folder = board or _own_board()
    try:
        read = import_board(folder, side)
    except ValueError as exc:
        fail(str(exc), code=USAGE)
    chosen = choose_points(read, points)
    if not chosen:
        fail(
            f"{read.name} has no probe-able round target on its {side}",
            advice=f"`reprobe board {folder} --side {side}` says why; try the other side",
            code=USAGE,
        )
    # Ended from outside, it still ends the processes it started.
    signal.signal(signal.SIGTERM, _ENDING.ask)
    _claim(output)
    (output / "board.json").write_text(read.model_dump_json(indent=1))
    try:
        with tempfile.TemporaryDirectory(prefix="reprobe-") as sockets:
            landings = _run(Places(output, Path(sockets)), folder, read, seed=seed, points=points, speed=speed)
    except (StartError, SetUpError, Refused, NoAnswer) as exc:
        fail(str(exc), advice=f"see {output}/daemon.log and {output}/sim.log")
    report = write_report(output, read, seed, landings)
    _tell(landings, as_json=as_json)
    err.print(f"report: {report}", highlight=False, soft_wrap=True)
    if len(landings) < len(chosen) or not all(landing.good for landing in landings):
        raise typer.Exit(FAILED)


def _claim(folder: Path) -> None:
    """Make the folder, or take one that an earlier demonstration made; refuse every other that has something in it.

    What an earlier demonstration left there is deleted: in a station's own folder that would be its journal.
    """
    mark = folder / MARK
    try:
        folder.mkdir(parents=True, exist_ok=True)
        foreign = not mark.is_file() and any(folder.iterdir())
        if not foreign:
            mark.write_text("Made by `reprobe demo`, which deletes what it finds here.\n")
    except OSError as exc:
        fail(f"{folder} cannot be used: {exc.strerror}", code=USAGE)
    if foreign or (folder / "station").is_symlink():
        fail(
            f"{folder} was not made by `reprobe demo`, and nothing in it is touched",
            advice="choose a new folder with -o, or remove this one if nothing in it is wanted",
            code=USAGE,
        )


def _own_board() -> Path:
    """Return the folder of the board that comes along; its package is found, not imported."""
    spec = importlib.util.find_spec("sim_hw")
    if spec is None or spec.origin is None:
        fail("the simulated station is not installed", advice="pip install 'reprobe[sim]'", code=USAGE)
    return Path(spec.origin).parent / "demo_board"


def _run(places: Places, folder: Path, read: Board, *, seed: int, points: int, speed: float) -> list[Landing]:
    """Start the processes, let the tester work, end the processes."""
    # What an earlier demonstration left would be answered from its journal.
    shutil.rmtree(places.out / "station", ignore_errors=True)
    (places.out / "truth.jsonl").unlink(missing_ok=True)
    settings = write_settings(places)
    with _progress() as progress:
        task = progress.add_task("starting", total=None)
        with _processes(places, settings, folder, read.side, seed, speed) as (client, bench):
            session = Session(client, bench, read, seed, lambda text: progress.update(task, description=text))
            session.set_up()
            session.calibrate_fully(ROTATION_ANGLES)
            chosen = choose_points(read, points)
            progress.update(task, total=len(chosen))
            landings = []
            for point in chosen:
                progress.update(task, description=point.name)
                landings.append(session.land(point))
                progress.advance(task)
            return landings


class _Ending:
    """End the program when it is told to, but not between a process' start and the promise to end it."""

    def __init__(self) -> None:
        self._held = self._asked = False

    def ask(self, *_: object) -> None:
        """Take SIGTERM."""
        self._asked = True
        if not self._held:
            sys.exit(FAILED)

    @contextmanager
    def held(self) -> Iterator[None]:
        """Put the end off until the block is over."""
        self._held = True
        try:
            yield
        finally:
            self._held = False
        if self._asked:
            sys.exit(FAILED)


_ENDING = _Ending()


@contextmanager
def _processes(places: Places, settings: Path, folder: Path, side: str, seed: int, speed: float
               ) -> Iterator[tuple[Client, DemoBench]]:  # fmt: skip
    """Hold the simulated station and the daemon, and end them whatever happens."""
    sim_arguments = [
        "sim_hw", "--board", str(folder), "--side", side, "--seed", str(seed), "--speed", str(speed),
        "--line", places.line, "--camera", places.socket("camera"), "--bench", places.socket("bench"),
        "--truth", str(places.out / "truth.jsonl"),
    ]  # fmt: skip
    daemon_arguments = ["daemon.cli", "run", "--config", str(settings), "--json"]
    with ExitStack() as stack:

        def start(name: str, arguments: list[str], log: str, *, ready_line: bool) -> Process:
            with _ENDING.held():
                process = Process(name, arguments, places.out / log, ready_line=ready_line)
                stack.callback(process.end)
            return process

        bench = DemoBench(start("simulated station", sim_arguments, "sim.log", ready_line=True).ready()["bench"])
        stack.callback(bench.close)
        daemon = start("daemon", daemon_arguments, "daemon.log", ready_line=False)
        wait_for_daemon(daemon, places.socket("control"))
        with Client(places.socket("control"), timeout_s=10.0) as client:
            yield client, bench


def _progress() -> Progress:
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<28}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    return Progress(*columns, console=err, transient=True)


def _tell(landings: list[Landing], *, as_json: bool) -> None:
    """Print the table, or the same as JSON."""
    if as_json:
        say_json(
            [
                {"test_point": x.point.name, "kind": x.point.kind, "theta_deg": x.theta_deg, "before_um": x.before_um,
                 "after_um": x.after_um, "good": x.good, "result": x.result.model_dump(mode="json")}
                for x in landings
            ]
        )  # fmt: skip
        return
    table = Table(title="errors from the truth log; times in ms")
    for column in ("point", "kind", "theta", "before um", "after um", "looks", "triggered", "look", "move", "verify",
                   "software", "answer"):  # fmt: skip
        table.add_column(column, justify="left" if column in ("point", "kind", "answer") else "right")
    for x in landings:
        table.add_row(*_row(x), style="" if x.good else "bold red")
    out.print(table)
    good = sum(x.good for x in landings)
    out.print(f"{good} of {len(landings)} within {LIMIT_UM:.0f} um", style="green" if good == len(landings) else "red")


def _row(x: Landing) -> list[str]:
    timing = x.result.timing_ms
    states = [f"{timing.get(state, {}).get('total', 0.0):.0f}" for state in ("triggered", "look", "move", "verify")]
    software = sum(row["software"] for row in timing.values())
    answer = x.result.outcome if x.result.error is None else x.result.error.name
    errors = [f"{x.theta_deg:.1f}", f"{x.before_um:.0f}", f"{x.after_um:.1f}"]
    return [x.point.name, x.point.kind, *errors, str(x.result.looks), *states, f"{software:.0f}", answer]
