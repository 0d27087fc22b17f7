"""Steps of the guided set-up with a running daemon: homing, directions and scale, lamps, teaching, calibrations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from daemon.cli.click_page import kept_picture, write_click_page
from daemon.cli.points import parse_point
from daemon.cli.progress import Interrupted, run_with_bar
from daemon.cli.setup_dialogue import StepFailed, number
from daemon.cli.setup_file_steps import Setup, whole_file
from daemon.client import Client, NoAnswer, Refused, from_here
from daemon.domain.results import JobResult
from daemon.tools.demo.processes import Process, StartError, wait_for_daemon
from daemon.tools.setup import corrected_increments, read_value

ASK_WITHIN_S, RESET_S, LONG_S = 5.0, 30.0, 3600.0
TRIAL_UM, TRIAL_DEG = 5000.0, 10.0
CLOSE = 0.02
"""A measured move that is this near to what was asked for needs no correction: a ruler is no better."""


class Daemon:
    """The station's daemon for the time of the set-up: one that runs already, or one of its own."""

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._own: Process | None = None

    @property
    def endpoint(self) -> str:
        """Where it is asked; `StepFailed` where the file has mistakes."""
        return from_here(whole_file(self._setup).api.control)

    def start(self) -> None:
        """Start it; one that answers there already is used instead."""
        if self._own is not None and self._own.alive():
            return
        config = whole_file(self._setup)
        try:
            with Client(self.endpoint, timeout_s=1.0) as client:
                there = client.request("status")["station"]
        except NoAnswer:
            pass
        else:
            _of_this_station(there, config.station.name, self.endpoint)
            return
        log = self._setup.file.with_suffix(".setup.log")
        self._own = Process("daemon", ["daemon.cli", "serve", "--config", str(self._setup.file)], log, ready_line=False)
        try:
            wait_for_daemon(self._own, self.endpoint)
        except StartError as exc:
            self.end()
            raise StepFailed(
                str(exc)[-1500:], f"see {log}; `reprobe doctor -c {self._setup.file}` examines all"
            ) from exc

    def restart(self) -> None:
        """Have it read the file again."""
        if self._own is None:
            raise StepFailed(
                "the daemon that runs here has not read the change", "systemctl restart reprobe, then go on"
            )
        self.end()
        self.start()

    def end(self) -> None:
        """End it, if it is of the set-up's own making."""
        if self._own is not None:
            self._own.end()
            self._own = None

    def reset(self) -> bool:
        """Clear a fault whose cause is gone; return whether the axes are homed, raise `StepFailed` if it stays."""
        self.start()
        try:
            with Client(self.endpoint, timeout_s=RESET_S) as client:
                client.request("reset")
        except Refused as exc:
            if exc.error["name"] == "not_homed":
                return False
            raise StepFailed(exc.error["message"], exc.error["advice"]) from exc
        except NoAnswer as exc:
            raise StepFailed(str(exc), "see that the daemon runs, then try again") from exc
        return True

    def not_homed(self) -> bool:
        """Tell whether nothing is wrong but that the axes are to be homed, as after a start."""
        self.start()
        try:
            with Client(self.endpoint, timeout_s=ASK_WITHIN_S) as client:
                fault = client.request("status")["fault"]
        except NoAnswer as exc:
            raise StepFailed(str(exc), "see that the daemon runs, then try again") from exc
        return fault is not None and fault["name"] == "not_homed"

    def job(self, op: str, **fields: Any) -> JobResult:
        """Do a short job; raise `StepFailed` if it fails."""
        self.start()
        try:
            with Client(self.endpoint, timeout_s=ASK_WITHIN_S) as client:
                result = client.job(op, timeout_s=LONG_S, **fields)
        except Refused as exc:
            raise StepFailed(exc.error["message"], exc.error["advice"]) from exc
        except NoAnswer as exc:
            raise StepFailed(str(exc), "see that the daemon runs, then try again") from exc
        if result.error is not None:
            raise StepFailed(result.error.message, result.error.advice)
        return result

    def z_um(self) -> float:
        """Return the height that Z has, as its drive counts it."""
        with Client(self.endpoint, timeout_s=ASK_WITHIN_S) as client:
            return float(client.request("status")["needle"]["z_um"])

    def long_job(self, op: str, **fields: Any) -> None:
        """Do a job of minutes with a bar; what went wrong has been said when it raises `StepFailed`."""
        self.start()
        try:
            run_with_bar(op, self.endpoint, as_json=False, alone=False, **fields)
        except Interrupted as exc:
            raise StepFailed("it was stopped by Ctrl-C", "try again: a rotation goes on where it was") from exc
        except typer.Exit as exc:
            if exc.exit_code:
                raise StepFailed(
                    "it was refused or stopped: see above", "do what stands there, then try again"
                ) from exc


def _of_this_station(there: str, here: str, endpoint: str) -> None:
    """Raise `StepFailed` where the daemon that answers is another station's: its head is not to be moved from here."""
    if there != here:
        raise StepFailed(
            f"at {endpoint} the daemon of {there!r} answers, and this is {here!r}: nothing is moved there",
            "give this station sockets of its own (`--only sockets`); if it is this one by its old name, restart it",
        )


def start(_setup: Setup, daemon: Daemon) -> None:
    """Start the daemon, which opens all devices."""
    daemon.start()


def home(_setup: Setup, daemon: Daemon) -> None:
    """Home all axes."""
    daemon.reset()
    daemon.job("home")


def homed_before(setup: Setup, daemon: Daemon, homing: str) -> None:
    """Home before a step that moves, where the daemon was started since: a set-up may have been interrupted."""
    if daemon.not_homed():
        _home_again(setup, daemon, "Homing first: the daemon was started again", homing)


def recover(setup: Setup, daemon: Daemon, homing: str) -> None:
    """Clear what a failed step left, before it is tried again; `homing`: what moves where the axes are to be homed."""
    if not daemon.reset():
        _home_again(setup, daemon, "Homing, which the failure has undone", homing)


def _home_again(setup: Setup, daemon: Daemon, title: str, homing: str) -> None:
    if setup.dialogue.before(title, homing) != "go":
        raise StepFailed("the axes are not homed", "try again, and let them be homed")
    daemon.job("home")


def directions(setup: Setup, daemon: Daemon) -> None:
    """Move each axis a little and ask how far it went and which way; correct the scale until it is right."""
    x_um, y_um = _quiet_place(setup)
    trials = (
        ("x", "to the right", TRIAL_UM, {"board_um": (x_um + TRIAL_UM, y_um), "theta_deg": 0.0}),
        ("y", "to the back", TRIAL_UM, {"board_um": (x_um, y_um + TRIAL_UM), "theta_deg": 0.0}),
    )
    for axis, way, asked, there in trials:
        while True:
            daemon.job("place", board_um=(x_um, y_um), theta_deg=0.0)
            setup.dialogue.ready(f"Look at the head: it moves {asked / 1e3:g} mm {way} (+{axis.upper()}).")
            daemon.job("place", **there)
            if not _corrected(setup, axis, asked / 1e3, "mm"):
                break
            daemon.restart()
            home(setup, daemon)
    _turned(setup, daemon)
    while True:
        daemon.job("place", board_um=(x_um, y_um), theta_deg=0.0)
        before_um = daemon.z_um()
        setup.dialogue.ready("Look at the needle: it rises by a few mm (+Z).")
        daemon.job("lift")
        if not _corrected(setup, "z", (daemon.z_um() - before_um) / 1e3, "mm"):
            break
        daemon.restart()
        home(setup, daemon)


def _turned(setup: Setup, daemon: Daemon) -> None:
    """Do the same for the head's angle, by the drives' own numbers: a place keeps the tip where it is."""
    x_um, y_um = _quiet_place(setup)
    while True:
        daemon.job("place", board_um=(x_um, y_um), theta_deg=0.0)
        setup.dialogue.ready(f"Look at the head: it turns by {TRIAL_DEG:g} degrees counter-clockwise, seen from above.")
        daemon.job("place", board_um=(x_um, y_um), theta_deg=TRIAL_DEG)
        if not _corrected(setup, "theta", TRIAL_DEG, "degrees"):
            return
        daemon.restart()
        home(setup, daemon)


def _corrected(setup: Setup, axis: str, asked: float, unit: str) -> bool:
    """Ask how far an axis went; return whether its scale had to be corrected."""
    path = f"axes.{axis}.increments_per_unit"
    now = float(read_value(setup.text(), path))
    question = f"How far did it go, {unit}; negative if the other way"

    def check(said: str) -> float:
        return corrected_increments(now, asked, number(-1e4, 1e4, unit)(said))

    # What was measured once is no answer to offer: after a correction it is another move
    new = setup.dialogue.ask(f"{axis}.moved.{now:g}", question, f"{asked:g}", check)
    if abs(new / now - 1.0) <= CLOSE:
        return False
    setup.dialogue.say(f"  {path}: {now:.6g} becomes {new:.6g}")
    if not setup.dialogue.yes("Is that so? n: measure again, nothing is changed"):
        return True
    setup.write({path: new})
    setup.dialogue.ready("The daemon restarts and homes: Z up to its switch, then the others. Then the move again.")
    return True


def _quiet_place(setup: Setup) -> tuple[float, float]:
    """Return the place beside the board where trial moves are made and the tip is taught; um, board frame."""

    def check(said: str) -> tuple[float, float]:
        x_mm, y_mm = parse_point(said)
        return x_mm * 1e3, y_mm * 1e3

    known = setup.dialogue.notes.answer("quiet place")
    if known is not None:
        return check(known)
    question = (
        "A place beside the board with nothing in the way and a dark, quiet ground: X,Y from the board's corner, mm"
    )
    return setup.dialogue.ask("quiet place", question, "-9,15", check)


def lamps(setup: Setup, daemon: Daemon) -> None:
    """Flash white, then red, and put the channels right."""
    while True:
        setup.dialogue.say("The lamps flash now: white, then red.")
        result = daemon.job("look", pictures=True)
        setup.dialogue.say(f"The pictures are in {result.pictures}: before-white.jpg and before-red.jpg.")
        if setup.dialogue.yes("Did the white ring shine first, and the red one then?"):
            return
        white, red = (int(read_value(setup.text(), f"lights.{lamp}") or 0) for lamp in ("white", "red"))
        setup.dialogue.say(f"  the channels are swapped: white {red}, red {white}")
        setup.write({"lights.white": red, "lights.red": white})
        setup.dialogue.ready("The daemon restarts and homes: Z up to its switch, then the others.")
        daemon.restart()
        home(setup, daemon)


def tip(setup: Setup, daemon: Daemon) -> None:
    """Take a white picture of the needle before a quiet ground, and have its end pointed at."""
    daemon.job("place", board_um=_quiet_place(setup), theta_deg=0.0)
    result = daemon.job("look", pictures=True)
    if result.pictures is None:
        raise StepFailed("the picture was not kept", "see station.pictures and the room on the disk, then try again")
    page = setup.file.with_suffix(".tip.html")
    write_click_page(kept_picture(Path(result.pictures) / "before-white.jpg"), page)
    setup.dialogue.say(f"Open {page} in a browser, click the very end of the needle five times.")
    place = setup.dialogue.ask(f"tip.{result.id}", "The place that the page shows, X,Y", "", parse_point)
    daemon.long_job("calibrate", what="tip", tip_px=place)


def calibrate(what: str) -> Any:
    """Return the step of one calibration."""

    def step(_setup: Setup, daemon: Daemon) -> None:
        if what == "align":
            daemon.long_job("align")
        else:
            daemon.long_job("calibrate", what=what)

    return step
