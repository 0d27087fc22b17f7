"""`reprobe demo`: three processes, all nets of a board, one line of figures, one page with pictures."""

from __future__ import annotations

import importlib.util
import shutil
import signal
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from daemon.cli.board_run import in_words
from daemon.cli.interruption import ENDING, taken_as_ctrl_c
from daemon.cli.output import FAILED, USAGE, AsJson, err, fail, out, say_json
from daemon.client import NoAnswer, Refused
from daemon.config.model import Config, load_config
from daemon.domain.board import Board, BoardPoint
from daemon.domain.counted import counted
from daemon.domain.point_test import PointRecord
from daemon.page.people import USERS_FILE, Users
from daemon.station.reach import in_reach_at_all_angles
from daemon.storage.journal_reader import JournalReader
from daemon.tools.board_import import Options, import_board
from daemon.tools.demo.board_test import BOARD_ID, RUN, Trouble, run_board
from daemon.tools.demo.fixture import Fixture
from daemon.tools.demo.page_beside import PageBeside, is_installed, new_page
from daemon.tools.demo.processes import Process, StartError
from daemon.tools.demo.running import JOURNAL, Bench, Running, running
from daemon.tools.demo.session import Session, SetUpError, choose_points
from daemon.tools.demo.settings import Places
from daemon.tools.demo.story import Story, judge
from daemon.tools.demo.story_page import RUN_FOLDER, told_as_json, write_story
from daemon.tools.demo.truth_log import Tail, stretch
from daemon.tools.report.run_facts import RunReport, report_of

app = typer.Typer()
MARK = ".reprobe-demo"
"""File that tells a folder of a demonstration from every other."""
ROTATION_ANGLES = 18
"""Fewer than a station would take: what the head's model leaves, the eye corrects."""
SPEED = 2.0
"""So that it takes some two minutes; what the computer needs then counts twice in the seconds a point."""
SEED = 8
"""Its board has some of each trouble."""
ALL = 5000
"""Nets: as many as a run takes."""


@app.command()
def demo(
    board: Annotated[
        Path | None, typer.Option(help="A board's CAD folder; the project's own board by default.")
    ] = None,
    side: Annotated[Literal["top", "bottom"], typer.Option(help="The side that is probed.")] = "top",
    assembled: Annotated[
        bool, typer.Option("--assembled", help="With parts on the board; without, it is bare.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Of everything random in the simulated station.")] = SEED,
    points: Annotated[
        int | None,
        typer.Option(min=1, max=ALL, help="At most so many nets; all of them by default.", show_default=False),
    ] = None,
    speed: Annotated[float, typer.Option(min=0.1, max=10.0, help="Speed of the simulated time.")] = SPEED,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the report.")] = Path("out/demo"),
    page: Annotated[
        bool, typer.Option("--page", help="Show it at the operator's page too, until Ctrl-C ends it.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Test all nets of a simulated board; exit 1 if one has no answer or a wrong one, or anything was scratched."""
    folder = board or _own_board()
    try:
        read = import_board(folder, side, Options(keep=board is not None, bare=not assembled))
    except ValueError as exc:
        fail(str(exc), code=USAGE)
    if not choose_points(read, ALL):
        fail(
            f"{read.name} has no target on its {side} that may be touched",
            advice=f"`reprobe board {folder} --side {side}` says why; try the other side",
            code=USAGE,
        )
    if page and not is_installed():
        fail("the page is not installed", advice="pip install 'reprobe[page]'", code=USAGE)
    # Ended from outside, it still ends the processes it started.
    for number in ENDING:
        signal.signal(number, _ENDING.ask)
    _claim(output)
    read.save(output / "board.json")
    wish = Bench(folder, assembled, seed, speed)
    try:
        with tempfile.TemporaryDirectory(prefix="reprobe-") as sockets:
            story, report = _run(Places(output, Path(sockets)), read, wish, points or ALL, page=page)
    except (StartError, SetUpError, Refused, NoAnswer) as exc:
        fail(str(exc), advice=f"see {output}/daemon.log and {output}/sim.log")
    written = write_story(story, report, output, speed)
    _tell(story, speed, as_json=as_json)
    err.print(f"page: {written}", highlight=False, soft_wrap=True)
    if not story.good:
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


def _run(places: Places, read: Board, wish: Bench, points: int, *, page: bool) -> tuple[Story, RunReport]:
    """Start the processes, let the tester work, end the processes; what was said is judged by the truth log."""
    # What an earlier demonstration left would be answered from its journal, and its report be taken for this one's.
    for left in ("station", RUN_FOLDER):
        shutil.rmtree(places.out / left, ignore_errors=True)
    (places.out / "truth.jsonl").unlink(missing_ok=True)
    with _progress() as progress:
        task = progress.add_task("starting", total=None)

        def tell(text: str, done: int = 0, total: int | None = None) -> None:
            progress.update(task, description=text, completed=done, total=total)
            if not err.is_terminal:  # a bar is drawn on a terminal only
                err.print(f"{done}/{total} {text}" if done else text, highlight=False, soft_wrap=True)

        tell("starting the simulated station and the daemon")
        with running(places, read, wish, _ENDING.held) as station, _beside(places, wanted=page) as beside:
            session = Session(station.client, station.bench, read, wish.seed, tell)
            session.set_up()
            session.show_the_eye()
            session.calibrate_fully(ROTATION_ANGLES, BOARD_ID)
            tested = _test(places, read, station, points, tell)
            if beside is not None:
                progress.stop()
                Trouble.stop_leading_astray(station.bench)
                # However it is told to end while it stays: what was tested is told all the same.
                with suppress(KeyboardInterrupt), taken_as_ctrl_c():
                    _tell_where(beside.url, places.socket("control"))
                    signal.pause()
            return tested


def _tell_where(url: str, control: str) -> None:
    """Say where the station that stays is seen and asked."""
    err.print(f"the page stays at {url} until Ctrl-C", highlight=False, soft_wrap=True)
    err.print(f"ask the station from another shell: export REPROBE_CONTROL={control}", highlight=False, soft_wrap=True)


def _test(
    places: Places, read: Board, station: Running, points: int, tell: Callable[..., None]
) -> tuple[Story, RunReport]:
    """Let trouble loose, test the nets, and put the truth beside what was said."""
    Trouble().let_loose(station.bench)
    fixture, tail = Fixture(station.bench), Tail(places.out / "truth.jsonl")
    chosen = _choose(load_config(station.settings), read, fixture, points)
    station.bench.ask("truth")  # what the needle did so far is written down
    tail.take()
    tell(f"testing {counted(len(chosen), 'net')}")
    done: list[PointRecord] = []

    def told(record: PointRecord) -> None:
        done.append(record)
        tell(in_words(record), len(done), len(chosen))

    result = run_board(station.client, station.daemon, places.socket("events"), read, chosen, told)
    station.bench.ask("truth")
    happened = stretch(tail.take())
    with JournalReader(places.out / JOURNAL) as journal:
        run, records = journal.run(RUN), list(journal.points(RUN))
    if run is None:
        why = result.error.message if result.error is not None else result.outcome
        raise SetUpError(f"the run did not begin: {why}")
    return judge(read, records, result, len(chosen), fixture, happened), report_of(run, records)


def _choose(config: Config, read: Board, fixture: Fixture, points: int) -> list[BoardPoint]:
    """Return the best point of each net that the harness reaches, where the head does at every angle."""
    channels = config.meter.channels if config.meter is not None else {}
    within = in_reach_at_all_angles(config, read.points)
    chosen = choose_points(read.model_copy(update={"points": within}), ALL)
    measured = [point for point in chosen if point.net in channels and fixture.net_of(point) is not None]
    if not measured:
        raise SetUpError(f"no net of {read.name} ({read.side}) is in the harness and where the head reaches")
    step = max(1.0, len(measured) / points)
    return [measured[int(k * step)] for k in range(min(points, len(measured)))]


class _Ending:
    """End the program when it is told to, but not between a process' start and the promise to end it."""

    def __init__(self) -> None:
        self._held = self._asked = False

    def ask(self, *_: object) -> None:
        """Take a signal to end."""
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
def _beside(places: Places, *, wanted: bool) -> Iterator[PageBeside | None]:
    """Hold the operator's page, where it is wanted, and open it in a browser."""
    if not wanted:
        yield None
        return
    beside = new_page(places.socket("control"), places.out / "page")
    Users(beside.folder / USERS_FILE).add(beside.person, "maintain", beside.password)
    with ExitStack() as stack:
        with _ENDING.held():
            process = Process("page", beside.arguments, places.out / "page.log", ready_line=False)
            stack.callback(process.end)
        err.print(
            f"page: {beside.url}  looks without a login; to give orders: {beside.person}, {beside.password}",
            highlight=False, soft_wrap=True, markup=False,
        )  # fmt: skip
        webbrowser.open(beside.url)
        yield beside


def _progress() -> Progress:
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<28}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    return Progress(*columns, console=err, transient=True)


def _tell(story: Story, speed: float, *, as_json: bool) -> None:
    """Print the figures, and what is wrong; or the same as JSON."""
    sentence = story.sentence(speed)
    if as_json:
        say_json(told_as_json(story, sentence))
        return
    for one in story.points:
        if one.wrong:
            out.print(f"{one.record.point}: {one.wrong}", style="bold red", highlight=False, soft_wrap=True)
    for trouble in filter(None, (story.why and f"the run ended early: {story.why}", story.odd)):
        out.print(trouble, style="bold red", highlight=False, soft_wrap=True)
    out.print(sentence, style="green" if story.good else "red", highlight=False, soft_wrap=True)
