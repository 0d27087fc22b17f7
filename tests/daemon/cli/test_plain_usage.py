"""What is wrong with a command is said in plain words, with what is wanted."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.cli.output import answered
from daemon.client import Refused

pytestmark = pytest.mark.usefixtures("logging_as_before")


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["light", "blue"], "'blue' is not one of"),
        (["jog", "w"], "'w' is not one of"),
        (["place", "TP1", "--theta-deg", "abc"], "a number is wanted"),
        (["study", "TP1", "--times", "many"], "a whole number is wanted"),
        (["journal", "list", "--limit", "0"], "it should be greater than"),
    ],
)
def test_no_word_of_a_library_stands_in_a_usage_error(command: list[str], said: str) -> None:
    result = CliRunner().invoke(app, command, env={"COLUMNS": "200"})
    assert result.exit_code == 2
    assert said in result.output
    assert "Value error" not in result.output
    assert "Input should" not in result.output


def test_a_refused_request_names_its_wrong_fields(capsys: pytest.CaptureFixture[str]) -> None:
    error = {
        "name": "invalid_request", "code": 1002, "message": "a field is missing", "advice": "see detail",
        "detail": {"fields": [{"field": "theta_deg", "problem": "Input should be less than 360"}]},
    }  # fmt: skip
    with pytest.raises(typer.Exit), answered():
        raise Refused(error)
    assert "theta_deg: it should be less than 360" in capsys.readouterr().err


def test_keys_of_a_folder_that_is_not_there_are_no_empty_list(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["keys", "list", "--keys", str(tmp_path / "nowhere")])
    assert result.exit_code == 2
    assert "reprobe keys new" in result.output


def test_a_bundle_of_no_configuration_is_refused(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["bundle", "-c", str(tmp_path / "none.toml"), "-o", str(tmp_path / "b.tar.gz")])
    assert result.exit_code == 2
    assert not (tmp_path / "b.tar.gz").exists()
