"""A demonstration that stays for its page tells what it tested, however it is told to end."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from daemon.cli import demo
from daemon.cli.interruption import ENDING
from daemon.tools.demo.running import Bench
from daemon.tools.demo.settings import Places


@pytest.fixture
def as_the_command_sets_them() -> Iterator[None]:
    """Signals end the command, as they do while it starts its processes; Ctrl-C does as in a shell's foreground."""
    before = {number: signal.signal(number, demo._ENDING.ask) for number in ENDING}  # noqa: SLF001  # as `demo` does
    before[signal.SIGINT] = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("as_the_command_sets_them")
@pytest.mark.parametrize("number", [*ENDING, signal.SIGINT])
def test_however_it_is_ended_while_it_stays_what_was_tested_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    tested: Any = object()
    station, page = MagicMock(), SimpleNamespace(url="http://127.0.0.1:1")
    monkeypatch.setattr(demo, "running", lambda *_: nullcontext(station))
    monkeypatch.setattr(demo, "_beside", lambda *_, **__: nullcontext(page))
    monkeypatch.setattr(demo, "Session", MagicMock())
    monkeypatch.setattr(demo, "_test", lambda *_: tested)
    monkeypatch.setattr(demo, "_tell_where", lambda *_: os.kill(os.getpid(), number))
    wish = Bench(tmp_path, assembled=False, seed=1, speed=1.0)
    told = demo._run(Places(tmp_path, tmp_path), MagicMock(), wish, 1, page=True)  # noqa: SLF001  # all but starting
    assert told is tested
