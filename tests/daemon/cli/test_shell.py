"""The manual page and the completions know every command, and what they say is what their readers understand."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.cli.command_tree import commands_of
from daemon.cli.on_demand import whole
from daemon.cli.shell import made_files

pytestmark = pytest.mark.usefixtures("logging_as_before")
BASH, GROFF, ZSH, FISH = (shutil.which(name) for name in ("bash", "groff", "zsh", "fish"))
SCRIPT = "usr/local/share/bash-completion/completions/reprobe"


def _completed(tmp_path: Path, *words: str) -> set[str]:
    """Return what bash offers for the last word."""
    script = tmp_path / "reprobe.bash"
    script.write_text(made_files()[SCRIPT])
    line = " ".join(f"'{word}'" for word in ("reprobe", *words))
    ask = f"COMP_WORDS=({line}); COMP_CWORD={len(words)}; _reprobe; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    done = subprocess.run(
        [str(BASH), "-c", f"source {script}; {ask}"], capture_output=True, text=True, check=True, timeout=30
    )
    assert done.stderr == ""
    return set(done.stdout.split())


def test_hidden_commands_and_private_modules_apart_every_command_is_in_the_manual() -> None:
    page = made_files()["usr/local/share/man/man1/reprobe.1"]
    for command in commands_of(whole()):
        assert f".SS reprobe {' '.join(command.path)}".replace("-", "\\-") in page
        for flag in command.flags:
            assert flag.replace("-", "\\-") in page


@pytest.mark.skipif(GROFF is None, reason="groff is not installed")
def test_the_manual_page_is_set_without_a_warning(tmp_path: Path) -> None:
    page = tmp_path / "reprobe.1"
    page.write_text(made_files()["usr/local/share/man/man1/reprobe.1"])
    done = subprocess.run(
        [str(GROFF), "-man", "-ww", "-Tutf8", str(page)], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stderr == ""
    assert "reprobe calibrate rotation" in re.sub(".\x08", "", done.stdout), "bold is struck twice"


@pytest.mark.skipif(BASH is None, reason="bash is not installed")
def test_bash_completes_commands_options_and_choices(tmp_path: Path) -> None:
    tops = {command.path[0] for command in commands_of(whole())}
    assert _completed(tmp_path, "") == {*tops, "--help"}
    assert _completed(tmp_path, "cal") == {"calibrate"}
    assert {"tip", "map", "rotation"} <= _completed(tmp_path, "calibrate", "")
    assert "--anew" in _completed(tmp_path, "calibrate", "rotation", "--")
    assert _completed(tmp_path, "calibrate", "rotation", "--model", "f") == {"fourier"}
    assert _completed(tmp_path, "completion", "") >= {"bash", "zsh", "fish"}
    assert _completed(tmp_path, "correct", "TP7", "--board-id", "x") == set(), "only the person knows"


@pytest.mark.parametrize(("shell", "program"), [("zsh", ZSH), ("fish", FISH), ("bash", BASH)])
def test_the_shells_own_parser_takes_the_script(tmp_path: Path, shell: str, program: str | None) -> None:
    if program is None:
        pytest.skip(f"{shell} is not installed")
    result = CliRunner().invoke(app, ["completion", shell])
    script = tmp_path / "script"
    script.write_text(result.stdout)
    subprocess.run([program, "-n", str(script)], check=True, timeout=30)
