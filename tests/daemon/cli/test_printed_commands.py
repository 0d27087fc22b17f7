"""Every command that the pages and the messages print exists, with the options it is printed with."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer

from daemon.cli.on_demand import whole

ROOT = Path(__file__).parents[3]
PAGES = [
    ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "doc").glob("*.md")), *sorted(ROOT.glob("*/README.md")),
    ROOT / "systemd" / "station.example.toml",
]  # fmt: skip
SOURCES = sorted((ROOT / "daemon").rglob("*.py"))
_IN_A_LINE = re.compile(r"`reprobe ([^`\n]+)`")
_ALONE = re.compile(r"^(?:[\w=./&-]+ )*reprobe ([^\n]+)$", re.MULTILINE)
_FENCED = re.compile(r"```\n(.*?)```", re.DOTALL)
COMMANDS: Any = typer.main.get_group(whole())
FOR_OTHERS = {"sim"}
"""It hands its arguments to another program."""
OF_BEFORE = {"reprobe run --config"}
"""Named as what it was once."""


def _printed(text: str) -> list[str]:
    """Return the commands of a page: those in backticks, and lines of fenced blocks."""
    text = text.replace("\\\n", " ")
    fenced = [one for block in _FENCED.findall(text) for one in _ALONE.findall(block)]
    return [one.split("  #")[0] for one in (*fenced, *_IN_A_LINE.findall(text))]


def _trouble(command: str) -> str | None:
    """Say what of a command there is not; None if all of it is there."""
    if f"reprobe {command}" in OF_BEFORE:
        return None
    words = shlex.split(re.sub(r"[|;&]", " ; ", command).split(" ; ")[0].replace("'", ""))
    found = COMMANDS
    names: list[str] = []
    while words and hasattr(found, "commands") and words[0] in found.commands:
        names.append(words.pop(0))
        found = found.commands[names[-1]]
    if not names:
        placeholder = not words or not re.match(r"[a-z][a-z-]*$", words[0])
        return None if placeholder else f"there is no command {words[0]}"
    if names[0] in FOR_OTHERS:
        return None
    known = {option for parameter in found.params for option in (*parameter.opts, *parameter.secondary_opts)}
    unknown = [word for word in words if re.match(r"--?[a-z]", word) and word.split("=")[0] not in known | {"--help"}]
    return f"{' '.join(names)} has no {unknown}" if unknown else None


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_pages_commands_exist_with_their_options(page: Path) -> None:
    assert {one: trouble for one in _printed(page.read_text()) if (trouble := _trouble(one))} == {}


def test_the_commands_that_messages_advise_exist_with_their_options() -> None:
    advised = {(one, str(source)) for source in SOURCES for one in _IN_A_LINE.findall(source.read_text())}
    assert len(advised) > 50
    assert {one: trouble for one in advised if (trouble := _trouble(re.sub(r"\{[^}]*\}", "X", one[0])))} == {}


def test_a_command_that_is_not_there_is_found() -> None:
    assert _trouble("corect TP7") == "there is no command corect"
    assert _trouble("touch TP7 --keep") == "touch has no ['--keep']"
    assert _trouble("plan check power.toml -c station.toml") is None
