"""A file that cannot be written is told by the name that was typed, with what to do."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from daemon.cli.last_resort import with_words
from daemon.platform.atomic_file import replace_whole


def test_a_folder_in_the_place_of_a_file_is_named_and_not_what_was_to_be_put_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    app = typer.Typer()
    (tmp_path / "wanted").mkdir()

    @app.command()
    def write() -> None:
        replace_whole(tmp_path / "wanted", lambda new: new.write_bytes(b"a page"))

    with_words(app)
    done = CliRunner().invoke(app, [])
    said = (done.output + capsys.readouterr().err).replace("\n", "")
    assert done.exit_code == 2
    assert "wanted: Is a directory" in said
    assert "give the name of one" in said
    assert ".new" not in said
