"""`reprobe journal`: what others named cannot steer a terminal nor be run by a spreadsheet."""

from __future__ import annotations

import asyncio
import csv
import unicodedata
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.domain.results import ErrorBody, JobResult
from daemon.platform.clock import utc_now
from daemon.storage.journal import Journal
from daemon.tools.demo.settings import Places, write_settings

NASTY = "\x1b[2Jgone\x1b]0;title\x07\r\nnext\u202ereversed\x9b1m"
FORMULAS = ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", " =1", "\x00=1", "\uff1d1", "\u200b=1"]
pytestmark = pytest.mark.usefixtures("logging_as_before")


async def _write(folder: Path, ids: list[str]) -> None:
    folder.mkdir()
    journal = await Journal.open(folder / "journal.sqlite")
    for job_id in ids:
        await journal.add_job(job_id, "look", "{}")
        error = ErrorBody(code=2101, name="tip_not_found", message=NASTY, advice="look", detail={})
        await journal.finish_job(
            JobResult(
                id=job_id, op="look", ok=False, seq=journal.take_seq(), station="s", finished_at=utc_now(),
                outcome="failed", error=error,
            )
        )  # fmt: skip
    await journal.close()


@pytest.fixture
def config(tmp_path: Path) -> Path:
    asyncio.run(_write(tmp_path / "station", [NASTY, *FORMULAS]))
    return write_settings(Places(tmp_path, tmp_path))


@pytest.mark.parametrize(
    "arguments", [["list"], ["show", NASTY], ["show", "no such\x1b[2J"]], ids=["list", "show", "no"]
)
def test_no_control_character_of_a_job_reaches_the_terminal(config: Path, arguments: list[str]) -> None:
    result = CliRunner().invoke(app, ["journal", *arguments, "--config", str(config)])
    assert "x1b" in result.output
    shown = {character for character in result.output if unicodedata.category(character) in ("Cc", "Cf")}
    assert shown <= {"\n"}


def test_no_cell_of_the_table_is_a_formula(config: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(
        app, ["journal", "export", "--csv", str(tmp_path / "jobs.csv"), "--config", str(config)]
    )
    assert result.exit_code == 0
    with (tmp_path / "jobs.csv").open(encoding="utf-8", newline="") as file:
        cells = [row["id"] for row in csv.DictReader(file)]
    assert cells == [NASTY, *(f"'{formula}" for formula in FORMULAS)]
