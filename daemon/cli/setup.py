"""`reprobe setup`: guided set-up on a terminal, from nothing to a calibrated station; it may be interrupted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from daemon.cli import setup_file_steps as file_steps
from daemon.cli import setup_station_steps as station_steps
from daemon.cli.interruption import taken_as_ctrl_c
from daemon.cli.output import fail
from daemon.cli.setup_dialogue import Back, Choice, Dialogue, Quit, StepFailed
from daemon.cli.setup_file_steps import Setup
from daemon.cli.setup_station_steps import Daemon
from daemon.platform.logs import set_up
from daemon.tools.setup import Notes

app = typer.Typer()
STATION = Path("/etc/reprobe/station.toml")


@dataclass(frozen=True)
class Step:
    """One step; `moves` says what of the station it will move, None: nothing."""

    name: str
    title: str
    moves: str | None
    of_file: Callable[[Setup], None] | None = None
    of_station: Callable[[Setup, Daemon], Any] | None = None


NEXT_STEPS = (
    "reprobe home",
    "reprobe align                # for each board that is put in",
    "reprobe calibrate surface    # after it: nothing is touched before it is known how high this board lies",
    "reprobe place TP7",
)
HOMING = "Z up to its switch first, then X, Y and the head's angle to theirs, slowly."
_LOOKS = "the head, at working height over the board, to many places; lamps flash"
STEPS = (
    Step("name", "Name and folder", None, file_steps.name_it),
    Step("drives", "Drives and relay on the line", None, file_steps.find_drives),
    Step("mechanics", "Travel, scale and heights", None, file_steps.mechanics),
    Step("camera", "Camera", None, file_steps.camera),
    Step("board", "Board", None, file_steps.board),
    Step("meter", "Measuring instrument", None, file_steps.meter),
    Step("sockets", "Sockets", None, file_steps.sockets),
    Step("check", "Check of the whole file", None, file_steps.check),
    Step("start", "Start of the daemon", None, of_station=station_steps.start),
    Step("home", "Homing", HOMING, of_station=station_steps.home),
    Step("directions", "Directions and scale",
         "the head beside the board, down to working height; then 5 mm in X, 5 mm in Y, 10 degrees, and Z up.",
         of_station=station_steps.directions),
    Step("lamps", "Lamps", None, of_station=station_steps.lamps),
    Step("tip", "Teaching the needle's end", "the head beside the board, down to working height.",
         of_station=station_steps.tip),
    Step("map", "Map from picture to robot", "the head over the printed cross, a few mm about it; lamps flash.",
         of_station=station_steps.calibrate("map")),
    Step("rotation", "Rotation of the head", "the head over the printed cross, to 32 angles; takes minutes.",
         of_station=station_steps.calibrate("rotation")),
    Step("align", "Alignment: lay the board into its nest first", f"{_LOOKS}.",
         of_station=station_steps.calibrate("align")),
    Step("surface", "Surface of the board", "the head over a dozen test points; THE NEEDLE TOUCHES each of them.",
         of_station=station_steps.calibrate("surface")),
    Step("backlash", "Play of X and Y", "the head over the printed cross, back and forth by a few mm.",
         of_station=station_steps.calibrate("backlash")),
)  # fmt: skip


@app.command()
def setup(
    config: Annotated[
        Path, typer.Option("--config", "-c", help="The station.toml to write.", envvar="REPROBE_CONFIG")
    ] = STATION,
    anew: Annotated[bool, typer.Option("--anew", help="Do all steps again; the answers are offered.")] = False,
    only: Annotated[str | None, typer.Option("--only", help="Do this step alone: name, drives, lamps, tip ...")] = None,
) -> None:
    """Set a station up step by step: find what is plugged in, check directions and scale, teach, calibrate.

    Before each step it says what will move. Interrupted, it goes on where it was when it is called again.
    """
    steps = [step for step in STEPS if only in (None, step.name)]
    if not steps:
        fail(f"there is no step {only!r}", advice=f"one of {', '.join(step.name for step in STEPS)}", code=2)
    if not config.name or config.is_dir():
        fail(f"{config} is a folder", advice="name the file to write: -c /etc/reprobe/station.toml", code=2)
    set_up(as_json=False, level=50)
    notes = Notes(config.with_suffix(".setup.json"))
    if anew:
        notes.forget()
    guided = Setup(config, Dialogue(notes))
    if notes.lost is not None:
        guided.dialogue.say(f"{notes.path} cannot be read ({notes.lost}): what was answered before is not offered.")
    daemon = Daemon(guided)
    try:
        with taken_as_ctrl_c():
            skipped = _walk(steps, () if only else notes.done, guided, daemon)
    except (Quit, KeyboardInterrupt):
        again = f"reprobe setup -c {config}" + (f" --only {only}" if only else "")
        guided.dialogue.say(f"\nEnded here. `{again}` goes on where this was.")
        raise typer.Exit(1) from None
    finally:
        daemon.end()
    if only is None:
        _farewell(guided, skipped)
    else:
        _farewell_of_one(steps[0], guided, skipped)


def _walk(steps: Sequence[Step], done_before: Sequence[str], guided: Setup, daemon: Daemon) -> list[str]:
    """Do one step after the other; return the names of those that were skipped."""
    number, gone_back, skipped = 0, False, set[str]()
    while number < len(steps):
        step = steps[number]
        title = f"{number + 1} of {len(steps)}: {step.title}"
        if step.name in done_before and not gone_back:
            guided.dialogue.say(f"== {title}: done before")
        else:
            try:
                done = do_step(step, title, guided, daemon, first=number == 0)
            except Back:
                number, gone_back = number - 1, True
                continue
            skipped = skipped - {step.name} if done else skipped | {step.name}
        number, gone_back = number + 1, False
    return [step.name for step in steps if step.name in skipped]


def do_step(step: Step, title: str, guided: Setup, daemon: Daemon, *, first: bool = False) -> bool:
    """Do one step, again as long as the person wants; return whether it is done.

    Raises `Back` to the one before, if it is not the first. What the station did is not gone back behind.
    """
    back = step.of_file is not None and not first
    choice = _with_a_file_that_is_read(title, guided, back=back)
    if choice == "go":
        choice = guided.dialogue.before(title, step.moves)
    failed = False
    while choice == "go":
        try:
            guided.text()
            if failed and step.of_station is not None:
                station_steps.recover(guided, daemon, HOMING)
            elif step.moves is not None and step.name != "home":
                station_steps.homed_before(guided, daemon, HOMING)
            if step.of_file is not None:
                guided.dialogue.fill_in(partial(step.of_file, guided), back=back)
            if step.of_station is not None:
                step.of_station(guided, daemon)
            guided.dialogue.notes.note_done(step.name)
            return True
        except StepFailed as failure:
            failed = True
            choice = guided.dialogue.after_failure(failure, back=back)
    if choice == "quit":
        raise Quit
    guided.dialogue.say("Skipped.")
    return False


def _with_a_file_that_is_read(title: str, guided: Setup, *, back: bool) -> Choice:
    """Have a damaged file mended before a step's first question, so that nothing is answered in vain."""
    while True:
        try:
            guided.text()
        except StepFailed as failure:
            guided.dialogue.say(f"\n== {title}")
            if (choice := guided.dialogue.after_failure(failure, back=back)) != "go":
                return choice
        else:
            return "go"


def _farewell_of_one(step: Step, guided: Setup, skipped: list[str]) -> None:
    """Say what was done where one step alone was asked for: that makes no station."""
    say = guided.dialogue.say
    if skipped:
        say(f"\n{step.title}: skipped, so nothing of it has changed.")
    elif step.of_file is not None:
        say(f"\n{step.title}: done, as {guided.file} says. A daemon that runs has to be restarted for what is new.")
    else:
        say(f"\n{step.title}: done.")
    done = guided.dialogue.notes.done
    if left := [one.name for one in STEPS if one.name not in done]:
        say(f"Not done yet: {', '.join(left)}. `reprobe setup -c {guided.file}` goes through them.")


def _farewell(guided: Setup, skipped: list[str]) -> None:
    say = guided.dialogue.say
    if skipped:
        say(f"\nSkipped: {', '.join(skipped)}. `reprobe setup -c {guided.file} --only NAME` does one of them.")
    start = "`systemctl start reprobe`"
    if guided.file != STATION:
        start = f"`reprobe serve --config {guided.file}`, in a shell of its own"
    say(f"\nThe station is set up in {guided.file}. Start its daemon ({start}), then type:")
    for step in NEXT_STEPS:
        say(f"  {step}")
