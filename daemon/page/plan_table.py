"""Plan as a table of tests: what a browser edits becomes the CSV text that the daemon reads.

The daemon judges it; here only what could not be a cell is refused. Each test is a line of its own, so that a mistake
names the test it is about: `FIRST_LINE` is the first test's.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from typing import Any, Final

COLUMNS: Final = ("method", "point", "low", "high", "theta_deg", "look", "touches", "second_site", "note")
"""The method comes first: a line that began with a point's name could begin as a remark does."""
FIRST_LINE: Final = 3
MOST_TESTS, MOST_LETTERS = 5000, 500
_BOARD: Final = re.compile(r"[^\s#\"',;][^\r\n\t\"',;]{0,119}")


def plan_csv(board: object, tests: object) -> str:
    """Return the text of a plan for a board; raise ValueError for what is no table of tests."""
    if not isinstance(board, str) or not _BOARD.fullmatch(board):
        raise ValueError("the name of the board")
    if not isinstance(tests, list) or not 0 < len(tests) <= MOST_TESTS:
        raise ValueError(f"tests: 1 to {MOST_TESTS}")
    text = io.StringIO()
    text.write(f"# board: {board}\n")
    table = csv.writer(text, delimiter="\t", lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows([_cell(test, column) for column in COLUMNS] for test in tests)
    return text.getvalue()


def _cell(test: object, column: str) -> str:
    """Return a value as a cell; what would end the line or the cell is a blank."""
    value: Any = test.get(column) if isinstance(test, Mapping) else object()
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if not isinstance(value, str | int | float) or len(str(value)) > MOST_LETTERS:
        raise ValueError(f"{column}: a text or a number")
    return " ".join(str(value).split())
