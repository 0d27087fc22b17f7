"""Table of the commands: where each is defined, and what the list of all commands says of it.

A command that is asked for waits for its own module alone; the list of all waits for none. A test holds the table
against the modules.
"""

from __future__ import annotations

from typing import NamedTuple


class Row(NamedTuple):
    """One command, or one group of commands."""

    name: str
    module: str
    """Within `daemon.cli`; its `app` has the command."""
    help: str = ""
    """The first paragraph of its help."""
    hidden: bool = False
    """Whether it is an old name, which goes on working and is shown nowhere."""


COMMANDS = (
    Row("serve", "serve", "Run the daemon until SIGTERM or Ctrl-C."),
    Row("sim", "serve", "Run the simulated station; all arguments are its own (see reprobe sim --help)."),
    Row(
        "setup",
        "setup",
        "Set a station up step by step: find what is plugged in, check directions and scale, teach, calibrate.",
    ),
    Row(
        "check-config",
        "check_config",
        "Check a configuration and the board file it names; print every problem with its line, its path and its cure.",
    ),
    Row("trigger", "tester", hidden=True),
    Row("correct", "tester", "Say that a test point reads open: the daemon looks, corrects, verifies and answers."),
    Row("place", "tester", "Put the tip over a test point or a place of the board, at working height."),
    Row("home", "tester", "Home all axes."),
    Row(
        "jog",
        "tester",
        "Move one axis by one small step: sideways only at the safe height, down only where no surface can be.",
    ),
    Row("cancel", "tester", "Stop the running job, or the one named, safely."),
    Row(
        "pause",
        "tester",
        "Have the run that is under way end after the point under test; `reprobe run --resume` goes on with it.",
    ),
    Row(
        "reset",
        "tester",
        "Clear a fault once its cause is gone; where only homing is left then, the reset has worked, and says so.",
    ),
    Row("status", "tester", "Say what the daemon is doing."),
    Row("describe", "ask", "Say who this station is, what you may ask of it, and which test points it knows."),
    Row("result", "ask", "Show how a job ended, also one of another client."),
    Row("results", "ask", "List results from an event number on, as a client that was away asks for them."),
    Row("points", "ask", "List what came of a run's points, in the order in which they were tested."),
    Row("point", "ask", "Look back over the tests of one point, newest first."),
    Row("mark", "ask", "Forbid a point of the board to the needle, or approve it again."),
    Row("marks", "ask", "List which points of the board people have forbidden or approved, and why."),
    Row("hold", "ask", "Keep the needle down for longer: renew the lease of a touch."),
    Row(
        "report",
        "ask",
        "Tell the daemon what the re-test after a job saw, and how many touches there were; maintenance lives on it.",
    ),
    Row("history", "records", "Look back over results, newest first."),
    Row("audit", "records", "Show who gave which order, newest first."),
    Row(
        "records",
        "records",
        "Show all that is kept, oldest first and under one count, as `reprobe uplink` fetches it.",
    ),
    Row("note", "records", "Write down what a person did at a program of your own; `reprobe audit` shows it."),
    Row("pictures", "records", "List the pictures that are kept of a job."),
    Row("picture", "records", "Fetch one kept picture of a job."),
    Row("config", "records", "Show the settings in force, and which of them the station's file does not give."),
    Row("light", "records", "Switch a lamp on for a while, in idle only: to see with the live picture."),
    Row("touch", "touch", "Lower the needle onto the test point below it, and lift it again."),
    Row(
        "lift",
        "touch",
        "End the touch that holds the needle down; where none does, raise the needle straight up to the safe height.",
    ),
    Row("run", "run_board", "Test a board by a plan, and show each point as it is done."),
    Row(
        "probe",
        "probe",
        "Test one point: place, touch, measure; where that is no pass look, correct and pump "
        "before anybody is accused.",
    ),
    Row(
        "watch",
        "watch",
        "Show the daemon live, until Ctrl-C: state, job, results, alerts, links. Line by line when piped.",
    ),
    Row(
        "align",
        "calibrate",
        "See which board lies in the nest, and where: from places that are found once on it, or from round targets.",
    ),
    Row(
        "study",
        "study",
        "Study how well the station lands: leave the point, land on it again and look, many times; Cg, Cgk and plots.",
    ),
    Row(
        "look",
        "look",
        "Look at stored pictures and say what is seen; without any, let the daemon take a look where the head is.",
    ),
    Row("teach", "teach", "Teach a probe from a stored white picture, check that it is found again, and write it."),
    Row(
        "board",
        "import_board",
        "Read a board's CAD: say which nets can be probed, from where, and why the rest cannot; write the board file.",
    ),
    Row("alerts", "health", hidden=True),
    Row(
        "health",
        "health",
        "Show how the station is: every alert with what to do, every watch. Exit code 0: healthy, 1: alert or fault.",
    ),
    Row("acknowledge", "health", "Say that you know of an alert."),
    Row(
        "month",
        "health",
        "Write a month of the station's health as one HTML page, out of the journal; no daemon is needed.",
    ),
    Row(
        "board-report",
        "board_report",
        "Write a run over a board as a page with its map, CSV, JSON lines and JUnit XML; no daemon is needed.",
    ),
    Row(
        "uplink",
        "fleet",
        "Send this station's records to a broker until SIGTERM or Ctrl-C; nothing is ever commanded from there.",
    ),
    Row(
        "collect",
        "fleet",
        "Store what all stations send, each record once, in a database; brings its schema up to date.",
    ),
    Row(
        "doctor",
        "doctor",
        "Examine a station: ports, drives, lights, camera, permissions, disk, time. The head does not move.",
    ),
    Row(
        "backup",
        "backup",
        "Write configuration, board file, calibrations, plans and journal into one archive; also "
        "while the daemon runs.",
    ),
    Row(
        "restore",
        "backup",
        "Put a backup back while the daemon is stopped; what is there is moved aside, nothing is deleted.",
    ),
    Row(
        "bundle",
        "bundle",
        "Write a support bundle: configuration, versions, journal, calibrations, pictures, metrics, log; no secrets.",
    ),
    Row(
        "install",
        "install",
        "Lay out units, user, device rules and folders; what you have edited is left alone. May be run again.",
    ),
    Row(
        "uninstall",
        "uninstall",
        "Take away units, rules, manual page and completions; configuration and state only when you say so.",
    ),
    Row(
        "schema",
        "schema",
        "Print the JSON Schemas of everything on the wire, or write them with the pages that explain it.",
    ),
    Row(
        "completion",
        "shell",
        "Print a shell's completion script; `reprobe install` puts it where the shell finds it.",
    ),
    Row("manual", "shell", "Print the manual page, as man(1) reads it; `reprobe install` puts it in its place."),
    Row(
        "demo",
        "demo",
        "Test all nets of a simulated board; exit 1 if one has no answer or a wrong one, or anything was scratched.",
    ),
    Row("calibrate", "calibrate", "Calibrate: tip, map, rotation, surface, backlash."),
    Row("plan", "plan", "Test plans: which points are tested, how, and by which limits."),
    Row("journal", "journal", "The station's journal: list, show, export."),
    Row("keys", "keys", "Keys of clients that reach the daemon from outside: new, list, revoke."),
    Row("page", "page", "The operator's page in a browser."),
)
