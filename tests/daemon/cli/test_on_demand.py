"""A command waits for what it needs itself, and the list of all commands for nothing."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from daemon.cli.command_table import COMMANDS, Row
from daemon.cli.on_demand import loaded, whole

ROOT = Path(__file__).parents[3]
DEMO = ROOT / "sim_hw" / "demo_board"
ANY_WORK = {"zmq", "numpy", "daemon.client", "daemon.wire"}
PICTURES = {"cv2", "scipy", "matplotlib", "vision.pads", "vision.tip"}
LOADS = """
import sys
from daemon.cli import main
sys.argv = ["reprobe", *sys.argv[1:]]
try:
    main()
finally:
    print("loaded:", *sys.modules)
"""


def _loaded(*words: str) -> set[str]:
    """Return the names of all modules that the program has loaded when a command ends."""
    done = subprocess.run(
        [sys.executable, "-c", LOADS, *words], capture_output=True, text=True, check=False, timeout=60, cwd=ROOT
    )
    return set(done.stdout.rpartition("loaded:")[2].split())


def _told_by_its_module(row: Row) -> Row:
    command = typer.main.get_group(loaded(row.module)).commands[row.name]
    paragraph = inspect.cleandoc(command.help or "").partition("\n\n")[0]
    return Row(row.name, row.module, "" if command.hidden else " ".join(paragraph.split()), command.hidden)


@pytest.mark.parametrize("row", COMMANDS, ids=lambda row: row.name)
def test_the_table_says_of_a_command_what_its_module_says(row: Row) -> None:
    assert row == _told_by_its_module(row)


def test_the_table_has_every_command_of_every_module_once() -> None:
    sources = (ROOT / "daemon" / "cli").glob("*.py")
    modules = {path.stem for path in sources if "\napp = typer.Typer(" in path.read_text()}
    assert {row.module for row in COMMANDS} == modules - {"app"}
    names = [row.name for row in COMMANDS]
    assert len(set(names)) == len(names)
    assert set(typer.main.get_group(whole()).commands) == set(names)


@pytest.mark.parametrize("words", [("--help",), ("--version",), ("statsu",), ()])
def test_the_list_of_all_commands_loads_none(words: tuple[str, ...]) -> None:
    found = _loaded(*words)
    assert "daemon.cli.command_table" in found
    assert not found & (ANY_WORK | PICTURES)
    assert not found & {f"daemon.cli.{row.module}" for row in COMMANDS}


@pytest.mark.parametrize("command", ["status", "correct", "probe", "touch", "watch", "results", "uplink", "page"])
def test_a_question_to_the_daemon_loads_no_pictures(command: str) -> None:
    found = _loaded(command, "--help")
    assert {"daemon.client", "daemon.cli.client_keys"} <= found, "it was loaded, with what all commands have"
    assert not found & (PICTURES | {"numpy", "daemon.wire.operations", "daemon.config.model"})


def test_reading_a_board_loads_no_station_and_no_seeing() -> None:
    found = _loaded("board", str(DEMO), "--json")
    assert "daemon.tools.board_import" in found
    seeing = {"vision.tip", "vision.pads", "vision.registration", "vision.annotate"}
    assert not found & {"matplotlib", "gerbonara", "daemon.procedures", "daemon.jobs", "daemon.config.model", *seeing}


def test_a_start_of_the_daemon_loads_no_command_but_its_own(tmp_path: Path) -> None:
    found = _loaded("serve", "--config", str(tmp_path / "none.toml"))
    assert {"daemon.app.service", "daemon.procedures.probe"} <= found, "every job's body is known before it is ready"
    assert not found & {"matplotlib", "scipy", "starlette", "jinja2", "daemon.tools", "daemon.page", "daemon.fleet"}
    assert not found & {f"daemon.cli.{row.module}" for row in COMMANDS if row.module != "serve"}
