"""What is answered to the guided set-up is checked where it is answered, and paths may begin where it was typed."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.usefixtures("logging_as_before")


@pytest.mark.parametrize("step", ["drives", "camera"])
def test_a_device_that_is_not_there_is_no_silent_one(tmp_path: Path, step: str) -> None:
    file = tmp_path / "station.toml"
    result = CliRunner().invoke(app, ["setup", "-c", str(file), "--only", step], input="ttyNOBODY\nq\n")
    assert result.exit_code == 1
    assert "there is no device 'ttyNOBODY'" in result.output
    assert "nobody answers" not in result.output


def test_a_board_may_be_named_as_it_is_seen_from_where_it_was_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT / "sim_hw")
    file = tmp_path / "station.toml"
    result = CliRunner().invoke(
        app, ["setup", "-c", str(file), "--only", "board"], input="demo_board\ntop\ny\n60\n40\n"
    )
    assert "Board demo_board, top" in result.output
    assert tomllib.loads(file.read_text())["board"]["file"] == "board.json"
    assert (tmp_path / "board.json").is_file()
