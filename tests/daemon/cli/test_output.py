"""What a person is told is printed as it is written: brackets of a name are no markup."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
import typer
from rich.table import Table

from daemon.cli.output import fail, out

COMMANDS = Path(__file__).parents[3] / "daemon" / "cli"


def test_an_extra_is_named_whole_in_an_advice(capsys: pytest.CaptureFixture[str]) -> None:
    """`pip install 'reprobe'` would bring nothing that is missing."""
    with pytest.raises(typer.Exit):
        fail("no folder [/x] and no [bold]y", advice="pip install 'reprobe[page]'")
    said = capsys.readouterr().err
    assert "no folder [/x] and no [bold]y" in said
    assert "pip install 'reprobe[page]'" in said


def test_brackets_that_are_no_markup_end_no_command(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("name")
    table.add_row("N[/3]")
    out.print(table)
    out.print("net [/3]")
    said = capsys.readouterr().out
    assert "N[/3]" in said
    assert "net [/3]" in said


def test_what_fails_is_told_in_plain_words_and_escaped_once() -> None:
    """Else a person reads backslashes before the brackets of a name."""
    for path in sorted(COMMANDS.glob("*.py")):
        calls = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call))
        for call in (one for one in calls if isinstance(one.func, ast.Name) and one.func.id == "fail"):
            names = [node.id for node in ast.walk(call) if isinstance(node, ast.Name)]
            assert "escape" not in names, f"{path.name}, line {call.lineno}"
