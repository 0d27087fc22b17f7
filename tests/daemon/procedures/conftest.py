"""What holds for every procedure's test: no page is drawn in a process of its own; pages have tests of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.daemon.procedures.fake_probing import Line


@pytest.fixture(autouse=True)
def pages(monkeypatch: pytest.MonkeyPatch) -> list[Sequence[str]]:
    """Return the arguments of every page that would have been drawn."""
    asked: list[Sequence[str]] = []

    async def draw(_module: str, arguments: Sequence[str], _within_s: float, _nicer: int = 0) -> tuple[int, str]:
        asked.append(arguments)
        return 0, ""

    monkeypatch.setattr("daemon.procedures.calibrate.commit.draw", draw, raising=False)
    return asked


@pytest.fixture
def line(tmp_path: Path) -> Line:
    """A station that probes."""
    return Line(tmp_path)
