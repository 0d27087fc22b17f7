"""A command that is told to end, or whose terminal is closed, ends what it started."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli import setup
from daemon.cli.app import app
from daemon.cli.interruption import ENDING, taken_as_ctrl_c
from daemon.cli.setup_file_steps import Setup

pytestmark = pytest.mark.usefixtures("logging_as_before")


@pytest.mark.parametrize("number", ENDING)
def test_a_set_up_whose_terminal_is_closed_ends_its_daemon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    ended: list[bool] = []

    def told_to_end(_: Setup) -> None:
        # Whatever stood before would end this process
        assert signal.getsignal(number) not in (signal.SIG_DFL, signal.SIG_IGN)
        os.kill(os.getpid(), number)

    monkeypatch.setattr(setup, "STEPS", (setup.Step("one", "One", None, of_file=told_to_end),))
    monkeypatch.setattr("daemon.cli.setup.Daemon.end", lambda _: ended.append(True))
    result = CliRunner().invoke(app, ["setup", "-c", str(tmp_path / "station.toml")])
    assert result.exit_code == 1
    assert "goes on where this was" in result.output
    assert ended == [True]


def test_afterwards_the_signals_do_what_they_did_before() -> None:
    before = [signal.getsignal(number) for number in ENDING]
    with taken_as_ctrl_c(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGHUP)
    assert [signal.getsignal(number) for number in ENDING] == before
