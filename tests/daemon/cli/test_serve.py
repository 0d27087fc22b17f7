"""The daemon's own command, `reprobe serve`, and the name it had."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from daemon.cli.command_tree import commands_of
from daemon.cli.on_demand import whole


def _reprobe(*words: str) -> tuple[int, str]:
    """Return what the program itself says, whose entry decides which commands are loaded."""
    done = subprocess.run(
        [sys.executable, "-m", "daemon.cli", *words], capture_output=True, text=True, check=False, timeout=60
    )
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize(
    "words", [("serve", "-c"), ("serve", "--json", "--config"), ("run", "-c"), ("run", "--config")]
)
def test_the_daemon_reads_the_configuration_it_is_given_by_either_name(words: tuple[str, ...], tmp_path: Path) -> None:
    code, said = _reprobe(*words, str(tmp_path / "none.toml"))
    assert code == 2
    assert "none.toml" in said
    assert "cannot be read" in said


def test_the_old_name_is_shown_nowhere() -> None:
    (run,) = [command for command in commands_of(whole()) if command.path == ("run",)]
    assert "--config" not in run.flags
    assert ("serve",) in [command.path for command in commands_of(whole())]


def test_a_run_by_the_program_itself_takes_a_key(tmp_path: Path) -> None:
    """It is a command of testers, and is loaded as such."""
    code, said = _reprobe("run", "power", "--board-id", "SN-1", "--key", str(tmp_path / "none.key"))
    assert code in (1, 2)
    assert "none.key" in said


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_stream_that_is_closed_ends_no_command_in_a_traceback(closed: str, tmp_path: Path) -> None:
    """The code is the answer's, and what is said goes where there is somebody."""
    script = f'exec "$0" -m daemon.cli check-config "$1" {closed}'
    words = ["/bin/sh", "-c", script, sys.executable, str(tmp_path / "none.toml")]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert ("cannot be read" in done.stdout) is (">&-" not in closed.replace("2>&-", ""))


def test_a_run_of_nothing_names_both_commands() -> None:
    code, said = _reprobe("run")
    assert code == 2
    assert "`reprobe run PLAN --board-id ID`" in said
    assert "`reprobe serve --config station.toml`" in said
