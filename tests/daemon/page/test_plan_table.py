"""A plan that was edited as a table is read by the daemon as it was meant, and each mistake finds its line."""

from __future__ import annotations

from typing import Any

import pytest

from daemon.config.plan_file import PlanError, read_plan
from daemon.domain.board import Board
from daemon.domain.point_test import PointTest
from daemon.page.orders import BadOrder, asked
from daemon.page.plan_table import FIRST_LINE, plan_csv
from tests.station.rig import DEMO_BOARD


@pytest.fixture(scope="module")
def board() -> Board:
    from daemon.tools.board_import import import_board

    return import_board(DEMO_BOARD, "top")


def _read(board: Board, *tests: dict[str, Any]) -> tuple[PointTest, ...]:
    return read_plan(plan_csv(board.name, list(tests)), "csv", board, "edited").tests


def test_what_was_stored_is_the_same_after_it_went_through_the_table(board: Board) -> None:
    first, second, third = (point.name for point in board.test_points()[:3])
    text = (
        f'[plan]\nboard = "{board.name}"\n'
        f'[[point]]\npoint = "{first}"\nlow = "0.1 ohm"\nhigh = "4.7 kohm"\ntheta_deg = 45.0\nlook = "first"\n'
        f"touches = 3\nsecond_site = false\nnote = \"say 'hi', then, go\"\n"
        f'[[point]]\npoint = "{second}"\nmethod = "insert"\n'
        f'[[point]]\npoint = "{third}"\nmethod = "capacitance"\nhigh = "12.3 nF"\n'
    )
    stored = read_plan(text, "toml", board, "edited").tests
    rows = [test.model_dump(mode="json") for test in stored]
    for row in rows:
        limits = row.pop("limits") or {}
        for end in ("low", "high"):
            row[end] = None if limits.get(end) is None else f"{limits[end]!r} {limits['unit']}"
    assert _read(board, *rows) == stored


def test_a_mistake_is_told_with_the_line_of_its_test(board: Board) -> None:
    good = {"method": "continuity", "point": board.test_points()[0].name, "high": "5 ohm"}
    with pytest.raises(PlanError) as refused:
        _read(board, good, {**good, "point": "NOBODY"}, {**good, "point": board.test_points()[1].name, "high": "5"})
    assert [mistake.line for mistake in refused.value.mistakes] == [FIRST_LINE + 1, FIRST_LINE + 2]


@pytest.mark.parametrize("end", ["\n", "\r", "\t", "\u2028", "\x0b", "\x85"])
def test_no_text_makes_a_line_or_a_cell_of_its_own(board: Board, end: str) -> None:
    name = board.test_points()[0].name
    note = f"a{end}# board: other{end}insert{end}{board.test_points()[1].name}"
    (test,) = _read(board, {"method": "continuity", "point": name, "high": "5 ohm", "note": note})
    assert test.point == name
    assert test.note.startswith("a # board")


@pytest.mark.parametrize(
    "body",
    [
        {"tests": []},
        {"tests": "TP1"},
        {"tests": [["TP1"]]},
        {"tests": [{"point": {"name": "TP1"}}]},
        {"tests": [{"point": "T" * 501}]},
        {"tests": [{"point": "TP1"}] * 5001},
        {"board": "two\nlines"},
        {"board": None},
        {"name": "../../etc"},
        {"name": ""},
    ],
    ids=lambda body: str(body)[:40],
)
def test_what_is_no_table_is_refused_before_it_leaves_the_page(body: dict[str, Any]) -> None:
    order, given = asked(
        {
            "order": "store_plan",
            "name": "six",
            "board": "demo",
            "tests": [{"point": "TP1", "method": "contact"}],
            **body,
        }
    )
    with pytest.raises(BadOrder):
        order.fields(given)
