"""A table of many rows looks as `rich` draws it."""

from __future__ import annotations

import random

import pytest

from daemon.cli import long_table
from daemon.cli.formatting import visible
from daemon.cli.long_table import Justify, print_long_table, whole_table
from daemon.cli.output import VisibleConsole

COLUMNS: dict[str, Justify] = {"name": "left", "x mm": "right", "net [V]": "left", "probe": "left"}
NAMES = ["TP1", "R[red]4", "Müller", "電源", "a\x1b[2Jb", "C:x:D", "", "a name that is longer than any other is"]
REASONS = [
    "yes",
    "",
    "it lies under U30",
    "solder mask covers it and " * 6,
    "longerthananylinethatistobehad" * 5,
    "電" * 70,
]


def _rows(names: list[str], count: int, seed: int) -> list[tuple[str, ...]]:
    chance = random.Random(seed)
    return [
        (chance.choice(names), f"{chance.uniform(0, 99):.3f}", chance.choice(NAMES[:6]), chance.choice(REASONS))
        for _ in range(count)
    ]


@pytest.mark.parametrize("width", [40, 80, 130, 300])
@pytest.mark.parametrize("names", [NAMES, NAMES[:4], ["two\nlines", "TP1"], ["a\ttab"]])
@pytest.mark.parametrize("count", [0, 1, 2, 40])
@pytest.mark.parametrize("is_terminal", [True, False])
def test_it_is_drawn_as_by_rich(
    width: int, names: list[str], count: int, is_terminal: bool, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    console = VisibleConsole(width=width, emoji=False, force_terminal=is_terminal)
    monkeypatch.setattr(long_table, "out", console)
    rows = _rows(names, count, seed=width)
    print_long_table("a [b]title", COLUMNS, rows)
    drawn = capsys.readouterr().out
    console.print(whole_table("a [b]title", COLUMNS, [[visible(cell) for cell in row] for row in rows]))
    assert drawn == capsys.readouterr().out
    assert "\x1b[2J" not in drawn
