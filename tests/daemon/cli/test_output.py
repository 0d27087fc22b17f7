"""What a person is told is printed as it is written: brackets of a name are no markup."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
import typer
from rich.table import Table

from daemon.cli.formatting import doubts
from daemon.cli.output import fail, out
from daemon.cli.tester import show
from daemon.domain.results import JobResult

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


def test_what_a_placed_needle_does_not_know_is_said_with_what_can_be_typed() -> None:
    unseen = {"name": "not_calibrated", "message": "no map", "advice": "`calibrate` the map"}
    said = doubts({"unconfirmed": unseen, "height": "unknown", "height_within_um": 500.0, "parallax_um": 93.2})
    assert [advice.split("`")[1] for _, advice in said] == ["reprobe calibrate", "reprobe calibrate surface"]
    assert said[0][0].endswith(": no map")
    assert "within 500 um; a look may see a pad 93 um aside" in said[1][0]
    assert doubts({"height": "measured", "confirmed_by": "picture"}) == []


@pytest.mark.parametrize("height", ["unknown", "measured"])
def test_a_result_is_shown_with_its_doubts(height: str, capsys: pytest.CaptureFixture[str]) -> None:
    result = JobResult(
        id="j1", op="place", ok=True, seq=7, station="s", finished_at="2026-01-02T03:04:05Z", outcome="placed",
        test_point="TP1", detail={"height": height, "height_within_um": 500.0},
    )  # fmt: skip
    show(result, as_json=False)
    assert ("-> `reprobe calibrate surface`" in capsys.readouterr().out) == (height == "unknown")
