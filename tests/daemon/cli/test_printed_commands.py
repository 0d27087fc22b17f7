"""Every command that the pages and the messages print exists, with the options it is printed with."""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from daemon.cli.formatting import as_commands
from daemon.cli.on_demand import whole
from daemon.domain.errors import FaultCode
from daemon.maintenance.catalogue import all_specs
from daemon.tools.messages import faults
from daemon.wire.operations.table import OPERATIONS

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


def _bare(text: str) -> list[str]:
    """Return what in backticks begins like a command of the program and does not say its name."""
    quoted = re.findall(r"`([^`\n]+)`", text)
    return [one for one in quoted if one.split()[0] in {*OPERATIONS.ops, *COMMANDS.commands}]


def _texts(path: Path) -> Iterator[str]:
    """Yield the texts of a module, its docstrings left out."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
            yield node.value


AT_A_SHELL = ("cli", "tools/backup", "tools/doctor", "tools/demo", "tools/setup", "tools/report", "config/problems.py")
"""What is said at a shell by the computer one sits at: no daemon's words that a command puts into its own."""


def test_what_is_said_at_a_shell_is_typed_with_the_programs_name() -> None:
    folders = [ROOT / "daemon" / one for one in AT_A_SHELL]
    files = [file for one in folders for file in ([one] if one.is_file() else sorted(one.rglob("*.py")))]
    assert len(files) > 60
    said = [(str(file), text) for file in files for text in _texts(file)]
    assert [(file, bare) for file, text in said if (bare := _bare(text))] == []


def test_every_cure_of_a_daemon_becomes_a_command_that_is_there() -> None:
    """Whatever raises it: the kinds' own advice, and that of one message alone."""
    cures = {one for said in faults() for one in (said.text, said.advice)} | {kind.value.advice for kind in FaultCode}
    cures |= {spec.advice for spec in all_specs(["main"])}
    assert len(cures) > 300
    for cure in cures:
        typed = as_commands(cure)
        assert _bare(typed) == [], cure
        named = [re.sub(r"<[^>]*>", "X", one) for one in _IN_A_LINE.findall(typed)]
        assert {one: trouble for one in named if (trouble := _trouble(one))} == {}, cure
        assert not re.search(r"`reprobe calibrate` (?:its|the) ", typed), "what it is to calibrate is typed, too"


def test_whatever_prints_a_cure_prints_it_as_it_is_typed() -> None:
    """One function does; a page of results, and the set-up's dialogue, put the words right themselves."""
    for file in sorted((ROOT / "daemon" / "cli").glob("*.py")):
        if file.name == "output.py":
            continue
        for line in file.read_text(encoding="utf-8").splitlines():
            assert "[dim]->[/]" not in line or ".advice" not in line, f"{file.name}: {line.strip()}"
            printed = re.search(r"(?:escape|print|say)\([^)]*(?:\.advice|\[.advice.\])", line)
            assert not printed or "as_commands" in line or "say_cure" in line, f"{file.name}: {line.strip()}"


def test_a_command_that_is_not_there_is_found() -> None:
    assert _trouble("corect TP7") == "there is no command corect"
    assert _trouble("touch TP7 --keep") == "touch has no ['--keep']"
    assert _trouble("plan check power.toml -c station.toml") is None
